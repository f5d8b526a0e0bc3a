"""Likelihood of a leg's difference as a slip of one wheel, a pushed box or a robot carried.

A slip at some moment of a leg can look like almost any small displacement, and a pushed box like any at all: each
explanation is charged for all that it could have explained besides.
"""

from enum import StrEnum
from math import radians

import numpy as np

from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_outliers import box_motion
from boxcal.calib.likelihood.log_sum import log_sum
from boxcal.target.arrays import Array

SLIP = 0.02
"""Travel that a wheel slips at one moment, standard deviation, m."""
PUSHED = (0.01, radians(1.5))
"""How far a box is pushed, along each axis, and turned: standard deviations, m and rad."""
CARRIED = (0.2, radians(40))
"""The same of a robot that is carried."""
_STEP = 1e-6
_NONE = 1e-12


class LegCause(StrEnum):
    """Events that may happen on one leg."""

    SLIPPED = "leg-slipped"
    BOX_MOVED = "box-moved"
    CARRIED = "robot-carried"


def slip_of(fit: Fit, k: int) -> tuple[str, float, float]:
    """Return which wheel's slip at one moment explains a leg best, how long it is and its standard deviation, m."""
    d, rough, moments = _slips(fit, k)
    N = np.linalg.inv(rough)
    information = np.einsum("si,ij,sj->s", moments, N, moments) + SLIP**-2
    length = moments @ N @ d / information
    best = int(np.argmax(length**2 * information - np.log(information)))
    side = "right" if best < len(moments) // 2 else "left"
    return side, float(length[best]), float(1 / np.sqrt(information[best]))


def leg_log_evidences(fit: Fit, k: int) -> dict[LegCause, float]:
    """Return the logarithm of the evidence of each cause of a leg's difference.

    Parameters
    ----------
    fit
        The solution, without the leg.
    k
        Which leg.
    """
    C = fit.tests.covariance[k]
    d, rough, moments = _slips(fit, k)
    slips = [_log_normal(d, rough + SLIP**2 * np.outer(g, g)) for g in moments[:: max(1, len(moments) // _MOMENTS)]]
    to_box = _box_jacobian(fit, k, d)
    pushed = np.linalg.inv(to_box)
    return {
        LegCause.SLIPPED: float(log_sum(np.asarray(slips)) - np.log(len(slips))),
        LegCause.BOX_MOVED: _log_normal(d, C + pushed @ _spread(PUSHED) @ pushed.T),
        LegCause.CARRIED: _log_normal(d, C + _spread(CARRIED)),
    }


_MOMENTS = 200
"""Moments of a leg at which a slip is tried."""


def _slips(fit: Fit, k: int) -> tuple[Array, Array, Array]:
    """Return a leg's difference, its covariance to the order in which slips are linear, and slips' effects (2 S, 3)."""
    d, C = fit.tests.difference[k], fit.tests.covariance[k]
    by_travel = fit.at.legs.model.by_travel[:, :, fit.problem.path.leg == k]
    bend = 0.5 * abs(d[2]) * float(np.hypot(*d[:2]))
    return d, C + np.diag([bend**2, bend**2, 0.0]), np.concatenate(list(by_travel), axis=1).T


def _spread(sigma: tuple[float, float]) -> Array:
    return np.diag(np.square([sigma[0], sigma[0], sigma[1]]))


def _box_jacobian(fit: Fit, k: int, difference: Array) -> Array:
    """Return the derivative of the box' displacement and turn by the leg's difference, (3, 3)."""
    i = fit.problem.leg_stop[k]
    first, second = fit.state.poses[i], fit.state.poses[i + 1]
    columns = []
    for e in np.eye(3):
        there, here = (box_motion(first, second, difference + s * _STEP * e) for s in (1, -1))
        columns.append(np.append(there[0] - here[0], there[1] - here[1]) / (2 * _STEP))
    return np.stack(columns, axis=1)


def _log_normal(d: Array, cov: Array) -> float:
    """Return the logarithm of a normal density about zero; directions without variance do not count."""
    values, vectors = np.linalg.eigh(cov)
    some = values > _NONE * values[-1]
    along = (vectors.T @ d)[some]
    return float(-0.5 * np.sum(along**2 / values[some] + np.log(2 * np.pi * values[some])))
