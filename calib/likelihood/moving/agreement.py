"""Agreement of the solution with frames on the move and the one without them.

Where both are right, the one with more data has the smaller covariance, and their difference the difference of the two
covariances (Hausman 1978, DOI 10.2307/1913827). Frames that spoil the answer are found by a larger difference.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from boxcal.calib.geometry.parameters import COUNT, ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array

SIGMAS = 3.5
"""A parameter that changes by more than this (in standard deviations of the stops) disagrees."""
CHANCE = 1e-3
"""Changes of all parameters together that are less probable than this disagree."""
_LEAST_GAIN = 0.15
"""Directions in which frames lessen the variance by a smaller fraction than this cannot be compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Change of the answer by frames on the move.

    Attributes
    ----------
    parameter, sigmas
        The reported parameter that changes most, and by how many standard deviations of the stops alone.
    p_value
        Chance of changes as large, if both solutions are right.
    """

    parameter: str
    sigmas: float
    p_value: float

    @property
    def holds(self) -> bool:
        """Whether the two solutions agree."""
        return self.sigmas <= SIGMAS and self.p_value >= CHANCE


def agreement(stops: tuple[State, Array], joint: tuple[State, Array]) -> Agreement:
    """Return how well two solutions agree, each a state and the covariance (n, n) of its shared unknowns.

    Parameters
    ----------
    stops
        Without frames on the move.
    joint
        With them.
    """
    (a, C_a), (b, C_b) = stops, joint
    R = a.T_body_cam[:3, :3]
    change = np.concatenate(
        [
            b.lens[:5] - a.lens[:5],
            b.wheels - a.wheels,
            log_so3(R.T @ b.T_body_cam[:3, :3]),
            R.T @ (b.T_body_cam[:3, 3] - a.T_body_cam[:3, 3]),
        ]
    )
    C_a, C_b = C_a[:COUNT, :COUNT], C_b[:COUNT, :COUNT]
    sigma = np.sqrt(np.diag(C_a))
    off = np.abs(change) / sigma
    # about whitened by the stops' covariance, frames leave 1 - gain of each direction's variance
    scale = np.diag(1 / sigma)
    values, vectors = np.linalg.eigh(scale @ C_a @ scale)
    whiten = (vectors / np.sqrt(np.maximum(values, 1e-12))).T @ scale
    gain, directions = np.linalg.eigh(np.eye(COUNT) - whiten @ C_b @ whiten.T)
    compared = gain > _LEAST_GAIN
    along = directions.T @ whiten @ change
    square = float(np.sum(along[compared] ** 2 / gain[compared]))
    most = int(np.argmax(off))
    freedom = max(int(compared.sum()), 1)
    return Agreement(parameter=ORDER[most], sigmas=float(off[most]), p_value=float(chdtrc(freedom, square)))
