"""Noise levels from the data: the corners' pixel factor and the wheels' slip, each with its own uncertainty.

Both are variance components, estimated by restricted likelihood: what the parameters and the poses have adapted to the
noise is taken off. A drive of 5 stops leaves only about 6 degrees of freedom for slip, so a single value would claim
too much: the restricted likelihood is evaluated over all levels that the data allow, with a prior flat in the logarithm
of the legs' variance (the quantisation's part included; Jeffreys' prior for a variance) and a little weight on no slip
at all. What is reported is the mean over them.
"""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.levenberg_marquardt import Levels, Linearised, Weights, equations
from boxcal.calib.likelihood.normal_equations import Solution, solve
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.residuals import leg_covariance
from boxcal.target.arrays import Array

LARGEST_SLIP = 0.3
"""Levels of slip beyond this (m/sqrt(m)) are not considered: a wheel that slips by a third of a metre in one."""
SMALLEST_SLIP = 1e-8
"""What counts as no slip at all where the encoder has no step (m/sqrt(m)); exact data end here."""
SMALLEST_PX = 1e-5
"""No corner is taken as better than this (px, standard deviation): exact data end here."""
_QUIET = 0.02
"""Slip of nought is taken as this share of what equals the quantisation, so that covariances stay invertible."""
_NO_SLIP = 3.0
"""Prior weight of no slip at all, in units of one in the logarithm of the variance.

A compromise from simulations with 5 stops: less makes the sigmas of wheels that never slip too large (by 5 % at 1),
more makes those of a slip too small to be told from the cameras' noise (0.1 mm/sqrt(m)) too small in rare runs.
"""
_POINTS = 17
_ZOOMS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SlipProfile:
    """The restricted likelihood over levels of slip.

    Attributes
    ----------
    slip : (K,), m/sqrt(m)
        Levels, ascending.
    log_weight : (K,)
        Logarithm of their probability.
    log_evidence
        Logarithm of the restricted likelihood's mean over the levels, up to a constant of the data and the pixel
        factor: compares solutions of the same data.
    solution
        Solutions of the normal equations at those levels, about the same state.
    information : (K, N, 3, 3)
        Of the legs.
    """

    slip: Array
    log_weight: Array
    log_evidence: float
    solution: Solution
    information: Array

    @property
    def weight(self) -> Array:
        """Probability of each level, (K,); sums to 1."""
        return np.asarray(np.exp(self.log_weight))

    @property
    def mean(self) -> float:
        """Mean level, m/sqrt(m)."""
        return float(self.weight @ self.slip)

    @property
    def typical(self) -> float:
        """Root of the mean variance, m/sqrt(m)."""
        return float(np.sqrt(self.weight @ self.slip**2))

    @property
    def sigma(self) -> float:
        """Standard deviation of the level, m/sqrt(m)."""
        return float(np.sqrt(self.weight @ (self.slip - self.mean) ** 2))

    @property
    def mode(self) -> float:
        """Most probable level, m/sqrt(m)."""
        return float(self.slip[int(np.argmax(self.weight))])

    def averaged(self) -> tuple[Array, Array, Array]:
        """Return the steps of shared unknowns (n,) and stops (P, 5), and the covariance (n, n), mean over the levels.

        The covariance holds what the solutions at different levels differ by.
        """
        w, s = self.weight, self.solution
        d_shared = w @ s.d_shared
        off = s.d_shared - d_shared
        cov = np.tensordot(w, s.cov, 1) + np.einsum("k,ki,kj->ij", w, off, off)
        return d_shared, np.tensordot(w, s.d_stops, 1), cov


def quiet_slip(problem: Problem, at: Linearised) -> float:
    """Return the slip that disturbs a leg as much as the quantisation of the readings at its ends does, m/sqrt(m)."""
    rolled = at.legs.model.rolled
    if not rolled.size or not np.any(rolled > 0):
        return 10 * SMALLEST_SLIP
    distance = float(np.median(rolled[rolled > 0]))
    step = problem.step * float(np.mean(np.abs(at.state.wheels[:2])))
    return max(float(np.sqrt(step**2 / 6 / distance)), 10 * SMALLEST_SLIP)


def least_slip(problem: Problem, at: Linearised) -> float:
    """Return what stands for no slip at all, m/sqrt(m): so little that it changes nothing, yet can be inverted."""
    return max(_QUIET * quiet_slip(problem, at), SMALLEST_SLIP)


def slip_profile(problem: Problem, at: Linearised, pixel_factor: float, weights: Weights) -> SlipProfile:
    """Return the restricted likelihood over the levels of slip that the data allow.

    Starts with all levels and closes in on those that are probable.
    """
    quiet = quiet_slip(problem, at)
    low, high = 2 * np.log(quiet), np.log(LARGEST_SLIP**2 + quiet**2)
    u = np.linspace(low, high, _POINTS + 4)
    for zoom in range(_ZOOMS + 1):
        step = u[1] - u[0]
        prior = np.append(_NO_SLIP / step, np.ones(len(u)))
        profile = _profile(problem, at, (pixel_factor, _slip(np.append(low, u), quiet)), weights, prior)
        slipping = profile.weight[1:] / profile.weight[1:].sum()
        spread = float(np.sqrt(slipping @ (u - slipping @ u) ** 2))
        if zoom == _ZOOMS or step < 0.6 * spread:
            break
        likely = np.flatnonzero(slipping > 1e-5 * slipping.max())
        u = np.linspace(max(low, u[likely[0]] - step), min(high, u[likely[-1]] + step), _POINTS)
    return profile


def fixed_profile(problem: Problem, at: Linearised, levels: Levels, weights: Weights) -> SlipProfile:
    """Return a profile of one given level."""
    quiet = least_slip(problem, at)
    return _profile(problem, at, (levels.pixel_factor, np.array([max(levels.slip, quiet)])), weights, np.ones(1))


def _slip(u: Array, quiet: float) -> Array:
    return np.sqrt(np.maximum(np.exp(u) - quiet**2, max(_QUIET * quiet, SMALLEST_SLIP) ** 2))


def _profile(
    problem: Problem, at: Linearised, levels: tuple[float, Array], weights: Weights, prior: Array
) -> SlipProfile:
    factor, slip = levels
    cov = leg_covariance(problem, at.legs.model, slip)
    information = np.linalg.inv(cov) * weights.legs[:, None, None]
    normal, squares = equations(problem, at, factor, information)
    solution = solve(normal)
    log_noise = np.sum(np.linalg.slogdet(cov)[1] * (weights.legs > 0), axis=-1)
    log_weight = np.log(prior) - 0.5 * (log_noise + solution.log_det + squares - solution.decrease)
    largest = float(log_weight.max())
    log_evidence = largest + float(np.log(np.sum(np.exp(log_weight - largest))))
    return SlipProfile(
        slip=slip,
        log_weight=log_weight - log_evidence,
        log_evidence=log_evidence - float(np.log(prior.sum())),
        solution=solution,
        information=information,
    )


def smallest_factor(problem: Problem) -> float:
    """Return the pixel factor below which corners would be better than ``SMALLEST_PX``."""
    return SMALLEST_PX * float(np.sqrt(np.mean(np.linalg.det(problem.whiten))))


def pixel_factor(
    at: Linearised, current: float, weights: Weights, profile: SlipProfile, smallest: float
) -> tuple[float, float]:
    """Return the pixel factor, at least the smallest, and its standard deviation.

    The corners' sum of squares over their number less the degrees of freedom that the solution takes from them.
    """
    best = int(np.argmax(profile.weight))
    s, normal = profile.solution, at.corner_normal
    own, _ = s.stop_blocks()
    with_stops = -s.cov[best] @ np.swapaxes(s.Y[best], -1, -2)
    taken = (
        np.sum(s.cov[best] * normal.A) + 2 * np.sum(with_stops * normal.B) + np.sum(own[best] * normal.D)
    ) / current**2
    freedom = 2 * float(np.count_nonzero(weights.corners)) - float(taken)
    if freedom <= 0:
        return current, np.inf
    factor = max(float(np.sqrt(at.corner_squares.sum() / freedom)), smallest)
    return factor, factor / float(np.sqrt(2 * freedom))
