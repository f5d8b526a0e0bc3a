"""Tests of single legs and corners: what cannot be explained by noise at a stated chance of a false alarm.

A leg is compared with what all other data predict for it, the level of slip taken from the other legs too. In a chain
of stops that is the residual over its own (smaller) covariance, so nothing is solved again.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from boxcal.calib.likelihood.levenberg_marquardt import Linearised, Weights
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.residuals import LEG_UNKNOWNS, leg_covariance
from boxcal.calib.likelihood.variance_components import SlipProfile
from boxcal.target.arrays import Array, Ids

ENOUGH = 6
"""With fewer legs than this none is left out: 6 unknowns are fitted to 3 numbers a leg."""
_TESTABLE = 1e-6
"""A direction in which the other data say less than this about a leg cannot be tested."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegTests:
    """How each leg compares with what the other data predict.

    Attributes
    ----------
    p_value : (N,)
        Chance of a difference as large.
    difference : (N, 3), m and rad
        Wheels less prediction, ``(dx, dy, dtheta)`` in the body frame of the leg's first stop.
    covariance : (N, 3, 3)
        Of that difference.
    whitened : (N, 3)
        The leg's residual at the solution, whitened by its own covariance.
    """

    p_value: Array
    difference: Array
    covariance: Array
    whitened: Array


def leg_tests(problem: Problem, at: Linearised, weights: Weights, profile: SlipProfile) -> LegTests:
    """Return the tests of all legs, those left out included."""
    i, s = problem.leg_stop, profile.solution
    K, N = len(profile.slip), len(i)
    own, cross = s.stop_blocks()
    with_stops = -s.Y @ s.cov[:, None]  # (K, P, 5, n): covariance of stop and shared unknowns
    cov = np.empty((K, N, LEG_UNKNOWNS, LEG_UNKNOWNS))
    first, second = slice(3, 8), slice(8, 13)
    cov[:, :, :3, :3] = s.cov[:, None, 5:8, 5:8]
    cov[:, :, first, first], cov[:, :, second, second] = own[:, i], own[:, i + 1]
    cov[:, :, first, second] = cross[:, i]
    cov[:, :, second, first] = np.swapaxes(cross[:, i], -1, -2)
    for part, stop in ((first, i), (second, i + 1)):
        cov[:, :, part, :3] = with_stops[:, stop, :, 5:8]
        cov[:, :, :3, part] = np.swapaxes(cov[:, :, part, :3], -1, -2)
    d = np.concatenate(
        [np.broadcast_to(s.d_shared[:, None, 5:8], (K, N, 3)), s.d_stops[:, i], s.d_stops[:, i + 1]], axis=2
    )
    J = at.legs.jacobian
    C = leg_covariance(problem, at.legs.model, profile.slip)
    L = np.linalg.cholesky(C)
    r = np.linalg.solve(L, (at.legs.residual - np.einsum("nij,knj->kni", J, d))[..., None])[..., 0]
    half = np.linalg.solve(L, J @ cov @ np.swapaxes(J, 1, 2))
    V = np.linalg.solve(L, np.swapaxes(half, -1, -2))
    used = weights.legs > 0
    values, vectors = np.linalg.eigh(np.eye(3) + np.where(used, -1.0, 1.0)[:, None, None] * V)
    testable = values > _TESTABLE
    values = np.where(testable, values, 1.0)
    z = np.einsum("knij,kni->knj", vectors, r)
    square = np.sum(np.where(testable, z**2 / values, 0.0), axis=2)
    freedom = testable.sum(axis=2)
    # Weight of each level without the leg itself: divide by the density that the level gave the leg.
    log_weight = profile.log_weight[:, None] + np.where(
        used,
        0.5 * square + 0.5 * np.linalg.slogdet(C)[1] - 0.5 * np.sum(np.log(values), axis=2),
        0.0,
    )
    weight = np.exp(log_weight - log_weight.max(axis=0))
    weight /= weight.sum(axis=0)
    p_value = np.sum(weight * np.where(freedom > 0, stats.chi2.sf(square, np.maximum(freedom, 1)), 1.0), axis=0)
    best = np.argmax(profile.weight)
    # Difference from the prediction: an included leg has pulled the solution towards itself.
    pull = np.where(used[:, None] & testable[best], z[best] / values[best], z[best])
    spread = np.where(used[:, None], np.where(testable[best], 1 / values[best], np.inf), values[best])
    back = L[best] @ vectors[best]
    finite = np.where(np.isfinite(spread), spread, 0.0)
    return LegTests(
        p_value=p_value,
        difference=np.einsum("nij,nj->ni", back, pull),
        covariance=(back * finite[:, None, :]) @ np.swapaxes(back, 1, 2),
        whitened=r[best],
    )


def flag_legs(problem: Problem, tests: LegTests, weights: Weights, chance: float) -> Array:
    """Return the legs' new weights: at most one more is left out at a time, and those that fit come back.

    Parameters
    ----------
    problem, tests, weights
        The legs, their tests, and which of them count now.
    chance
        Of a false alarm in a drive: each of its N legs is tested at ``chance / N``.
    """
    limit = chance / leg_counts(problem)
    out = weights.legs == 0
    new = np.where(out & (tests.p_value >= limit), 1.0, weights.legs)
    suspicious = ~out & (tests.p_value < limit)
    if np.any(suspicious) and np.sum(out) < most_left_out(len(out)):
        worst = np.argmin(np.where(suspicious, tests.p_value, np.inf))
        new[worst] = 0.0
    return np.asarray(new)


def most_left_out(legs: int) -> int:
    """Return how many legs may be left out at most: none where the others are too few to say what slip is usual."""
    return (legs - 2) // 2 if legs >= ENOUGH else 0


def leg_counts(problem: Problem) -> Array:
    """Return how many legs the drive of each leg has, (N,)."""
    drive = problem.drive[problem.leg_stop]
    return np.bincount(drive, minlength=problem.drives).astype(np.float64)[drive]


def flag_corners(problem: Problem, residual: Array, factor: float, chance: float) -> tuple[Array, Ids]:
    """Return the corners' weights (0 or 1), and the stops where more than half do not fit (and so none is left out).

    Parameters
    ----------
    problem
        The corners.
    residual : (L, 2)
        Whitened residuals for pixel factor 1.
    factor
        Pixel factor.
    chance
        Of a false alarm in a drive: each of its L corners is tested at ``chance / L``.
    """
    stop = problem.corner_stop
    drive = problem.drive[stop]
    count = np.bincount(drive, minlength=problem.drives)[drive]
    bad = np.sum(residual**2, axis=1) > factor**2 * stats.chi2.isf(chance / count, 2)
    P = len(problem.drive)
    share = np.bincount(stop, weights=bad, minlength=P) / np.maximum(np.bincount(stop, minlength=P), 1)
    hopeless = np.flatnonzero(share > 0.5)
    bad &= ~np.isin(stop, hopeless)
    return np.where(bad, 0.0, 1.0), hopeless


def robust_factor(residual: Array) -> float:
    """Return a pixel factor that a few wrong corners do not change: by the median of the squared distances."""
    return float(np.sqrt(np.median(np.sum(residual**2, axis=1)) / (2 * np.log(2.0))))


def first_leg_weights(problem: Problem, at: Linearised) -> tuple[Array, float]:
    """Return which legs to begin with (0 or 1), and a level of slip, from medians at the first state."""
    unit = leg_covariance(problem, at.legs.model, np.array(1.0)) if len(problem.leg_stop) else np.zeros((0, 3, 3))
    if not len(unit):
        return np.ones(0), 0.0
    square = np.einsum("ni,nij,nj->n", at.legs.residual, np.linalg.inv(unit), at.legs.residual)
    middle = float(np.median(square))
    keep = np.ones(len(square))
    far = np.argsort(-square)[: most_left_out(len(square))]
    keep[far] = np.where(square[far] > 25 * middle, 0.0, 1.0)
    return keep, float(np.sqrt(middle / stats.chi2.median(3)))
