"""Tests of single legs and corners: what cannot be explained by noise at a stated chance of a false alarm.

A leg is compared with what all other data predict for it, the level of slip taken from the other legs too. In a chain
of stops that is the residual over its own (smaller) covariance, so nothing is solved again.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import special

from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.likelihood.leg_residuals import FIRST_STOP, LEG_UNKNOWNS, SECOND_STOP, leg_covariance
from boxcal.calib.likelihood.leg_spread import ENOUGH, surprise
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.slip_profile import SlipProfile
from boxcal.calib.likelihood.stop_elimination import Solution
from boxcal.target.arrays import Array, Ids, Mask

_RETURNS = 2
"""A leg that was let in again so often stays."""
_TESTABLE = 1e-6
"""A direction in which the other data say less than this about a leg cannot be tested."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegTests:
    """Outlier tests of all legs against the prediction of the other data.

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
    square : (N,)
        Squared Mahalanobis distance of the difference, slip's level averaged.
    expected_square : (N,)
        Expected square of the leg's own error in standard deviations, the solution's uncertainty included.
    """

    p_value: Array
    difference: Array
    covariance: Array
    whitened: Array
    square: Array
    expected_square: Array


def leg_tests(problem: Problem, at: Linearization, weights: Weights, profile: SlipProfile) -> LegTests:
    """Return the tests of all legs, those rejected included.

    A leg of weight w has the covariance C / w. With V what the solution does not know of it (in those units,
    eigenvalues v), the other data predict it with the covariance ``v / (1 - v)``, and its residual without itself is
    ``z / (1 - v)``.

    Parameters
    ----------
    problem, at, weights, profile
        The solution.
    """
    i, s = problem.leg_stop, profile.solution
    K, N = len(profile.slip), len(i)
    cov = leg_unknowns(problem, s)
    d = np.concatenate(
        [np.broadcast_to(s.d_shared[:, None, 5:8], (K, N, 3)), s.d_stops[:, i], s.d_stops[:, i + 1]], axis=2
    )
    J = at.legs.jacobian
    J_all = np.concatenate([J, at.legs.J_explained], axis=2)
    C = leg_covariance(problem, at.legs.model, profile.slip)
    used = weights.legs > 0
    w = np.where(used, weights.legs, 1.0)
    L = np.linalg.cholesky(C / w[:, None, None])
    residual = at.legs.residual - np.einsum("nij,knj->kni", J, d)
    if at.legs.J_explained.shape[2]:
        residual = residual - np.einsum("nij,kj->kni", at.legs.J_explained, s.d_shared[:, problem.explained])
    whiten = np.linalg.inv(L)
    r = (whiten @ residual[..., None])[..., 0]
    whitened = whiten @ J_all
    V = whitened @ cov @ np.swapaxes(whitened, -1, -2)
    v, vectors = np.linalg.eigh((V + np.swapaxes(V, -1, -2)) / 2)
    rest = np.where(used[:, None], 1 - v, 1.0)
    testable = rest > _TESTABLE
    rest = np.where(testable, rest, 1.0)
    z = np.einsum("knij,kni->knj", vectors, r) / rest  # the residual that the other data leave
    unsure = v / rest
    square = np.sum(np.where(testable, z**2 / (w[:, None] + unsure), 0.0), axis=2)
    freedom = testable.sum(axis=2)
    # Weight of each level without the leg itself: divide by the density that the level gave the leg.
    own = np.sum(np.where(testable, z**2 * rest, 0.0), axis=2)
    log_weight = profile.log_weight[:, None] + np.where(
        used, 0.5 * own + 0.5 * np.linalg.slogdet(C)[1] - 0.5 * np.sum(np.log(rest), axis=2), 0.0
    )
    weight = np.exp(log_weight - log_weight.max(axis=0))
    weight /= weight.sum(axis=0)
    p = np.where(freedom > 0, special.chdtrc(np.maximum(freedom, 1), square), 1.0)
    distance = np.sum(weight * square, axis=0)
    best = profile.best
    spread = np.where(testable[best], w[:, None] + unsure[best], 0.0)
    back = L[best] @ vectors[best]
    expected = np.sum(np.where(used[:, None], r[best] ** 2, 0.0), axis=1) + np.trace(V[best], axis1=1, axis2=2)
    return LegTests(
        p_value=surprise(np.sum(weight * p, axis=0), distance, freedom[best], problem.leg_known),
        difference=np.einsum("nij,nj->ni", back, z[best]),
        covariance=(back * spread[:, None, :]) @ np.swapaxes(back, 1, 2),
        whitened=r[best],
        square=distance,
        expected_square=expected / w,
    )


def leg_unknowns(problem: Problem, s: Solution) -> Array:
    """Return the covariance of what legs depend on, (K, N, 13 + k, 13 + k): wheels, both stops, and explanations."""
    i = problem.leg_stop
    own, cross = s.stop_blocks()
    with_stops = -s.Y @ s.cov[:, None]  # (K, P, 5, n): covariance of stop and shared unknowns
    shared = np.r_[WHEELS, problem.explained]
    at = np.concatenate([np.arange(FIRST_STOP.start), np.arange(LEG_UNKNOWNS, LEG_UNKNOWNS + len(shared) - 3)])
    size = LEG_UNKNOWNS + len(shared) - 3
    cov = np.empty((len(s.cov), len(i), size, size))
    cov[:, :, at[:, None], at] = s.cov[:, None][:, :, shared[:, None], shared]
    cov[:, :, FIRST_STOP, FIRST_STOP], cov[:, :, SECOND_STOP, SECOND_STOP] = own[:, i], own[:, i + 1]
    cov[:, :, FIRST_STOP, SECOND_STOP] = cross[:, i]
    cov[:, :, SECOND_STOP, FIRST_STOP] = np.swapaxes(cross[:, i], -1, -2)
    for part, stop in ((FIRST_STOP, i), (SECOND_STOP, i + 1)):
        rows = np.arange(part.start, part.stop)
        with_shared = with_stops[:, stop][..., shared]
        cov[:, :, rows[:, None], at] = with_shared
        cov[:, :, at[:, None], rows] = np.swapaxes(with_shared, -1, -2)
    return cov


class LegMemory:
    """Legs rejected in earlier rounds, remembered so that rounds end.

    A leg that is in bends the solution and the level of slip in its own direction, so that the others look alike; only
    with it out do they show how unlike they are. What is found with it out counts: a leg that returned twice stays. Nor
    do legs become alike again.
    """

    def __init__(self) -> None:
        self._used: Array | None = None
        self._returns: Ids = np.zeros(0, dtype=np.int64)
        self._spreads: list[float] = []

    @property
    def stay(self) -> Mask:
        """Legs that returned twice, (N,); empty before the first round."""
        return self._returns >= _RETURNS

    def settled(self, legs: Array) -> Array:
        """Return the legs' weights (0 or 1), those that returned twice kept."""
        used = legs > 0
        if self._used is not None:
            used |= self.stay
            self._returns = self._returns + (used & (self._used == 0))
        else:
            self._returns = np.zeros(len(legs), dtype=np.int64)
        self._used = used.astype(np.float64)
        return self._used

    def widest(self, spread: float) -> float:
        """Return how much the legs' variances spread: the most so far once that changed more than twice."""
        self._spreads.append(spread)
        changes = sum(a != b for a, b in pairwise(self._spreads))
        return max(self._spreads) if changes > 2 else spread


def flag_legs(
    problem: Problem, tests: LegTests, weights: Weights, significance: float, stay: Mask | None = None
) -> Array:
    """Return the legs' new weights: at most one more is left out at a time, and those that fit come back.

    Parameters
    ----------
    problem, tests, weights
        The legs, their tests, and which of them count now.
    significance
        Chance of a false alarm in a drive: each of its N legs is tested at ``significance / N``.
    stay : (N,) bool
        Legs that are not left out whatever their test, so that they do not take the place of one that can be; none of
        them if it is empty or not given.
    """
    limit = significance / leg_counts(problem)
    out = weights.legs == 0
    new = np.where(out & (tests.p_value >= limit) & problem.leg_known, 1.0, weights.legs)
    suspicious = ~out & (tests.p_value < limit)
    if stay is not None and stay.size:
        suspicious &= ~stay
    if np.any(suspicious) and np.sum(out) < most_rejected(len(out)):
        worst = np.argmin(np.where(suspicious, tests.p_value, np.inf))
        new[worst] = 0.0
    return np.asarray(new)


def most_rejected(legs: int) -> int:
    """Return how many legs may be left out at most: none where the others are too few to say what slip is usual."""
    return (legs - 2) // 2 if legs >= ENOUGH else 0


def leg_counts(problem: Problem) -> Array:
    """Return how many legs the drive of each leg has, (N,)."""
    drive = problem.drive[problem.leg_stop]
    return np.bincount(drive, minlength=problem.drives).astype(np.float64)[drive]


def flag_corners(problem: Problem, residual: Array, noise_scale: float, significance: float) -> tuple[Array, Ids]:
    """Return the corners' weights (0 or 1), and the stops where more than half do not fit (and so none is left out).

    Parameters
    ----------
    problem
        The corners.
    residual : (L, 2)
        Whitened residuals for noise scale 1.
    noise_scale
        Noise scale.
    significance
        Chance of a false alarm in a drive: each of its L corners is tested at ``significance / L``.
    """
    stop = problem.corner_stop
    drive = problem.drive[stop]
    count = np.maximum(np.bincount(drive, minlength=problem.drives), 1)
    limit = special.chdtri(2, significance / count)  # of each drive
    bad = np.sum(residual**2, axis=1) > noise_scale**2 * limit[drive]
    P = len(problem.drive)
    fraction = np.bincount(stop, weights=bad, minlength=P) / np.maximum(np.bincount(stop, minlength=P), 1)
    unreliable = np.flatnonzero(fraction > 0.5)
    bad &= ~np.isin(stop, unreliable)
    return np.where(bad, 0.0, 1.0), unreliable


def robust_scale(residual: Array) -> float:
    """Return a noise scale that a few wrong corners do not change: by the median of the squared distances."""
    return float(np.sqrt(np.median(np.sum(residual**2, axis=1)) / (2 * np.log(2.0))))


def first_leg_weights(problem: Problem, at: Linearization) -> tuple[Array, float]:
    """Return which legs to begin with (0 or 1), and a level of slip, from medians at the first state."""
    unit = leg_covariance(problem, at.legs.model, np.array(1.0)) if len(problem.leg_stop) else np.zeros((0, 3, 3))
    if not len(unit):
        return np.ones(0), 0.0
    square = np.einsum("ni,nij,nj->n", at.legs.residual, np.linalg.inv(unit), at.legs.residual)
    middle = float(np.median(square[problem.leg_known])) if np.any(problem.leg_known) else 0.0
    keep = problem.leg_known.astype(np.float64)
    far = np.argsort(-square)[: most_rejected(len(square))]
    keep[far] *= np.where(square[far] > 25 * middle, 0.0, 1.0)
    return keep, float(np.sqrt(middle / special.chdtri(3, 0.5)))
