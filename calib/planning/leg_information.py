"""Information of the wheels on a path from one stop to the next."""

from dataclasses import replace

import numpy as np

from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.leg_residuals import leg_covariance, leg_residuals
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.wheel_path import WheelPath
from boxcal.calib.planning.assumptions import Model
from boxcal.calib.planning.paths import Paths
from boxcal.target.arrays import Array

_PIECES = 8
"""Samples that each arc is cut into: enough for how slip adds up along it."""


def wheel_path_of(paths: Paths, wheels: Array) -> WheelPath:
    """Return the wheels' travel along paths, each arc cut into a few samples."""
    N, A = paths.distance.shape
    half = wheels[2] / 2
    right = (paths.distance + half * paths.turn) / wheels[0] / _PIECES
    left = (paths.distance - half * paths.turn) / wheels[1] / _PIECES
    dphi = np.repeat(np.stack([right, left], axis=2).reshape(N * A, 2), _PIECES, axis=0)
    count = A * _PIECES
    return WheelPath(
        dphi=dphi,
        starts=np.arange(N) * count,
        leg=np.repeat(np.arange(N), count),
        moving=(np.flatnonzero(dphi[:, 0]), np.flatnonzero(dphi[:, 1])),
        phi_start=np.zeros_like(dphi),
        t_start_ns=np.zeros(0, dtype=np.int64),
    )


def leg_information_of(
    model: Model, of_pictures: tuple[Problem, State], paths: Paths, *, start: Array, end: Array
) -> Array:
    """Return the information of paths about (rR, rL, b) and the unknowns of both stops in the chain, (N, 13, 13).

    Parameters
    ----------
    model
        Robot and noise.
    of_pictures
        Likelihood of images of the same robot; where they stand does not matter.
    paths
        N paths.
    start, end : (N, 3), m and rad
        Poses at their ends.
    """
    problem, state = of_pictures
    N = len(start)
    poses = np.stack([start, end], axis=1).reshape(-1, 3)
    path = wheel_path_of(paths, state.wheels)
    legs_only = replace(
        problem, path=path, leg_stop=2 * np.arange(N), drive=np.zeros(2 * N, dtype=np.int64), explanations=()
    )
    there = replace(state, poses=poses, encoder_errors=np.zeros((2 * N, 2)), explained=np.zeros(0))
    legs = leg_residuals(legs_only, there, Columns())
    given = model.assumptions
    seconds = 2 * paths.rolled(float(state.wheels[2])) / given.max_speed  # a raised cosine's mean is half its peak
    finer = paths.distance.shape[1] * _PIECES / np.maximum(seconds * given.joint_rate_hz, 1.0)
    shape = replace(legs.model, quantisation=legs.model.quantisation * np.minimum(finer, 1.0)[:, None, None])
    information = np.linalg.inv(leg_covariance(legs_only, shape, np.array(model.components.slip)))
    J = legs.jacobian
    return np.asarray(np.swapaxes(J, 1, 2) @ information @ J)
