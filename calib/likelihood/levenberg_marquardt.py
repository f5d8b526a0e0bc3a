"""Levenberg-Marquardt on the likelihood, for given variance components and given weights of corners and legs."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.two_by_two import inverses, products
from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_residuals import Corners, corner_equations, corner_residuals
from boxcal.calib.likelihood.explanation import Columns, explained_columns
from boxcal.calib.likelihood.leg_residuals import (
    LegResiduals,
    leg_covariance,
    leg_equations,
    leg_residuals,
    leg_squares,
)
from boxcal.calib.likelihood.normal_equations import Eliminated, Local, Normal
from boxcal.calib.likelihood.priors import add_priors
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State, retract
from boxcal.calib.likelihood.stop_elimination import solve
from boxcal.target.arrays import Array

CONVERGED = 1e-6
"""A step that promises less than this (in units of the weighted sum of squares) is the last: 1e-3 sigma."""
MAX_ITERATIONS = 60
_FIRST_DAMPING = 1e-12
_SLIGHT_DAMPING, _MOST_DAMPING = 1e-6, 1e10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Weights:
    """Weights of corners and legs; zero leaves one out.

    Attributes
    ----------
    corners : (L,)
        Weight of each corner, 0 rejects it.
    legs : (N,)
        Weight of each leg: 0 rejects it, less than 1 takes it as noisier than others.
    """

    corners: Array
    legs: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearization:
    """The likelihood about one state.

    Attributes
    ----------
    state
        Where.
    columns
        Of the explanations that are part of the model.
    corners
        Residuals of the corners and their derivatives.
    corner_normal, corner_local, corner_squares
        Normal equations of the corners, those of the local unknowns, and each stop's weighted sum of squares, all for
        noise scale 1.
    legs
        Residuals of the legs.
    """

    state: State
    columns: Columns
    corners: Corners
    corner_normal: Normal
    corner_local: Local
    corner_squares: Array
    legs: LegResiduals

    @property
    def residual_px(self) -> Array:
        """Corners' residuals, whitened by their own covariance, (L, 2)."""
        return self.corners.residual

    @property
    def valid(self) -> bool:
        """Whether all landmarks lie in front of the camera."""
        return self.corners.valid


def linearize(problem: Problem, state: State, weights: Weights) -> Linearization:
    """Return the likelihood's normal equations at a state."""
    columns = explained_columns(problem, state)
    corners = corner_residuals(problem, state, columns)
    normal, local, squares = corner_equations(problem, corners, weights.corners)
    return Linearization(
        state=state,
        columns=columns,
        corners=corners,
        corner_normal=normal,
        corner_local=local,
        corner_squares=squares,
        legs=leg_residuals(problem, state, columns),
    )


def reweighted(problem: Problem, at: Linearization, corners: Array) -> Linearization:
    """Return the likelihood about the same state with other weights of the corners, (L,)."""
    return _with_corners(problem, at, at.corners, corners)


def rewhitened(problem: Problem, other: Problem, at: Linearization, weights: Weights) -> Linearization:
    """Return the likelihood about the same state with other covariances of the corners, those of ``other``."""
    turn = other.whiten @ inverses(problem.whiten)
    corners = replace(
        at.corners,
        residual=products(turn, at.corners.residual),
        jacobian=turn @ at.corners.jacobian,
    )
    return _with_corners(other, at, corners, weights.corners)


def _with_corners(problem: Problem, at: Linearization, corners: Corners, weight: Array) -> Linearization:
    normal, local, squares = corner_equations(problem, corners, weight)
    return replace(at, corners=corners, corner_normal=normal, corner_local=local, corner_squares=squares)


def leg_information(problem: Problem, legs: LegResiduals, weights: Weights, slip: Array) -> Array:
    """Return the legs' information matrices, (..., N, 3, 3), for slip (...)."""
    inverse, _ = backend().inverses(leg_covariance(problem, legs.model, slip))
    return np.asarray(inverse * weights.legs[:, None, None])


def picture_equations(
    problem: Problem, at: Linearization, components: VarianceComponents, local_sigma: Array | None = None
) -> tuple[Normal, float]:
    """Return the normal equations of corners and priors, and their sum of squares.

    The local unknowns stand in units of their standard deviations: where one is zero, nothing is left of it. These are
    the components' at every stop, or ``local_sigma`` (P, 4).
    """
    w = components.noise_scale**-2
    corners, local = at.corner_normal, at.corner_local
    s, unit = _local_units(at, components, local_sigma)
    own = Local(
        D=w * local.D * (s[:, :, None] * s[:, None, :]) + np.eye(s.shape[1]),
        by_shared=w * local.by_shared * s[:, None, :],
        by_chain=w * local.by_chain * s[:, None, :],
        c=w * local.c * s - unit,
    )
    normal = Normal(
        A=w * corners.A, B=w * corners.B, D=w * corners.D, E=corners.E, a=w * corners.a, c=w * corners.c, local=own
    )
    prior_squares = add_priors(problem, at.state, components.prior_sigma(problem), normal)
    return normal, float(w * at.corner_squares.sum() + prior_squares + np.sum(unit**2))


def reduced_picture_equations(
    problem: Problem, at: Linearization, components: VarianceComponents, local_sigma: Array | None = None
) -> tuple[Normal, Eliminated, float]:
    """Return the equations of corners and priors without their local unknowns, how to find these, and the squares.

    What :func:`picture_equations` and :func:`boxcal.calib.likelihood.normal_equations.eliminate` give, in one pass.
    """
    w = components.noise_scale**-2
    corners, local = at.corner_normal, at.corner_local
    s, unit = _local_units(at, components, local_sigma)
    (A, right, D, a), found, decrease, log_det = backend().without_local(
        (corners.A, corners.B, corners.D, corners.a, corners.c),
        (local.D, local.by_shared, local.by_chain, local.c),
        w,
        s,
        unit,
    )
    n = len(a)
    normal = Normal(A=A, B=np.swapaxes(right[..., :n], 1, 2), D=D, E=corners.E, a=a, c=right[..., n])
    prior_squares = add_priors(problem, at.state, components.prior_sigma(problem), normal)
    inverse, by_shared, by_chain, c = found
    eliminated = Eliminated(
        inverse=inverse, by_shared=by_shared, by_chain=by_chain, c=c, decrease=decrease, log_det=log_det
    )
    return normal, eliminated, float(w * at.corner_squares.sum() + prior_squares + np.sum(unit**2))


def _local_units(at: Linearization, components: VarianceComponents, local_sigma: Array | None) -> tuple[Array, Array]:
    """Return the standard deviations of the local unknowns, (P, q), and their values in these."""
    values = np.column_stack([at.state.lean, at.state.growth])
    s = np.broadcast_to(components.local_sigma if local_sigma is None else local_sigma, values.shape)
    return s, np.divide(values, s, out=np.zeros_like(values), where=s > 0)


def equations(
    problem: Problem, at: Linearization, components: VarianceComponents, information: Array
) -> tuple[Normal, Array]:
    """Return all normal equations and the weighted sums of squares (...) for leg information (..., N, 3, 3)."""
    pictures, squares = picture_equations(problem, at, components)
    legs = leg_equations(problem, at.legs, information)
    return pictures.plus(legs), np.asarray(leg_squares(at.legs, information) + squares)


def moved(problem: Problem, state: State, components: VarianceComponents, step: tuple[Array, Array, Array]) -> State:
    """Return the state after a step: shared unknowns, chain, and local unknowns in units of their sigma."""
    d_shared, d_stops, d_local = step
    return retract(problem, state, d_shared, d_stops, d_local * components.local_sigma)


def maximise(
    problem: Problem,
    start: State | Linearization,
    components: VarianceComponents,
    weights: Weights,
    tolerance: float = CONVERGED,
) -> tuple[Linearization, int]:
    """Return the likelihood linearized at its maximum, and how many steps that took.

    The legs' covariances are those at the start: what depends on the state in them is updated with the components.

    Parameters
    ----------
    problem, start
        The data and where to start: a state, or the likelihood linearized there with the same weights of corners.
    components, weights
        Variance components and weights, held.
    tolerance
        Promised decrease of the weighted sum of squares at which to stop.
    """
    at = start if isinstance(start, Linearization) else linearize(problem, start, weights)
    if components.freezes(at.state):
        at = linearize(problem, components.rigid_where_zero(at.state), weights)
    information = leg_information(problem, at.legs, weights, np.array(components.slip))
    normal, cost = equations(problem, at, components, information)
    lam, growth, steps = _FIRST_DAMPING, 2.0, 0
    while steps < MAX_ITERATIONS:
        steps += 1
        step = solve(normal.damped(lam))
        promised = float(step.decrease)
        if promised < tolerance and (lam < _SLIGHT_DAMPING or lam > _MOST_DAMPING):
            break
        state = moved(problem, at.state, components, (step.d_shared, step.d_stops, step.d_local))
        trial = linearize(problem, state, weights)
        trial_normal, trial_cost = equations(problem, trial, components, information)
        if trial.valid and trial_cost <= cost * (1 + 1e-12):
            # Nielsen's damping: less where the promise was kept, more where it was not.
            kept = float(cost - trial_cost) / max(promised, 1e-30)
            at, normal, cost = trial, trial_normal, trial_cost
            lam, growth = max(lam * max(1 / 10, 1 - (2 * min(kept, 1.0) - 1) ** 3), _FIRST_DAMPING), 2.0
        elif promised < tolerance:
            break  # rounding hides what is left
        else:
            lam, growth = max(lam, _SLIGHT_DAMPING) * growth, 2 * growth
            if lam > _MOST_DAMPING:
                break
    return at, steps
