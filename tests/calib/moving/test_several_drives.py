"""Frames on the move of several drives of one robot: a clock offset and a rate each."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import boxcal
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import PRIOR_RATE
from boxcal.calib.likelihood.moving.merge import with_moving_frames
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.results.unknowns import describe
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.calib.simulate.robot import VGA, Robot, random_robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target

TARGET = make_target()
CLOCKS = (ShutterOptions(late_s=0.03, clock_rate=8e-5), ShutterOptions(late_s=-0.02))


@cache
def _drives() -> tuple[Robot, tuple[Correspondences, ...]]:
    """One robot that drives twice, its camera's clock set anew in between."""
    rng = np.random.default_rng(12)
    robot = random_robot("r", rng, VGA)
    out = []
    for shutter in CLOCKS:
        drive = simulate_drive(robot, TARGET, DriveOptions(stops=9, slip=3e-4), rng)
        seen = exact_correspondences(robot, TARGET, drive, 0.1, rng)
        out.append(replace(seen, moving=moving_frames(robot, TARGET, drive, shutter, rng)[::2]))
    return robot, tuple(out)


@cache
def _stops() -> tuple[Estimate, Fit]:
    drives, options = list(_drives()[1]), EstimateOptions(target=TARGET, systematic_share=0.0)
    found = fit(drives, None, options)
    return reported(found, drives, options), found


@cache
def _both() -> Estimate:
    return with_moving_frames(*_stops(), _drives()[1])


def _z(found: Estimate) -> list[float]:
    robot = _drives()[0]
    off = found.T_body_cam[:3, 3] - robot.T_body_cam[:3, 3]
    errors = {"rR": found.rR - robot.rR, "b": found.b - robot.b, "tx": float(off[0]), "ty": float(off[1])}
    return [abs(error) / found.sigma[name] for name, error in errors.items()]


def test_frames_of_both_drives_are_used_each_with_a_clock_of_its_own() -> None:
    found, alone = _both(), _stops()[0]
    value = dict(zip(found.names, found.values.tolist(), strict=True))
    for number, shutter in enumerate(CLOCKS, 1):
        late, rate = f"camera_late_{number}", f"camera_clock_rate_{number}"
        assert abs(value[late] - shutter.late_s) < 3.5 * found.extra_sigma[late] < 1e-3
        assert abs(value[rate] - shutter.clock_rate) < 3.5 * found.extra_sigma[rate]
        assert found.extra_sigma[rate] < 0.2 * PRIOR_RATE
    assert re.search(r"ms late in drive 1 and (19|20)\.\d \+- 0\.\d ms early in drive 2", found.notes[-1])
    assert re.search(r"its clock runs [6-9]\d \+- \d+ ppm fast \(drive 1\)", found.notes[-1])
    assert found.sigma["tx"] < 0.5 * alone.sigma["tx"]
    assert max(_z(found)) < 3.5
    assert [len(drive.T_box_body) for drive in found.drives] == [9, 9]


def test_both_drives_together_are_surer_than_either() -> None:
    options = EstimateOptions(target=TARGET, systematic_share=0.0)
    for drive in _drives()[1]:
        solved = fit([drive], None, options)
        one = with_moving_frames(reported(solved, [drive], options), solved, [drive])
        assert all(_both().sigma[name] < one.sigma[name] for name in ("tx", "ty", "rR", "b"))


def test_a_drive_without_frames_keeps_its_stops_only() -> None:
    first, second = _drives()[1]
    found = with_moving_frames(*_stops(), [first, replace(second, moving=second.moving[:3])])
    value = dict(zip(found.names, found.values.tolist(), strict=True))
    assert "drive 2" not in found.notes[-1]
    assert abs(value["camera_late_1"] - CLOCKS[0].late_s) < 1e-3
    assert value["camera_late_2"] == pytest.approx(0.0, abs=1e-12)
    assert max(_z(found)) < 3.5


def test_drives_with_few_frames_each_cannot_be_made_to_use_them() -> None:
    few = [replace(drive, moving=drive.moving[:3]) for drive in _drives()[1]]
    with pytest.raises(CalibError, match="3 in a drive are too few"):
        with_moving_frames(*_stops(), few, Moving.ON)


def test_a_long_drive_with_a_slow_clock_is_put_right_and_one_clock_needs_no_rate() -> None:
    simulated = boxcal.simulate(options=DriveOptions(stops=14, slip=3e-4), seed=4)
    options = EstimateOptions(target=simulated.target, systematic_share=0.0)
    solved = fit([simulated.correspondences], None, options)
    alone = reported(solved, [simulated.correspondences], options)
    for rate in (0.0, -1e-3):
        shutter, rng = ShutterOptions(late_s=0.02, clock_rate=rate), np.random.default_rng(5)
        frames = moving_frames(simulated.robot, simulated.target, simulated.drive, shutter, rng)[::3]
        found = with_moving_frames(alone, solved, [replace(simulated.correspondences, moving=frames)])
        value = dict(zip(found.names, found.values.tolist(), strict=True))
        assert abs(value["camera_clock_rate"] - rate) < 3.5 * found.extra_sigma["camera_clock_rate"]
        assert ("ppm slow" in found.notes[-1]) == (rate < 0)
        assert found.sigma["tx"] < 0.4 * alone.sigma["tx"]
        off = found.T_body_cam[:2, 3] - simulated.robot.T_body_cam[:2, 3]
        assert abs(off[0]) < 3.5 * found.sigma["tx"]
        assert abs(off[1]) < 3.5 * found.sigma["ty"]


def test_results_hold_each_clock_with_its_sigma_and_are_read_back(tmp_path: Path) -> None:
    found = boxcal.calibrate(list(_drives()[1]), TARGET, settings=Settings(report=False))
    boxcal.save_calibration(found, tmp_path / "calibration.json")
    again = boxcal.load_calibration(tmp_path / "calibration.json")
    assert found.detail is not None
    assert again.detail is not None
    for name in ("camera_late_1", "camera_late_2", "camera_clock_rate_1", "camera_clock_rate_2", "camera_readout"):
        assert again.detail.extra[name] == found.detail.extra[name]
        assert 0 < again.detail.extra_sigma[name] == found.detail.extra_sigma[name]
    assert describe("camera_clock_rate_2").words == "rate of the camera's clock against the wheels', drive 2"
    assert describe("camera_late").unit == "ms"


def test_a_drive_of_frames_alone_is_not_solved_with_others() -> None:
    first, second = _drives()[1]
    with pytest.raises(CalibError, match="fewer than three places"):
        boxcal.calibrate([first, replace(second, stops=())], TARGET, settings=Settings(report=False))
