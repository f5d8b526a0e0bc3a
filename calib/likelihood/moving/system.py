"""Equations of stops and frames on the move, for many levels of slip and jitter at once."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.information_inverse import determinant
from boxcal.calib.likelihood.leg_residuals import (
    LegResiduals,
    leg_covariance,
    leg_equations,
    leg_squares,
    with_legs,
)
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights, reduced_picture_equations
from boxcal.calib.likelihood.moving.weave import Woven
from boxcal.calib.likelihood.normal_equations import Eliminated, Normal
from boxcal.calib.likelihood.priors import shared_values
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import READINGS
from boxcal.calib.likelihood.stop_elimination import EliminatedChain, Solution, eliminate_chain, solve_shared
from boxcal.target.arrays import Array, Mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scan:
    """The likelihood about one state at K levels of slip and jitter; no solutions, which cost several times as much.

    Attributes
    ----------
    slip, jitter_s : (K,), m/sqrt(m) and s
    log_likelihood : (K,)
        Logarithm of the restricted likelihood, up to a constant; -inf where rounding is seen to hide it.
    system, chain
        The equations, and these with the stops eliminated, too.
    a, c : (K, n) and (K, P, 5)
        Right-hand sides before that, of the shared unknowns and of the stops.
    """

    slip: Array
    jitter_s: Array
    log_likelihood: Array
    system: "System"
    chain: EliminatedChain
    a: Array
    c: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levels:
    """Solutions about one state at K levels of slip and jitter.

    Attributes
    ----------
    slip, jitter_s : (K,), m/sqrt(m) and s
    log_likelihood : (K,)
        Logarithm of the restricted likelihood, up to a constant; -inf where rounding hides it.
    solution
        Of the normal equations, at those levels.
    local_sigma : (P, 4)
        Standard deviations of the local unknowns: the unit of the solution's.
    """

    slip: Array
    jitter_s: Array
    log_likelihood: Array
    solution: Solution
    local_sigma: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class System:
    """Equations about one state at K levels of slip and jitter, the local unknowns eliminated.

    Attributes
    ----------
    problem, legs
        Stops and frames, and the legs about the state.
    eliminated
        How to find the local unknowns again.
    without_legs
        What of the equations is not the legs'.
    leg_information : (K, N, 3, 3)
        Weight of the legs in them.
    squares, log_noise : (K,)
        Weighted sum of squares at the state, and logarithm of the determinant of what legs and readings err by.
    local_sigma : (P, 4)
        Standard deviations of the local unknowns.
    slip, jitter_s : (K,)
        The levels, m/sqrt(m) and s.
    """

    problem: Problem
    legs: LegResiduals
    eliminated: Eliminated
    without_legs: Normal
    leg_information: Array
    squares: Array
    log_noise: Array
    local_sigma: Array
    slip: Array
    jitter_s: Array

    @property
    def normal(self) -> Normal:
        """All equations."""
        return self.without_legs.plus(leg_equations(self.problem, self.legs, self.leg_information))


def system(  # noqa: PLR0917 - a state and what holds there
    problem: Problem,
    woven: Woven,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    local_sigma: Array,
    slip: Array,
    jitter_s: Array,
) -> System:
    """Return the equations of stops and frames about a state, at levels of slip and jitter (K,) each.

    Parameters
    ----------
    problem, woven, at, weights
        Stops and frames, and the likelihood about a state; weights of frames' corners hold what their noise is.
    components
        Of the stops.
    local_sigma : (P, 4)
        Standard deviations of the local unknowns.
    slip, jitter_s
        The levels.
    """
    reduced, eliminated, squares = reduced_picture_equations(problem, at, components, local_sigma)
    allowed = np.array([woven.allowed.get(name, 0.0) for name in problem.names])
    weight = np.divide(allowed, problem.prior**2, out=np.zeros_like(allowed), where=allowed != 0)  # of the whole value
    reduced = replace(reduced, a=reduced.a - weight)
    squares += float(weight @ (allowed + 2 * shared_values(problem, at.state)))
    C = leg_covariance(problem, at.legs.model, slip)
    inverse, log_det = backend().inverses(C)
    information = inverse * weights.legs[:, None, None]
    readings, reading_squares, log_readings = _readings(problem, woven, at, jitter_s)
    without_legs = replace(reduced, D=reduced.D + readings[0], c=reduced.c + readings[1])
    return System(
        problem=problem,
        legs=at.legs,
        without_legs=without_legs,
        eliminated=eliminated,
        leg_information=information,
        squares=squares + leg_squares(at.legs, information) + reading_squares,
        log_noise=np.sum(log_det * (weights.legs > 0), axis=-1) + log_readings,
        local_sigma=local_sigma,
        slip=slip,
        jitter_s=jitter_s,
    )


def scanned(s: System) -> Scan:
    """Return the likelihood of stops and frames about a state, at the levels of slip and jitter of its equations."""
    equations = with_legs(s.problem, s.without_legs, s.legs, s.leg_information)
    c = equations.right[..., -1].copy()
    chain = eliminate_chain(equations)
    log_det, decrease = determinant(chain.information, chain.right)
    left = s.squares - (decrease + chain.decrease + s.eliminated.decrease)
    log_det = log_det + chain.log_det + s.eliminated.log_det
    return Scan(
        slip=s.slip,
        jitter_s=s.jitter_s,
        log_likelihood=np.where(left > 0, -0.5 * (s.log_noise + log_det + left), -np.inf),
        system=s,
        chain=chain,
        a=equations.a,
        c=c,
    )


def solutions(scan: Scan, kept: Mask) -> Levels:
    """Return the solutions at some of the levels of a scan, (K,); their likelihoods are -inf where rounding hides them.

    A scan sees no more of rounding than squares below nought.
    """
    s, chain = scan.system, scan.chain.some(kept)
    solution = solve_shared(chain, s.eliminated)
    accurate = _rounding(scan.a[kept], scan.c[kept], s.eliminated, solution) < _MOST_ROUNDING
    return Levels(
        slip=scan.slip[kept],
        jitter_s=scan.jitter_s[kept],
        log_likelihood=np.where(accurate, scan.log_likelihood[kept], -np.inf),
        solution=solution,
        local_sigma=s.local_sigma,
    )


def solved_at(s: System) -> Levels:
    """Return the solutions of stops and frames about a state, at the levels of slip and jitter of its equations."""
    return solutions(scanned(s), np.ones(len(s.slip), dtype=np.bool_))


_MOST_ROUNDING = 0.1


def _rounding(a: Array, c: Array, eliminated: Eliminated, solution: Solution) -> Array:
    """Return by how much rounding may spoil the sums of squares, (K,): their decrease by factors, and by the step.

    Frames near to each other and little slip make pivots that lose many digits. ``a`` (K, n) and ``c`` (K, P, 5) are
    the equations' right-hand sides.
    """
    step = np.einsum("...i,...i->...", a, solution.d_shared) + np.einsum("...pi,...pi->...", c, solution.d_stops)
    return np.asarray(np.abs(step + eliminated.decrease - solution.decrease))


def _readings(
    problem: Problem, woven: Woven, at: Linearization, jitter_s: Array
) -> tuple[tuple[Array, Array], Array, Array]:
    """Return what jitter changes of the readings' equations, (K, P, 5, 5) and (K, P, 5), their squares and log det.

    A frame's error in time moves both wheels' readings at once. In units of a reading's own error their covariance is
    that of the encoder and of the interpolation, and jitter's; at stops it stays the identity.
    """
    unit = problem.step / np.sqrt(12)
    rates, bend = woven.rates / unit, woven.bend / unit
    K, P = len(jitter_s), len(woven.frame)
    cov = np.tile(np.eye(2), (K, P, 1, 1))
    cov += jitter_s[:, None, None, None] ** 2 * (rates[:, :, None] * rates[:, None, :])
    cov += (bend**2)[:, :, None] * np.eye(2)
    inverse, log_det = backend().inverses(cov)
    more = inverse - np.eye(2)
    e = at.state.encoder_errors
    D, c = np.zeros((K, P, 5, 5)), np.zeros((K, P, 5))
    D[:, :, READINGS, READINGS] = more
    c[:, :, READINGS] = -np.einsum("kpij,pj->kpi", more, e)
    return (D, c), np.einsum("pi,kpij,pj->k", e, more, e), np.sum(log_det, axis=1)
