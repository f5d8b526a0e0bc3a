"""Motions and growth of a box as a whole, which no robot can determine.

Where the box stands, a robot's poses take up; how large it is, its wheels and its camera's place. A likelihood whose
noise levels are held says a little of them still: a smaller box makes smaller residuals, and the floor's prior holds
its tilt. That is no news of the box, and adds up: 300 robots of 7 legs each would shrink it by 0.09 %.
"""

import numpy as np

from boxcal.calib.joint_box.shape_prior import ShapePrior
from boxcal.calib.joint_box.sharpness import landmark_jacobian, similarities
from boxcal.target.arrays import Array

_REACHED = 1e-3
"""A motion that the unknowns make up to this fraction of it is one that they can make."""


def gauge_free(prior: ShapePrior, shape: Array) -> Array:
    """Return what takes motions and growth of the whole box out of moves of a shape, (m, m): a projection.

    Parameters
    ----------
    prior
        The box and its unknowns.
    shape : (m,)
        About which shape.
    """
    target = prior.refined(shape, np.zeros((len(shape), len(shape))), (), 1)
    weight, _ = prior.equations(shape, prior.usual)
    usual = 1 / np.sqrt(np.diag(weight))
    by_unit = landmark_jacobian(target, prior.names) * usual
    moves = similarities(target)
    made = np.linalg.pinv(by_unit, rcond=1e-9) @ moves
    missed = np.linalg.norm(moves - by_unit @ made, axis=0) / np.linalg.norm(moves, axis=0)
    moves, made = moves[:, missed < _REACHED], made[:, missed < _REACHED]
    coefficients = np.linalg.lstsq(moves, by_unit, rcond=None)[0]
    return np.asarray(np.eye(len(shape)) - (usual[:, None] * made) @ (coefficients / usual))
