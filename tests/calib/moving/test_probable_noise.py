"""Levels of slip and jitter that are probable: found from what stops show, and wherever they are if that misleads."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

import boxcal
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import one_time
from boxcal.calib.likelihood.moving.grid import Axis, Probable, over_levels
from boxcal.calib.likelihood.moving.levels import jitter_axis, slip_axis
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import Joint, joined, maximised, scan
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames

_NOISE = FrameNoise(slip=3e-4, jitter_s=1e-3, sway=0.1, scale=1.0)


@cache
def _at_maximum() -> tuple[Fit, Joint]:
    simulated = boxcal.simulate(options=DriveOptions(stops=10, slip=3e-4), seed=12)
    frames = moving_frames(
        simulated.robot, simulated.target, simulated.drive, ShutterOptions(), np.random.default_rng(3)
    )
    drive = replace(simulated.correspondences, moving=frames[::4])
    stops = fit([drive], None, EstimateOptions(target=simulated.target))
    joint = joined(stops, [drive], np.arange(len(drive.moving)), one_time(1), _NOISE)
    found = maximised(stops, [drive], joint, _NOISE)
    assert found is not None
    return stops, found


def _slips() -> Axis:
    stops, joint = _at_maximum()
    return slip_axis(joint.problem, joint.at, stops.profile, None)


def _found(slips: Axis) -> Probable:
    stops, joint = _at_maximum()
    return over_levels(partial(scan, stops, joint, _NOISE), slips, jitter_axis(), None)


def test_fewer_levels_are_looked_at_first_and_the_noise_is_the_same() -> None:
    slips = _slips()
    assert 2 <= len(slips.nearby) < len(slips.coarse)
    near, everywhere = _found(slips), _found(replace(slips, first=None))
    for a, b in ((near.levels.slip, everywhere.levels.slip), (near.levels.jitter_s, everywhere.levels.jitter_s)):
        assert near.weight @ a == pytest.approx(everywhere.weight @ b, rel=0.03)


@pytest.mark.parametrize("misled", [(1e-6, 2e-6), (0.05, 0.1)])
def test_stops_that_mislead_cost_time_only(misled: tuple[float, float]) -> None:
    slips = _slips()
    found, everywhere = (_found(replace(slips, first=first)) for first in (misled, None))
    np.testing.assert_array_equal(found.slip, everywhere.slip)
    np.testing.assert_array_equal(found.weight, everywhere.weight)


def test_likelihoods_are_those_of_the_solutions_and_what_is_not_solved_is_improbable() -> None:
    stops, joint = _at_maximum()
    found = _found(_slips())
    levels = found.levels
    system = scan(stops, joint, _NOISE, levels.slip, levels.jitter_s).system
    left = system.squares - levels.solution.decrease
    told = -0.5 * (system.log_noise + levels.solution.log_det + left)
    np.testing.assert_allclose(levels.log_likelihood, told, rtol=0, atol=1e-5)
    solved = np.isin(found.slip, levels.slip) & np.isin(found.jitter_s, levels.jitter_s)
    assert solved.sum() >= len(levels.slip)
    likely = found.log_likelihood > found.log_likelihood.max() - np.log(1e6)
    assert np.sum(likely) == len(levels.slip) < len(found.slip)
