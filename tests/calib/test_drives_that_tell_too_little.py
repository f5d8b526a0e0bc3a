"""Drives from which no wheels can be found get one line with the true cause, through the interface of Python too."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import boxcal
from boxcal.calib.errors import CalibError
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.errors import DetectError
from boxcal.target.arrays import Array
from boxcal.target.box import make_target

ROBOT, TARGET = turtlebot(), make_target()
YAW = float(np.arctan2(ROBOT.T_body_cam[1, 2], ROBOT.T_body_cam[0, 2]))


def drive_through(poses: Array) -> Correspondences:
    rng = np.random.default_rng(1)
    drive = simulate_drive(ROBOT, TARGET, DriveOptions(clearance=0.02), rng, poses)
    return exact_correspondences(ROBOT, TARGET, drive, 0.1, rng)


def turned(drive: Correspondences, right: float, left: float) -> Correspondences:
    """The same drive with all readings of a wheel multiplied."""
    wheels = replace(drive.wheels, phi_R=right * drive.wheels.phi_R, phi_L=left * drive.wheels.phi_L)
    stops = tuple(replace(s, phi_R=right * s.phi_R, phi_L=left * s.phi_L) for s in drive.stops)
    return replace(drive, wheels=wheels, stops=stops)


def known_legs(drive: Correspondences, legs: int) -> Correspondences:
    """The same drive with readings missing on all legs but the last few."""
    covered = np.ones(len(drive.wheels), dtype=np.bool_)
    covered[[stop.last_sample + 2 for stop in drive.stops[: -1 - legs]]] = False
    return replace(drive, wheels=replace(drive.wheels, covered=covered))


@pytest.fixture(scope="module")
def sound() -> Correspondences:
    return boxcal.simulate(stops=12, seed=1).correspondences


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: turned(d, 0, 0), "the wheels' readings never change"),
        (lambda d: turned(d, 1, 0), "the left wheel's readings never change"),
        (lambda d: turned(d, 0, 1), "the right wheel's readings never change"),
        (lambda d: known_legs(d, 0), "the wheels' travel is known on 0 of 11 paths"),
        (lambda d: known_legs(d, 1), "the wheels' travel is known on 1 of 11 paths"),
    ],
)
def test_wheels_that_tell_nothing_are_named(
    sound: Correspondences, change: Callable[[Correspondences], Correspondences], said: str
) -> None:
    with pytest.raises(CalibError, match=f"^{said}"):
        boxcal.calibrate(change(sound), TARGET)


def test_a_few_known_legs_are_enough_or_said_to_be_few(sound: Correspondences) -> None:
    found = boxcal.calibrate(known_legs(sound, 6), TARGET)
    assert found.detail is not None
    for name in ("rR", "rL", "b"):
        assert abs(getattr(found.wheels, name) - getattr(ROBOT, name)) < 4 * found.detail.covariance.sigma[name]
    with pytest.raises(CalibError, match="the wheels' travel between them is known 2 times"):
        boxcal.calibrate(known_legs(sound, 2), TARGET)


@pytest.mark.parametrize("y", [0.0, 0.1, -0.1])
@pytest.mark.parametrize("x", [(1.2, 1.1, 1.0, 0.9, 0.8, 0.7, 0.6), (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3)])
def test_a_drive_without_turns_is_no_box_on_its_side(x: tuple[float, ...], y: float) -> None:
    with pytest.raises(CalibError, match=r"^largest turn between stops is 0\.\d deg"):
        boxcal.calibrate(drive_through(np.array([[each, y, np.pi] for each in x])), TARGET)


@pytest.mark.parametrize("seed", range(4))
def test_small_turns_on_the_spot_are_no_reversed_wheel(seed: int) -> None:
    """Encoder steps make such moves look like moves of tiny wheels that stand a micrometre apart."""
    turns = np.radians(np.random.default_rng(seed).uniform(-20, 20, 8))
    with pytest.raises(CalibError, match="the robot only turned on the spot"):
        boxcal.calibrate(drive_through(np.array([[0.7, 0.1, np.pi - YAW + turn] for turn in turns])), TARGET)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e200])
def test_a_stop_with_an_angle_that_is_none_is_refused(sound: Correspondences, wrong: float) -> None:
    for wheel in ("phi_R", "phi_L"):
        with pytest.raises(DetectError, match=r"^a stop: a wheel's angle is not finite, or beyond 1e\+09 rad"):
            replace(sound.stops[2], **{wheel: wrong})


def test_a_corner_without_a_place_is_refused(sound: Correspondences) -> None:
    stop = sound.stops[0]
    with pytest.raises(DetectError, match="a standard deviation is beyond 16384 px"):
        replace(stop, cov_px2=stop.cov_px2 * 1e12)


def test_a_robot_that_stops_twice_at_a_place_is_simulated_and_calibrated() -> None:
    around = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    away = np.random.default_rng(2).uniform(0.6, 0.8, 8)
    poses = np.stack([away * np.cos(around), away * np.sin(around), around + np.pi - YAW], axis=1)
    drive = drive_through(np.repeat(poses, 2, axis=0))
    assert len(drive.stops) == 16
    found = boxcal.calibrate(drive, TARGET)
    assert found.detail is not None
    for name in ("rR", "rL", "b"):
        assert abs(getattr(found.wheels, name) - getattr(ROBOT, name)) < 4 * found.detail.covariance.sigma[name]
