"""Variance components from the data, by restricted maximum likelihood (REML), at one linearization.

A random effect of standard deviation s that the data determine to a posterior variance V in units of s^2 has used up
``1 - V`` of a degree of freedom: ``s^2 <- sum of squares / sum of (1 - V)`` is the fixed point (Schall 1991, Biometrika
78:719, DOI 10.1093/biomet/78.4.719). The weight of a weak prior stands in for data that do not determine it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.priors import shared_values
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.stop_elimination import Solution
from boxcal.calib.likelihood.target_deformation import HAND_MADE
from boxcal.target.arrays import Array

SMALLEST_PX = 1e-5
"""No corner is taken as better than this (px, standard deviation): exact data end here."""
USUAL = {"lean": float(np.radians(0.03)), "height": 1e-4, "growth": 0.003}
"""Where the estimate starts, and where it stays if the data carry no information: rad, m, px."""
_LEAST = 1e-4
"""Smallest standard deviation, as a fraction of the usual one: so small that it moves nothing, yet can grow again."""
_BEST_TARGET = 0.02
"""The same for the target: no print is better than some 6 um, 3e-5 and 0.003 deg."""
_AS_CAREFUL = 0.7
"""Print and places of the faces are taken as at least this fraction of what the target's other components say."""
_PRIOR_WEIGHT = 1e-4
"""Weight of the usual variance, in degrees of freedom."""
_SHARED_WEIGHT = 1.0
"""The same for what the target's other components say of one."""


def first_components(problem: Problem, noise_scale: float, slip: float) -> VarianceComponents:
    """Return variance components to start from."""
    floor = 0.0 if problem.rigid_floor else 1.0
    return VarianceComponents(
        noise_scale=noise_scale,
        slip=slip,
        lean=floor * USUAL["lean"],
        height=floor * USUAL["height"],
        growth=USUAL["growth"] if problem.target.names else 0.0,
        target={name: HAND_MADE[name] for name in sorted(set(problem.component) - {""})},
    )


def updated(
    problem: Problem, at: Linearization, components: VarianceComponents, solution: Solution, joint: Array
) -> VarianceComponents:
    """Return the variance components of stops and target after one step of the fixed point.

    Parameters
    ----------
    problem, at
        The likelihood about a state.
    components, solution
        Components so far, and the solution of the equations that they make there.
    joint : (P, n + 5, n + 5)
        The solution's joint covariances.
    """
    s = components.local_sigma
    values = np.column_stack([at.state.lean, at.state.growth])
    unit = np.divide(values, s, out=np.zeros_like(values), where=s > 0) + solution.d_local
    left = 1 - solution.local_variances(joint)
    found: dict[str, float] = {}
    for name, columns in (("lean", [0, 1]), ("height", [2]), ("growth", list(range(3, len(s))))):
        sigma = float(s[columns[0]])
        if sigma > 0:
            square, freedom = float(np.sum(unit[:, columns] ** 2)), max(float(np.sum(left[:, columns])), 0.0)
            estimate = _fixed_point(sigma, square, freedom, USUAL[name], _PRIOR_WEIGHT)
            found[name] = max(estimate, _LEAST * USUAL[name])
    value = shared_values(problem, at.state) + solution.d_shared
    variance = np.diag(solution.cov)
    target = target_components(problem.component, problem.unit, components.target, value, variance)
    return replace(components, **found, target=target)


def target_components(
    component: Sequence[str], unit: Array, before: dict[str, float], value: Array, variance: Array
) -> dict[str, float]:
    """Return the target's variance components after one step.

    Some determine little by themselves (two print scales, of which one is the unit of length): each is drawn, with a
    weight of one degree of freedom, towards what it would be on a target made as carefully as the others say. That care
    is the mean over all components of the logarithm of what they are of a hand-made box's.

    Parameters
    ----------
    component, unit : n, (n,)
        The component that each unknown belongs to, and its standard deviation over the component's.
    before
        Components so far.
    value, variance : (n,)
        The unknowns, and their variances after the data.
    """
    own: dict[str, tuple[float, float]] = {}
    of = np.array(component)
    for name, sigma in before.items():
        rows = np.flatnonzero(of == name)
        prior = np.square(sigma * unit[rows])
        freedom = max(float(np.sum(1 - variance[rows] / prior)), 0.0)
        own[name] = float(np.sum(value[rows] ** 2 / prior)), freedom
    weight = sum(freedom for _, freedom in own.values()) + _PRIOR_WEIGHT
    care = max(
        _BEST_TARGET,
        np.exp(sum(freedom * np.log(before[name] / HAND_MADE[name]) for name, (_, freedom) in own.items()) / weight),
    )
    found = {}
    for name, (square, freedom) in own.items():
        estimate = _fixed_point(before[name], square, freedom, float(care) * HAND_MADE[name], _SHARED_WEIGHT)
        # Size and height of the box as a whole leave no residuals: few values determine them, none well.
        least = _AS_CAREFUL * min(float(care), 1.0) if name in {"print", "place"} else 0.0
        found[name] = max(estimate, max(_BEST_TARGET, least) * HAND_MADE[name])
    return found


def _fixed_point(sigma: float, square: float, freedom: float, usual: float, weight: float) -> float:
    return float(np.sqrt((sigma**2 * square + weight * usual**2) / (freedom + weight)))


def smallest_scale(problem: Problem) -> float:
    """Return the noise scale below which corners would be better than ``SMALLEST_PX``."""
    return SMALLEST_PX / problem.sigma_px


def noise_scale(  # noqa: PLR0917 - a solution and what it is of
    problem: Problem,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    solution: Solution,
    joint: Array,
) -> tuple[float, float]:
    """Return the noise scale, at least the smallest, and its standard deviation.

    The corners' sum of squares over their number less the degrees of freedom that the solution takes from them.
    """
    freedom = 2 * float(np.count_nonzero(weights.corners)) - taken(at, components, solution, joint)
    squares = squares_left(at, components, solution)
    if freedom <= 0:
        return components.noise_scale, np.inf
    scale = max(float(np.sqrt(squares / freedom)), smallest_scale(problem))
    return scale, scale / float(np.sqrt(2 * freedom))


def squares_left(at: Linearization, components: VarianceComponents, solution: Solution) -> float:
    """Return the corners' sum of squares (noise scale 1) after the solution's step, to second order."""
    normal, local, s = at.corner_normal, at.corner_local, components.local_sigma
    x, y, z = solution.d_shared, solution.d_stops, solution.d_local * s
    linear = normal.a @ x + np.sum(normal.c * y) + np.sum(local.c * z)
    y_, z_ = y[..., None], z[..., None]
    square = (
        x @ normal.A @ x
        + 2 * np.sum(x @ normal.B * y)
        + np.sum((normal.D @ y_ + 2 * local.by_chain @ z_)[..., 0] * y)
        + np.sum((local.D @ z_)[..., 0] * z)
        + 2 * np.sum(x @ local.by_shared * z)
    )
    return max(float(at.corner_squares.sum() - 2 * linear + square), 0.0)


def taken(at: Linearization, components: VarianceComponents, solution: Solution, joint: Array) -> float:
    """Return the degrees of freedom that the solution takes from the corners."""
    normal, local, s = at.corner_normal, at.corner_local, components.local_sigma
    e = solution.eliminated
    n = solution.cov.shape[-1]
    K = np.concatenate([e.by_shared, e.by_chain], axis=2)
    with_local = -K @ joint  # (P, q, n + 5)
    own_local = e.inverse - with_local @ np.swapaxes(K, 1, 2)
    across = np.concatenate([local.by_shared, local.by_chain], axis=1) * s  # (P, n + 5, q)
    total = (
        np.sum(solution.cov * normal.A)
        + 2 * np.sum(joint[:, :n, n:] * normal.B)
        + np.sum(joint[:, n:, n:] * normal.D)
        + np.sum(own_local * local.D * (s[:, None] * s))
        + 2 * np.sum(np.swapaxes(with_local, 1, 2) * across)
    )
    return float(total) / components.noise_scale**2
