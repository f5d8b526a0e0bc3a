"""Three stops: the least that determines a calibration; nothing is left over to tell slip from."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import ASSUMED_SLIP, estimate


@pytest.mark.parametrize("seed", range(6))
def test_three_stops_give_wheels_within_their_sigma_and_say_what_was_assumed(exact: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = np.array([[0.65, 0.1, np.pi], [0.45, 0.55, -2.2 + 0.1 * seed], [-0.1, 0.7 + 0.02 * seed, -1.4]])
    drive = exact.through(poses, exact.mounting(2.0, 9.0, 1.0))
    found = estimate([drive.correspondences(0.05, rng)])
    assert found.noise.slip == pytest.approx(ASSUMED_SLIP, rel=0.2)
    assert any("2 legs do not show how much the wheels slip" in note for note in found.notes)
    for name, value in (("rR", drive.wheels.rR), ("rL", drive.wheels.rL), ("b", drive.wheels.b)):
        assert 0 < getattr(found, name) < 2 * value
        assert abs(getattr(found, name) - value) < 4 * found.sigma[name]


def test_a_given_slip_is_not_called_assumed(exact: Any) -> None:
    poses = np.array([[0.65, 0.1, np.pi], [0.45, 0.55, -2.2], [-0.1, 0.7, -1.4]])
    drive = exact.through(poses, exact.mounting(2.0, 9.0, 1.0)).correspondences(0.05, np.random.default_rng(1))
    found = estimate([drive], None, replace(EstimateOptions(), slip=2e-4))
    assert found.notes == ()


def test_four_stops_estimate_slip_themselves(exact: Any) -> None:
    drive = exact.through(exact.around(4, 0.7, 0.0, np.random.default_rng(3)), exact.mounting(2.0, 9.0, 1.0))
    found = estimate([drive.correspondences(0.05, np.random.default_rng(1))])
    assert not any("assumed" in note for note in found.notes)
