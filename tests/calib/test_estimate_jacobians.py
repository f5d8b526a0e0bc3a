"""Analytic derivatives against central differences, near the truth and far from it, for all unknowns and lenses."""

from math import radians

import numpy as np
import pytest

from boxcal.calib.geometry.so3_se3 import exp_se3, exp_so3, log_so3, right_jacobian
from boxcal.calib.likelihood.corner_residuals import corner_residuals
from boxcal.calib.likelihood.explanation import Columns, explained_columns
from boxcal.calib.likelihood.leg_residuals import leg_residuals
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import LOCAL, PER_STOP, Problem, build_problem
from boxcal.calib.likelihood.state import State, retract
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind, first_values, further_names

STEP = radians(0.1302)


def problem_and_state(lens: CameraKind, far: float) -> tuple[Problem, State]:
    """Two drives (one skips stops) with every unknown there is."""
    rng = np.random.default_rng(3)
    robot, target = khepera(), make_target()
    drive = simulate_drive(robot, target, DriveOptions(stops=5, slip=0.001, encoder_step=STEP, steps_per_sample=1), rng)
    data = exact_correspondences(robot, target, drive, 0.2, rng)
    options = EstimateOptions(lens=lens, target=target, encoder_step=STEP, explanations=(Everything(),))
    problem = build_problem([data, data], [(0, 1, 2, 3, 4), (0, 2, 4)], options, STEP)
    k = robot.camera
    lens_values = first_values(lens, np.array([k.fu, k.fv, k.cu, k.cv, k.kr]))
    lens_values[5:] += far * 0.02 * rng.normal(size=len(further_names(lens)))
    state = State(
        lens=lens_values,
        wheels=np.array([robot.rR, robot.rL, robot.b]) * (1 + far * 0.05 * rng.normal(size=3)),
        T_body_cam=robot.T_body_cam @ exp_se3(far * 0.05 * rng.normal(size=6)),
        tilt=far * 0.1 * rng.normal(size=(2, 2)),
        shape=far * 0.02 * rng.normal(size=len(problem.target.names)),
        common_growth=far * 0.3,
        explained=far * rng.normal(size=4),
        poses=drive.stop_poses[[0, 1, 2, 3, 4, 0, 2, 4]] + far * 0.02 * rng.normal(size=(8, 3)),
        lean=far * 0.02 * rng.normal(size=(8, 3)),
        growth=far * 0.1 * rng.normal(size=8),
        encoder_errors=far * rng.normal(size=(8, 2)),
    )
    return problem, state


class Everything:
    """An explanation that acts on travel, legs, camera model and camera pose, the same at every state."""

    names = ("travel", "leg", "focus", "knock")
    prior = (1.0,) * 4

    def columns(self, problem: Problem, state: State) -> Columns:
        rng = np.random.default_rng(8)
        travel = np.zeros((len(problem.path.dphi), 2, 4))
        travel[:, :, 0] = 1e-4 * rng.normal(size=(len(travel), 2))
        legs = np.zeros((len(problem.leg_stop), 3, 4))
        legs[:, :, 1] = 0.01 * rng.normal(size=(len(legs), 3))
        corners = np.zeros((len(problem.drive), len(state.lens) + 6, 4))
        corners[2:, 0, 2] = 3.0
        corners[3:, -6:, 3] = 0.05 * rng.normal(size=6)
        return Columns(travel=travel, legs=legs, corners=corners)


def worst_relative_error(problem: Problem, state: State) -> tuple[float, float]:
    """Of the derivatives of corners and legs, over all unknowns, each relative to its largest entry."""
    n, P, own = len(problem.names), len(problem.drive), PER_STOP + LOCAL
    columns = explained_columns(problem, state)
    corners, legs = corner_residuals(problem, state, columns), leg_residuals(problem, state, columns)
    stop = problem.corner_stop
    analytic = [np.zeros((corners.residual.size, n + own * P)), np.zeros((legs.residual.size, n + own * P))]
    analytic[0][:, :n] = (corners.jacobian @ corners.J_shared[corners.group]).reshape(-1, n)
    by_pose = corners.jacobian @ corners.J_pose[corners.group]
    by_local = corners.jacobian @ corners.J_local[corners.group]
    for row, j in enumerate(stop):
        at = n + own * j
        analytic[0][2 * row : 2 * row + 2, at : at + 3] = by_pose[row]
        analytic[0][2 * row : 2 * row + 2, at + PER_STOP : at + own] = by_local[row]
    for k, j in enumerate(problem.leg_stop):
        rows, at = slice(3 * k, 3 * k + 3), n + own * j
        analytic[1][rows, 5:8] = legs.jacobian[k, :, :3]
        analytic[1][rows, problem.explained] = legs.J_explained[k]
        analytic[1][rows, at : at + PER_STOP] = legs.jacobian[k, :, 3:8]
        analytic[1][rows, at + own : at + own + PER_STOP] = legs.jacobian[k, :, 8:]
    assert corners.valid

    def predicted(x: Array) -> tuple[Array, Array]:
        stops = x[n:].reshape(P, own)
        here = retract(problem, state, x[:n], stops[:, :PER_STOP], stops[:, PER_STOP:])
        return (
            -corner_residuals(problem, here, columns).residual.ravel(),
            -leg_residuals(problem, here, columns).residual.ravel(),
        )

    coefficients = {*range(5), *range(problem.extras.start, problem.extras.stop)}
    worst = [0.0, 0.0]
    for q in range(n + own * P):
        h = np.zeros(n + own * P)
        h[q] = 1e-6 if 5 <= q < 8 else 1e-4 if q in coefficients else 3e-6
        for kind, (plus, minus) in enumerate(zip(predicted(h), predicted(-h), strict=True)):
            numeric, exact = (plus - minus) / (2 * h[q]), analytic[kind][:, q]
            worst[kind] = max(worst[kind], float(np.abs(numeric - exact).max() / max(np.abs(exact).max(), 1e-3)))
    return worst[0], worst[1]


@pytest.mark.parametrize("lens", list(CameraKind))
@pytest.mark.parametrize("far", [0.0, 1.0])
def test_derivatives_of_corners_and_legs_agree_with_central_differences(lens: CameraKind, far: float) -> None:
    corners, legs = worst_relative_error(*problem_and_state(lens, far))
    assert corners < 1e-6
    assert legs < 1e-6


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-5, 0.3, 2.5])
def test_right_jacobian_is_the_derivative_of_the_rotation_exponential(size: float) -> None:
    w = size * np.array([0.6, -0.48, 0.64])
    h = 1e-6
    numeric = [
        (log_so3(exp_so3(w).T @ exp_so3(w + e)) - log_so3(exp_so3(w).T @ exp_so3(w - e))) / (2 * h)
        for e in h * np.eye(3)
    ]
    np.testing.assert_allclose(np.array(numeric).T, right_jacobian(w), atol=1e-8)
