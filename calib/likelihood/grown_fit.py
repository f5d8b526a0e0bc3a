"""The solution with one more stop, started from the solution without it: for estimates while the robot drives.

Variance components and what was found faulty are taken over, so that a stop costs a few steps of the solver and no new
search. What the components have become is for a full :func:`boxcal.calib.likelihood.estimator.fit` to say, when there
is time for one.
"""

from dataclasses import replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.step1_camera import MIN_LANDMARKS, located
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.estimator import step_of
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.levenberg_marquardt import Weights, linearize, maximise
from boxcal.calib.likelihood.outliers import flag_corners, flag_legs, leg_tests
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.calib.likelihood.rounds import averaged_over_slip
from boxcal.calib.likelihood.slip_profile import fixed_profile
from boxcal.calib.likelihood.state import State
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import CameraModel

_LEGS_TO_JUDGE_BY = 4
"""With fewer legs nothing says what slip is usual."""
_NEAR = 1e-3
"""Promised decrease of the sum of squares at which the solver ends: a thirtieth of a standard deviation."""


def grown_fit(known: Fit, drive: Correspondences) -> Fit:
    """Return the solution with the stops that a drive has gained, from the solution without them.

    Parameters
    ----------
    known
        The solution of the same drive when it had fewer stops. Stops that it used may have been measured anew.
    drive
        The drive now. Stops that show too little to place the camera are left out.

    Raises
    ------
    CalibError
        If the equations cannot be solved, or the known solution is of several drives.
    """
    if known.problem.drives != 1:
        raise CalibError(f"a solution of {known.problem.drives} drives cannot grow, one is needed")
    old = known.problem.stop
    camera = CameraModel.from_values(known.problem.lens, known.state.lens)
    fresh = [j for j in range(int(old[-1]) + 1, len(drive.stops)) if len(drive.stops[j].landmark_ids) >= MIN_LANDMARKS]
    options = replace(known.options, lens=known.problem.lens)
    problem = build_problem([drive], [(*old.tolist(), *fresh)], options, step_of([drive], options))
    problem = with_floor(problem, known.problem.floor_px)
    poses = located(camera, [drive.stops[j] for j in fresh]) if fresh else np.zeros((0, 4, 4))
    state = _longer(known, poses)
    weights = _weights(known, problem)
    try:
        return _solved(known, problem, state, weights)
    except np.linalg.LinAlgError as error:
        raise CalibError(
            f"the equations of {len(problem.stop)} stops cannot be solved",
            remedy="leave out stops that show few tags",
        ) from error


def _longer(known: Fit, T_cam_box: Array) -> State:
    """Return the known state with more stops, which stand upright on the floor where their images put them."""
    state, more = known.state, len(T_cam_box)
    T_box_body = inverse(T_cam_box) @ inverse(state.T_body_cam) if more else np.zeros((0, 4, 4))
    heading = np.arctan2(T_box_body[:, 1, 0], T_box_body[:, 0, 0])
    poses = np.concatenate([T_box_body[:, :2, 3], heading[:, None]], axis=1)
    return replace(
        state,
        poses=np.concatenate([state.poses, poses]),
        lean=np.concatenate([state.lean, np.zeros((more, 3))]),
        growth=np.concatenate([state.growth, np.zeros(more)]),
        encoder_errors=np.concatenate([state.encoder_errors, np.zeros((more, 2))]),
    )


def _weights(known: Fit, problem: Problem) -> Weights:
    """Return the weights that were known, ones for what is new or was measured anew."""
    legs = problem.leg_known.astype(np.float64)
    old = known.weights.legs
    legs[: len(old)] = np.minimum(old, legs[: len(old)])
    corners = np.ones(len(problem.uv_px))
    for k in range(len(known.problem.stop)):
        before, now = _rows(known.problem, k), _rows(problem, k)
        if before.size == now.size:
            corners[now] = known.weights.corners[before]
    return Weights(corners=corners, legs=legs)


def _rows(problem: Problem, stop: int) -> Ids:
    return np.arange(problem.corner_starts[stop], problem.corner_starts[stop + 1])


def _with_legs_that_fit(known: Fit, problem: Problem, state: State, weights: Weights) -> Weights:
    """Return the weights with those new legs left out that the solution without them contradicts.

    A leg that is far off would drag the solution along before it is tested, and sound legs would look faulty.
    """
    new = np.arange(len(weights.legs)) >= len(known.weights.legs)
    without = Weights(corners=weights.corners, legs=np.where(new, 0.0, weights.legs))
    if not known.options.find_faults or np.count_nonzero(without.legs) < _LEGS_TO_JUDGE_BY:
        return weights
    at = linearize(problem, state, without)
    tests = leg_tests(problem, at, without, fixed_profile(problem, at, known.components, without))
    limit = known.options.false_alarm / len(weights.legs)
    return Weights(corners=weights.corners, legs=np.where(new & (tests.p_value < limit), 0.0, weights.legs))


def _solved(known: Fit, problem: Problem, state: State, weights: Weights) -> Fit:
    """Return the solution for the known components; a new corner or leg that does not fit is left out."""
    options, components = known.options, known.components
    weights = _with_legs_that_fit(known, problem, state, weights)
    at, steps = maximise(problem, state, components, weights, _NEAR)
    corners, unreliable = flag_corners(problem, at.residual_px, components.noise_scale, options.false_alarm)
    profile = fixed_profile(problem, at, components, weights)
    tests = leg_tests(problem, at, weights, profile)
    legs = flag_legs(problem, tests, weights, options.false_alarm)
    if not (np.array_equal(corners, weights.corners) and np.array_equal(legs > 0, weights.legs > 0)):
        weights = Weights(corners=corners, legs=legs)
        at, more = maximise(problem, at.state, components, weights, _NEAR)
        steps += more
        profile = fixed_profile(problem, at, components, weights)
        tests = leg_tests(problem, at, weights, profile)
    at, cov, squares = averaged_over_slip(problem, at, components, weights, profile, share=options.systematic_share)
    return replace(
        known,
        problem=problem,
        at=at,
        cov=cov,
        profile=profile,
        weights=weights,
        tests=tests,
        unreliable_stops=unreliable,
        iterations=steps,
        cost=squares + float(np.sum((tests.whitened**2).T * (weights.legs > 0))),
    )
