"""Levenberg-Marquardt on the likelihood, for given noise levels and given weights of corners and legs."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.normal_equations import Normal, solve
from boxcal.calib.likelihood.problem import Problem, State, moved
from boxcal.calib.likelihood.residuals import (
    LegResiduals,
    combined,
    corner_equations,
    corner_residuals,
    leg_covariance,
    leg_equations,
    leg_residuals,
    prior_equations,
)
from boxcal.target.arrays import Array

CONVERGED = 1e-6
"""A step that promises less than this (in units of the weighted sum of squares) is the last: 1e-3 sigma."""
MAX_ITERATIONS = 60
_FIRST_DAMPING = 1e-12
_SLIGHT_DAMPING = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levels:
    """Noise levels.

    Attributes
    ----------
    pixel_factor
        Multiplies the corners' standard deviations.
    slip : m/sqrt(m)
        Of each wheel.
    """

    pixel_factor: float
    slip: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Weights:
    """Which data count.

    Attributes
    ----------
    corners : (L,)
        Weight of each corner, 0 leaves it out.
    legs : (N,)
        Weight of each leg.
    """

    corners: Array
    legs: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearised:
    """The likelihood about one state.

    Attributes
    ----------
    state
        Where.
    corner_normal, corner_squares
        Normal equations of the corners and each stop's weighted sum of squares, both for pixel factor 1.
    residual_px : (L, 2)
        Corners' residuals, whitened by their own covariance.
    legs
        Residuals of the legs.
    prior, prior_squares
        Normal equations and sum of squares of the priors and the readings.
    valid
        Whether all landmarks lie in front of the camera.
    """

    state: State
    corner_normal: Normal
    corner_squares: Array
    residual_px: Array
    legs: LegResiduals
    prior: Normal
    prior_squares: float
    valid: bool


def linearise(problem: Problem, state: State, weights: Weights) -> Linearised:
    """Return the likelihood's normal equations at a state."""
    corners = corner_residuals(problem, state)
    normal, squares = corner_equations(corners, problem.corner_starts, weights.corners)
    prior, prior_squares = prior_equations(problem, state)
    return Linearised(
        state=state,
        corner_normal=normal,
        corner_squares=squares,
        residual_px=corners.residual,
        legs=leg_residuals(problem, state),
        prior=prior,
        prior_squares=prior_squares,
        valid=corners.valid,
    )


def leg_information(problem: Problem, legs: LegResiduals, weights: Weights, slip: Array) -> Array:
    """Return the legs' information matrices, (..., N, 3, 3), for levels of slip (...)."""
    return np.asarray(np.linalg.inv(leg_covariance(problem, legs.model, slip)) * weights.legs[:, None, None])


def equations(problem: Problem, at: Linearised, pixel_factor: float, information: Array) -> tuple[Normal, Array]:
    """Return all normal equations and the weighted sums of squares (...) for leg information (..., N, 3, 3)."""
    legs, squares = leg_equations(problem, at.legs, information)
    total = at.corner_squares.sum() / pixel_factor**2 + squares + at.prior_squares
    return combined(at.corner_normal, pixel_factor, legs, at.prior), np.asarray(total)


def maximise(
    problem: Problem, start: State | Linearised, levels: Levels, weights: Weights, tolerance: float = CONVERGED
) -> tuple[Linearised, int]:
    """Return the likelihood linearised at its maximum, and how many steps that took.

    The legs' covariances are those at the start: what depends on the state in them is updated with the levels.

    Parameters
    ----------
    problem, start
        The data and where to start: a state, or the likelihood linearised there with the same weights of corners.
    levels, weights
        Noise levels and weights, held.
    tolerance
        Promised decrease of the weighted sum of squares at which to stop.
    """
    at = start if isinstance(start, Linearised) else linearise(problem, start, weights)
    information = leg_information(problem, at.legs, weights, np.array(levels.slip))
    normal, cost = equations(problem, at, levels.pixel_factor, information)
    lam, growth, steps = _FIRST_DAMPING, 2.0, 0
    while steps < MAX_ITERATIONS:
        steps += 1
        step = solve(normal.damped(lam))
        trial = linearise(problem, moved(problem, at.state, step.d_shared, step.d_stops), weights)
        trial_normal, trial_cost = equations(problem, trial, levels.pixel_factor, information)
        promised = float(step.decrease)
        if trial.valid and trial_cost <= cost * (1 + 1e-12):
            # Nielsen's damping: less where the promise was kept, more where it was not.
            kept = float(cost - trial_cost) / max(promised, 1e-30)
            at, normal, cost = trial, trial_normal, trial_cost
            lam, growth = max(lam * max(1 / 10, 1 - (2 * min(kept, 1.0) - 1) ** 3), _FIRST_DAMPING), 2.0
            if promised < tolerance and lam < _SLIGHT_DAMPING:
                break
        elif promised < tolerance:
            break  # rounding hides what is left
        else:
            lam, growth = max(lam, _SLIGHT_DAMPING) * growth, 2 * growth
            if lam > 1e10:
                break
    return at, steps
