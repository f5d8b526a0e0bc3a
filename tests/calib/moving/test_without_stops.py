"""Robots that stood still at too few places: calibrated from frames on the move, never called good, or refused."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import boxcal
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.calib.simulate.simulated_drive import SimulatedDrive
from boxcal.detect.correspondences import Correspondences, load_correspondences

LATE_S = 0.06


@cache
def _simulated() -> SimulatedDrive:
    return boxcal.simulate(options=DriveOptions(stops=18, slip=5e-4), seed=8)


def _drive(shutter: ShutterOptions, frames: int = 40) -> Correspondences:
    """The drive as a robot that stood still nowhere would have logged it."""
    one = _simulated()
    seen = moving_frames(one.robot, one.target, one.drive, shutter, np.random.default_rng(5))
    kept = np.unique(np.linspace(0, len(seen) - 1, frames).round().astype(int))
    return replace(one.correspondences, stops=(), moving=tuple(seen[k] for k in kept))


def _calibrated(drive: Correspondences, moving: Moving = Moving.AUTO) -> Calibration:
    return boxcal.calibrate(drive, settings=Settings(report=False, moving=moving))


@cache
def _usual() -> Calibration:
    return _calibrated(_drive(ShutterOptions(late_s=LATE_S)))


def test_a_drive_without_stops_is_calibrated_within_its_sigmas_and_never_good() -> None:
    found, robot = _usual(), _simulated().robot
    off = found.T_body_cam[:3, 3] - robot.T_body_cam[:3, 3]
    errors = {"rR": found.wheels.rR - robot.rR, "rL": found.wheels.rL - robot.rL, "b": found.wheels.b - robot.b}
    errors |= dict(zip(("tx", "ty", "tz"), off.tolist(), strict=True))
    assert found.detail is not None
    covariance = found.detail.covariance
    sigma = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    assert max(abs(errors[name]) / sigma[name] for name in errors) < 3.5
    assert sigma["tx"] < 5e-4
    assert found.verdict.level is Level.USABLE
    assert any(reason.rule == "no-stops" for reason in found.verdict.reasons)
    assert any(f"{1e3 * LATE_S:.0f}." in note and "ms late" in note for note in found.notes)


def test_a_drive_without_stops_that_was_saved_gives_the_same_again(tmp_path: Path) -> None:
    drive = _drive(ShutterOptions(late_s=LATE_S))
    drive.save(tmp_path / "d.npz")
    again = _calibrated(load_correspondences(tmp_path / "d.npz"))
    assert again.wheels == _usual().wheels
    assert again.verdict.level is _usual().verdict.level


@pytest.mark.parametrize(
    ("shutter", "why"),
    [
        (ShutterOptions(late_s=3.0), "no clock offset within 0.4 s"),
        (ShutterOptions(readout_s=0.025), "the robot stood still at fewer than three places, and"),
    ],
)
def test_frames_that_clocks_or_shutter_spoil_are_refused_with_what_is_missing(
    shutter: ShutterOptions, why: str
) -> None:
    with pytest.raises(CalibError, match=why) as caught:
        _calibrated(_drive(shutter))
    assert "stand still for two seconds" in str(caught.value)


def _jumping(frames: int, jump_s: float) -> Correspondences:
    drive = _drive(ShutterOptions(late_s=LATE_S), frames=frames)
    half_ns = (drive.moving[0].t_ns + drive.moving[-1].t_ns) // 2
    moving = [replace(f, t_ns=f.t_ns + round(1e9 * jump_s) * (f.t_ns > half_ns)) for f in drive.moving]
    return replace(drive, moving=tuple(moving))


def test_of_a_clock_that_jumps_the_longer_side_is_used() -> None:
    found, robot = _calibrated(_jumping(40, 0.05)), _simulated().robot
    assert any("the camera's clock jumps by" in note and "were left out" in note for note in found.notes)
    assert found.verdict.level is Level.USABLE
    assert found.detail is not None
    sigma = found.detail.covariance.sigma
    off = found.T_body_cam[:3, 3] - robot.T_body_cam[:3, 3]
    assert abs(found.wheels.b - robot.b) < 3.5 * sigma["b"] < 5e-3
    assert abs(off[0]) < 3.5 * sigma["tx"] < 5e-3


def test_too_few_frames_on_either_side_of_a_jump_are_refused() -> None:
    with pytest.raises(CalibError, match="fewer than 12 frames are left on its longer side"):
        _calibrated(_jumping(14, 0.04))


def test_a_frame_that_is_mistaken_is_left_out_and_said() -> None:
    drive = _drive(ShutterOptions(late_s=LATE_S))
    moving = list(drive.moving)
    moving[15] = replace(moving[3], t_ns=moving[15].t_ns)
    found, robot = _calibrated(replace(drive, moving=tuple(moving))), _simulated().robot
    said = [reason.text for reason in found.verdict.reasons if reason.rule == "no-stops"]
    assert (
        "39 frames taken on the move stand for stops (1 more, seen to turn as the wheels do not, left out)" in said[0]
    )
    assert found.detail is not None
    covariance = found.detail.covariance
    sigma = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    assert abs(found.wheels.b - robot.b) < 3.5 * sigma["b"] < 2e-3


def test_too_few_frames_without_stops_are_refused() -> None:
    with pytest.raises(CalibError, match="0 usable stops, and 8 frames on the move that show the box"):
        _calibrated(_drive(ShutterOptions(), frames=8))


def test_frames_that_are_not_to_be_used_do_not_stand_for_stops() -> None:
    with pytest.raises(CalibError, match="are not to be used"):
        _calibrated(_drive(ShutterOptions()), Moving.OFF)
