"""What wheel readings mean: units and signs."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.correspondences import Correspondences, load_correspondences, taken_as
from boxcal.detect.errors import DetectError
from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits
from boxcal.target.box import make_target


@pytest.fixture(scope="module")
def drive() -> Correspondences:
    robot, target = khepera(), make_target()
    driven = simulate_drive(robot, target, DriveOptions(stops=3, steps_per_sample=1), np.random.default_rng(0))
    return exact_correspondences(robot, target, driven)


def _read_in(drive: Correspondences, right: float, left: float) -> Correspondences:
    """The drive as a driver records it that publishes other figures: rad times a factor for each wheel."""
    wheels = replace(drive.wheels, phi_R=right * drive.wheels.phi_R, phi_L=left * drive.wheels.phi_L)
    stops = tuple(replace(s, phi_R=right * s.phi_R, phi_L=left * s.phi_L) for s in drive.stops)
    return replace(drive, wheels=wheels, stops=stops)


@pytest.mark.parametrize(
    ("units", "right", "left"),
    [
        (WheelUnits(unit=JointUnit.DEGREES), 180 / pi, 180 / pi),
        (WheelUnits(unit=JointUnit.TURNS), 1 / (2 * pi), 1 / (2 * pi)),
        (WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=4096), 4096 / (2 * pi), 4096 / (2 * pi)),
        (WheelUnits(reverse_left=True), 1.0, -1.0),
        (WheelUnits(unit=JointUnit.DEGREES, reverse_right=True), -180 / pi, 180 / pi),
    ],
)
def test_readings_become_rad_rolling_forward(
    drive: Correspondences, units: WheelUnits, right: float, left: float
) -> None:
    taken = taken_as(_read_in(drive, right, left), units)
    np.testing.assert_allclose(taken.wheels.phi_R, drive.wheels.phi_R, rtol=1e-12)
    np.testing.assert_allclose(taken.wheels.phi_L, drive.wheels.phi_L, rtol=1e-12)
    np.testing.assert_allclose([s.phi_L for s in taken.stops], [s.phi_L for s in drive.stops], rtol=1e-12)


def test_units_are_saved_and_not_applied_twice(drive: Correspondences, tmp_path) -> None:
    units = WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=1000, reverse_left=True)
    taken = taken_as(drive, units)
    taken.save(tmp_path / "drive.npz")
    loaded = load_correspondences(tmp_path / "drive.npz")
    assert loaded.units == units
    np.testing.assert_array_equal(taken_as(loaded, units).wheels.phi_R, taken.wheels.phi_R)
    np.testing.assert_allclose(taken_as(loaded, WheelUnits()).wheels.phi_L, drive.wheels.phi_L, rtol=1e-12)


@pytest.mark.parametrize("bad", [{"unit": JointUnit.TICKS}, {"ticks_per_turn": 10.0}])
def test_ticks_need_their_number_and_only_they(bad) -> None:
    with pytest.raises(DetectError, match="--ticks-per-turn"):
        WheelUnits(**bad)


@pytest.mark.parametrize("ticks", [0.0, -5.0, float("nan"), float("inf")])
def test_ticks_per_turn_are_a_positive_number(ticks: float) -> None:
    with pytest.raises(DetectError, match="positive"):
        WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=ticks)
