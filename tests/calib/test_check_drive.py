"""Check drives: predicted sigmas hold, a calibration that is off is noticed, tape and turns agree with the truth."""

from dataclasses import replace
from functools import cache
from math import radians
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import boxcal
from boxcal.calib.check_drive.by_box import check_drive
from boxcal.calib.check_drive.by_hand import check_distance, check_turns
from boxcal.calib.check_drive.cli import main
from boxcal.calib.check_drive.text import by_box
from boxcal.calib.errors import CalibError
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.robot import khepera
from boxcal.calib.simulate.simulated_drive import SimulatedDrive

SLIP = 0.0005


def _drive(seed: int, stops: int = 8) -> SimulatedDrive:
    return boxcal.simulate(seed=seed, sigma_px=0.1, options=DriveOptions(stops=stops, slip=SLIP))


@cache
def _calibrated(seed: int) -> boxcal.Calibration:
    return boxcal.calibrate(_drive(seed, stops=10).correspondences, settings=Settings(report=False, slip=SLIP))


def test_predicted_sigmas_of_a_check_drive_hold() -> None:
    """Over independent calibrations and drives the first leg's chi-square sums to its degrees of freedom."""
    squares = [check_drive(_calibrated(k), _drive(100 + k, stops=3).correspondences)[0].chi_square for k in range(10)]
    low, high = chi2.ppf([0.001, 0.999], 3 * len(squares))
    assert low < sum(squares) < high


def test_wheels_that_are_one_percent_off_are_noticed() -> None:
    found, drive = _calibrated(1), _drive(101, stops=4).correspondences
    wrong = replace(found, wheels=replace(found.wheels, rR=found.wheels.rR * 1.01))
    assert min(leg.p_value for leg in check_drive(found, drive)) > 0.01 / 3
    assert min(leg.p_value for leg in check_drive(wrong, drive)) < 1e-6


def test_another_robots_calibration_is_named_as_such() -> None:
    other = boxcal.simulate(khepera(), seed=3, sigma_px=0.1, options=DriveOptions(stops=4))
    legs = check_drive(_calibrated(1), other.correspondences)
    text, agrees = by_box(legs, 0.01)
    assert not agrees
    assert "another robot's log" in text
    own = check_drive(_calibrated(1), _drive(101, stops=4).correspondences)
    assert max(leg.corner_rms for leg in own) < 1.5


def test_a_camera_that_was_turned_is_noticed() -> None:
    found, drive = _calibrated(1), _drive(101, stops=4).correspondences
    T = found.T_body_cam.copy()
    c, s = np.cos(radians(1)), np.sin(radians(1))
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ T[:3, :3]
    turned = replace(found, T_body_cam=T)
    assert min(leg.p_value for leg in check_drive(turned, drive)) < 1e-3


def test_tape_and_turns_agree_with_where_the_robot_truly_went() -> None:
    found, simulated = _calibrated(2), _drive(102, stops=3)
    first, last = simulated.drive.stop_poses[0], simulated.drive.stop_poses[-1]
    wheels = simulated.correspondences.wheels
    distance = check_distance(found, wheels, float(np.hypot(*(last - first)[:2])), 1e-4)
    turn = check_turns(found, wheels, (last - first)[2] / (2 * np.pi), 1e-4)
    assert abs(distance.sigmas) < 3.5
    assert abs(turn.sigmas) < 3.5
    assert distance.sigma < 0.02
    assert check_distance(found, wheels, distance.measured + 10 * distance.sigma, 1e-4).p_value < 1e-6


def test_what_cannot_be_checked_is_said() -> None:
    simulated = _drive(3, stops=4)
    closed = boxcal.calibrate(simulated.correspondences, settings=Settings(closed_form=True))
    with pytest.raises(CalibError, match="closed form"):
        check_drive(closed, simulated.correspondences)
    other = replace(simulated.correspondences, image_size=(1280, 960))
    with pytest.raises(CalibError, match="1280 x 960"):
        check_drive(_calibrated(1), other)


def test_the_command_compares_and_says_so_by_its_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, simulated = _calibrated(1), _drive(101, stops=4)
    boxcal.save_calibration(found, tmp_path / "calibration.json")
    simulated.correspondences.save(tmp_path / "check.npz")
    given = [str(tmp_path / "check.npz"), "--calibration", str(tmp_path / "calibration.json")]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert "as predicted" in said
    assert "3 to 4" in said
    first, last = simulated.drive.stop_poses[0], simulated.drive.stop_poses[-1]
    distance, turns = np.hypot(*(last - first)[:2]), (last - first)[2] / (2 * np.pi)
    assert main([*given, "--tape", f"{distance:.4f}", "--turns", f"{turns:.5f}"]) == 0
    assert "distance by the calibrated wheels" in capsys.readouterr().out
    assert main([*given, "--tape", f"{distance + 0.1:.4f}"]) == 1
    assert "not as predicted" in capsys.readouterr().out
    assert main([given[0], "--calibration", str(tmp_path / "none.json")]) == 2
    assert "none.json" in capsys.readouterr().err
