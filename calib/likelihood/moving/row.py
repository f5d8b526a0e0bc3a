"""Stops and frames on the move as one row of data: the problem, the state to start from, and the weights."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from boxcal.calib.geometry.diff_drive import legs_between
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_model import leg_model
from boxcal.calib.likelihood.levenberg_marquardt import Weights
from boxcal.calib.likelihood.moving.clock import CameraClock
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.rolling import Readout
from boxcal.calib.likelihood.moving.weave import Woven
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.wheel_path import wheel_path
from boxcal.target.arrays import Array, Ids

FINEST_STEP = 1e-6
"""Encoder step (rad) of readings that show none, so that errors in time reach them."""


def _clock(woven: Woven) -> CameraClock:
    return CameraClock(rates=woven.rates, since_s=woven.since_s, drive=woven.drive, drives=len(woven.drives))


def along(problem: Problem, woven: Woven) -> Problem:
    """Return a problem with the same stops and frames elsewhere on the wheels' path."""
    legs = [legs_between(drive, tuple(range(len(drive.stops)))) for drive in woven.drives if drive.stops]
    return replace(
        problem,
        path=wheel_path(legs),
        leg_known=np.concatenate([np.zeros(0, dtype=np.bool_), *(leg.known for leg in legs)]),
        explanations=(*problem.explanations[:-2], _clock(woven), problem.explanations[-1]),
    )


def row_problem(fit: Fit, woven: Woven) -> Problem:
    """Return the data of stops and frames, from the solution of the stops alone."""
    explanations: tuple[Explanation, ...] = (*fit.problem.explanations, _clock(woven), Readout())
    options = replace(fit.options, lens=fit.problem.lens, explanations=explanations)
    step = max(fit.problem.step, FINEST_STEP)
    kept = [tuple(range(len(drive.stops))) for drive in woven.drives]
    problem = build_problem(woven.drives, kept, options, step)
    return with_floor(problem, fit.problem.floor_px)


def first_state(fit: Fit, woven: Woven, problem: Problem) -> State:
    """Return the state of the stops with the frames where the wheels lead from the stops before them.

    Without stops the solution is of the frames themselves.
    """
    count, explained = len(woven.frame), np.append(fit.state.explained, np.zeros(2 * len(woven.drives) + 1))
    if len(woven.moving) == count:
        return taken(fit.state, np.searchsorted(fit.problem.stop, woven.frame), explained)
    stops = np.flatnonzero(woven.frame < 0)
    poses = led_by_wheels(problem, woven, fit.state)

    def of_stops(values: Array) -> Array:
        out = np.zeros((count, *values.shape[1:]))
        out[stops] = values
        return out

    return replace(
        fit.state,
        explained=explained,
        poses=poses,
        lean=of_stops(fit.state.lean),
        growth=of_stops(fit.state.growth),
        encoder_errors=of_stops(fit.state.encoder_errors),
    )


def led_by_wheels(problem: Problem, woven: Woven, at_stops: State) -> Array:
    """Return poses, (P, 3): the stops' own, and for frames where the wheels lead from the stops before them."""
    count = len(woven.frame)
    nothing = np.zeros((len(problem.leg_stop), 2))
    model = leg_model(problem.path, at_stops.wheels, nothing, nothing)
    leg_before = np.searchsorted(problem.leg_stop, woven.moving - 1)
    poses = np.zeros((count, 3))
    poses[woven.frame < 0] = at_stops.poses
    for k, leg in zip(woven.moving.tolist(), leg_before.tolist(), strict=True):
        x, y, theta = poses[k - 1]
        dx, dy, turn = model.displacement[leg]
        c, s = np.cos(theta), np.sin(theta)
        poses[k] = x + c * dx - s * dy, y + s * dx + c * dy, theta + turn
    return poses


def row_weights(fit: Fit, woven: Woven, problem: Problem, noise: FrameNoise) -> Weights:
    """Return the weights of corners and legs, what was found faulty at stops left out."""
    if len(woven.moving) == len(woven.frame):
        return _weights_of_frames(fit, woven, problem, noise)
    corners = np.full(len(problem.uv_px), noise.scale**-2.0)
    corners[~np.isin(problem.corner_stop, woven.moving)] = fit.weights.corners
    stop_of = np.cumsum(woven.frame < 0) - 1
    leg_of = np.searchsorted(fit.problem.leg_stop, stop_of[problem.leg_stop])
    legs = fit.weights.legs[leg_of] * problem.leg_known
    return Weights(corners=corners, legs=legs)


def _weights_of_frames(fit: Fit, woven: Woven, problem: Problem, noise: FrameNoise) -> Weights:
    """Return the weights where the solution is of the frames themselves."""
    at, starts = np.searchsorted(fit.problem.stop, woven.frame), fit.problem.corner_starts
    corners = np.concatenate([fit.weights.corners[starts[k] : starts[k + 1]] for k in at])
    legs = np.array([fit.weights.legs[i:j].min() for i, j in pairwise(at)])
    return Weights(corners=(corners > 0) * noise.scale**-2.0, legs=legs * problem.leg_known)


def taken(state: State, places: Ids, explained: Array) -> State:
    """Return a state of some places of its row, (P,), with other unknowns of explanations."""
    return replace(
        state,
        explained=explained,
        poses=state.poses[places],
        lean=state.lean[places],
        growth=state.growth[places],
        encoder_errors=state.encoder_errors[places],
    )
