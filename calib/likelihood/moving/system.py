"""Equations of stops and frames on the move, for many levels of slip and jitter at once."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.moving.noise import FrameNoise, local_sigmas
from boxcal.calib.likelihood.moving.weave import Woven
from boxcal.calib.likelihood.normal_equations import Local, Normal, Solution, eliminate, solve_chain
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.residuals import leg_covariance, leg_equations, prior_equations
from boxcal.calib.likelihood.state import READINGS
from boxcal.target.arrays import Array


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


def solved_at(  # noqa: PLR0917 - a state and what holds there
    problem: Problem,
    woven: Woven,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    noise: FrameNoise,
    slip: Array,
    jitter_s: Array,
) -> Levels:
    """Return the solutions of stops and frames about a state, at levels of slip and jitter (K,) each.

    Parameters
    ----------
    problem, woven, at, weights
        Stops and frames, and the likelihood about a state; weights of frames' corners hold what their noise is.
    components
        Of the stops.
    noise
        Of the frames: sway is taken from it.
    slip, jitter_s
        The levels.
    """
    sigma = local_sigmas(components, noise, len(woven.frame), woven.moving)
    pictures, squares = _pictures(problem, at, components, sigma)
    reduced, eliminated = eliminate(pictures)
    C = leg_covariance(problem, at.legs.model, slip)
    information = np.linalg.inv(C) * weights.legs[:, None, None]
    legs, leg_squares = leg_equations(problem, at.legs, information)
    readings, reading_squares, log_readings = _readings(problem, woven, at, jitter_s)
    total = reduced.plus(legs)
    total = replace(total, D=total.D + readings[0], c=total.c + readings[1])
    solution = solve_chain(total, eliminated)
    log_noise = np.sum(np.linalg.slogdet(C)[1] * (weights.legs > 0), axis=-1) + log_readings
    left = squares + leg_squares + reading_squares - solution.decrease
    return Levels(
        slip=slip,
        jitter_s=jitter_s,
        log_likelihood=np.where(left > 0, -0.5 * (log_noise + solution.log_det + left), -np.inf),
        solution=solution,
        local_sigma=sigma,
    )


def _pictures(
    problem: Problem, at: Linearization, components: VarianceComponents, sigma: Array
) -> tuple[Normal, float]:
    """Return the equations of corners and priors, local unknowns in units of ``sigma`` (P, 4), and their squares."""
    w, corners, local = components.noise_scale**-2, at.corner_normal, at.corner_local
    values = np.column_stack([at.state.lean, at.state.growth])
    unit = np.divide(values, sigma, out=np.zeros_like(values), where=sigma > 0)
    across = w * sigma[:, None, :]
    prior, prior_squares = prior_equations(problem, at.state, components.prior_sigma(problem))
    both = Normal(
        A=w * corners.A + prior.A,
        B=w * corners.B + prior.B,
        D=w * corners.D + prior.D,
        E=corners.E,
        a=w * corners.a + prior.a,
        c=w * corners.c + prior.c,
        local=Local(
            D=across * sigma[:, :, None] * local.D + np.eye(sigma.shape[1]),
            by_shared=across * local.by_shared,
            by_chain=across * local.by_chain,
            c=w * sigma * local.c - unit,
        ),
    )
    return both, float(w * at.corner_squares.sum() + prior_squares + np.sum(unit**2))


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
    more = np.linalg.inv(cov) - np.eye(2)
    e = at.state.encoder_errors
    D, c = np.zeros((K, P, 5, 5)), np.zeros((K, P, 5))
    D[:, :, READINGS, READINGS] = more
    c[:, :, READINGS] = -np.einsum("kpij,pj->kpi", more, e)
    return (D, c), np.einsum("pi,kpij,pj->k", e, more, e), np.sum(np.linalg.slogdet(cov)[1], axis=1)
