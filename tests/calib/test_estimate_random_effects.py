"""Robots that lean, boxes made by hand: found, and honestly uncertain; faultless drives stay as they were."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood import CameraKind, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate, fit
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.levenberg_marquardt import Weights, maximise
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.rounds import refit
from boxcal.calib.likelihood.score_test import score_tests
from boxcal.calib.likelihood.state import State
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.calib.uncertainty.cramer_rao import Truth, errors
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target

TARGET, ROBOT, STEP = make_target(), turtlebot(), radians(0.1302)


def driven(seed: int, lean_deg: float = 0.0, stops: int = 12) -> tuple[Correspondences, Drive]:
    """A drive whose robot leans by some deg (standard deviation, two axes) at every stop."""
    rng = np.random.default_rng(seed)
    drive = simulate_drive(ROBOT, TARGET, DriveOptions(stops=stops, slip=3e-4, encoder_step=STEP), rng)
    leaning = [
        T @ np.linalg.inv(ROBOT.T_body_cam) @ rigid(exp_so3(np.array([*rng.normal(0, radians(lean_deg), 2), 0.0])),
                                                    np.zeros(3)) @ ROBOT.T_body_cam
        for T in drive.T_box_cam
    ]  # fmt: skip
    drive = replace(drive, T_box_cam=np.array(leaning))
    return exact_correspondences(ROBOT, TARGET, drive, 0.05, rng), drive


def truth_of(drive: Drive) -> Truth:
    return Truth.of(ROBOT, drive.stop_poses, slip=3e-4, encoder_step=STEP)


@pytest.mark.parametrize("seed", range(2))
def test_a_robot_that_leans_is_calibrated_and_its_lean_is_told(seed: int) -> None:
    data, drive = driven(seed, lean_deg=0.08)
    found = estimate([data], None, EstimateOptions(target=TARGET))
    assert 0.6 < np.degrees(found.components.lean) / 0.08 < 1.5
    assert np.abs(errors(found, truth_of(drive)) / np.sqrt(np.diag(found.cov))).max() < 3.7
    rigid_floor = estimate([data], None, EstimateOptions(target=TARGET, rigid_floor=True))
    assert rigid_floor.noise.pixel_factor > 3 * found.noise.pixel_factor  # what the rigid model makes of it
    assert rigid_floor.components.lean == 0


def test_a_faultless_drive_has_no_lean_no_deformation_and_nothing_unexplained() -> None:
    data, _ = driven(5)
    found = estimate([data], None, EstimateOptions(target=TARGET, lens=None))
    assert found.camera.kind is CameraKind.RADIAL
    assert np.degrees(found.components.lean) < 0.005
    assert found.components.target["place"] < 5e-5
    assert not found.jackknife.unexplained
    assert 0 < found.scale_sigma < 0.002


class Knock:
    """The camera was knocked aside, by millimetres, at the seventh stop."""

    names = ("knock",)
    prior = (50.0,)

    def columns(self, problem: Problem, state: State) -> Columns:
        corners = np.zeros((len(problem.drive), len(state.lens) + 6, 1))
        corners[6:, -3, 0] = 1e-3
        return Columns(corners=corners)


def test_score_test_foretells_what_the_adopted_explanation_finds() -> None:
    data, _ = driven(6)
    solved = fit([data], None, EstimateOptions(target=TARGET))
    (test,) = score_tests(solved, [Knock()])
    adopted = refit(solved, [Knock()])
    sigma = float(np.sqrt(np.diag(adopted.cov)[adopted.problem.explained][0]))
    assert adopted.state.explained[0] == pytest.approx(float(test.estimate[0]), abs=0.3 * sigma)
    assert sigma == pytest.approx(float(test.sigma[0]), rel=0.3)


def test_leave_one_leg_out_is_what_solving_without_it_gives() -> None:
    data, _ = driven(7)
    solved = fit([data], None, EstimateOptions(target=TARGET))
    found = estimate([data], None, EstimateOptions(target=TARGET))
    slip = replace(solved.components, slip=float(solved.profile.slip[solved.profile.best]))
    whole, _ = maximise(solved.problem, solved.at, slip, solved.weights, 1e-12)
    legs = solved.weights.legs.copy()
    legs[4] = 0.0
    without, _ = maximise(solved.problem, whole.state, slip, Weights(corners=solved.weights.corners, legs=legs), 1e-12)
    change = without.state.wheels - whole.state.wheels
    told = found.jackknife.changes[len(data.stops) + 4, 5:8]
    np.testing.assert_allclose(told, change, atol=0.03 * float(np.sqrt(found.cov[7, 7])))
