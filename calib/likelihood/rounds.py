"""Rounds of the likelihood: its maximum for given noise, then the noise, then tests of legs and corners.

They go on until nothing changes any more.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents, extrapolated, largest_change
from boxcal.calib.likelihood.corner_floor import corner_floor, differs, with_floor
from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.explanation_equations import extended
from boxcal.calib.likelihood.fit import Fit, Known
from boxcal.calib.likelihood.leg_residuals import leg_equations
from boxcal.calib.likelihood.leg_spread import spread_of, spread_weights
from boxcal.calib.likelihood.levenberg_marquardt import (
    Linearization,
    Weights,
    leg_information,
    linearize,
    maximise,
    moved,
    picture_equations,
    reduced_picture_equations,
    reweighted,
    rewhitened,
)
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.outliers import (
    LegMemory,
    first_leg_weights,
    flag_corners,
    flag_legs,
    leg_tests,
    robust_scale,
)
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.slip_profile import SlipProfile, fixed_profile, quiet_slip, slip_profile
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.stop_elimination import solve_chain
from boxcal.calib.likelihood.systematic_errors import systematic_covariance
from boxcal.calib.likelihood.variance_components import (
    first_components,
    noise_scale,
    smallest_scale,
    updated,
)
from boxcal.target.arrays import Array, Ids

_ROUNDS = 25
_INNER = 12
_EXTRAPOLATED = 3
"""After this many values of the components they are extrapolated."""
_CLOSE, _LOOSE = 0.02, 0.1
"""Relative changes of a component at which its fixed point, and the rounds, end."""
_ROUGH = 1.0
"""Promised decrease of the sum of squares at which the first round ends: its components are a guess."""
_NEAR = 1e-2
"""The same of all others: what is found about their state takes the step that is left into account, and the last one is
taken. Where so little is promised, steps square the error: what is left after it is some 1e-9."""
_CLOSE_WEIGHT = 0.05
"""Change of a leg's weight at which it stays put."""
_FLOORS = 3
"""How often the floor of the corners' errors is looked for."""
_MOST_STEPS = 100
"""Steps of all rounds after which they end, settled or not."""
_LEAST_OF_QUIET = 0.05
"""Slip is first taken as at least this fraction of what equals the quantisation."""


def solve_likelihood(
    problem: Problem, state: State, options: EstimateOptions, known: Known | None = None, rounds: int = _ROUNDS
) -> Fit:
    """Return the solution from a first state, and from components and weights of a solution near by if there is one.

    Each round maximises the likelihood for fixed components and weights, then updates the components, then tests legs
    and corners. Rounds end when no weight changes and the components stay put.

    Parameters
    ----------
    problem, state, options
        The data, where to start, and what was asked for.
    known
        What is known of a solution near by.
    rounds
        How many there are at most.
    """
    at, weights, components = _beginning(problem, state, options, known)
    legs_seen = LegMemory()
    iterations, fresh, converged, floors = 0, True, False, _FLOORS
    near = None if known is None else known.profile
    for round_ in range(rounds):
        first = round_ == 0 and known is None
        at, steps = maximise(problem, at, components, weights, _ROUGH if first else _NEAR)
        iterations += steps
        corners, unreliable = weights.corners, np.zeros(0, dtype=np.int64)
        if options.find_faults:
            corners, unreliable = _corner_weights(problem, at, components, options, first)
        fresh = np.array_equal(corners, weights.corners)
        if first and not fresh:
            weights = replace(weights, corners=corners)
            at = reweighted(problem, at, corners)
            continue
        if known is None and options.noise_scale is None and floors > 0:
            floors -= 1
            other = _with_its_floor(problem, at, components, weights)
            if other is not None:
                (problem, at, components), fresh = other, False
        before = components
        components, scale_sigma, profile = _components(problem, at, components, weights, options, near)
        tests = leg_tests(problem, at, weights, profile)
        legs = weights.legs
        if options.find_faults:
            kept = legs_seen.settled(flag_legs(problem, tests, weights, options.false_alarm, legs_seen.stay))
            spread = legs_seen.widest(spread_of(tests.square[kept > 0]) if options.slip is None else 0.0)
            legs = spread_weights(tests.expected_square, kept, spread)
        same = fresh and bool(np.all(np.abs(legs - weights.legs) < _CLOSE_WEIGHT))
        near = profile
        at = at if np.array_equal(corners, weights.corners) else reweighted(problem, at, corners)
        weights = Weights(corners=corners, legs=legs)
        converged = same and _settled(before, components, scale_sigma, profile)
        if converged or iterations > _MOST_STEPS:
            break
    at, cov, squares = averaged_over_slip(problem, at, components, weights, profile, share=options.systematic_share)
    return Fit(
        problem=problem,
        options=options,
        at=at,
        cov=cov,
        components=components,
        noise_scale_sigma=scale_sigma,
        profile=profile,
        weights=weights,
        tests=tests,
        unreliable_stops=unreliable,
        iterations=iterations,
        converged=converged,
        cost=squares + float(np.sum((tests.whitened**2).T * (weights.legs > 0))),
    )


def averaged_over_slip(
    problem: Problem,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    profile: SlipProfile,
    *,
    share: float,
) -> tuple[Linearization, Array, float]:
    """Return the likelihood at the mean over slip, the covariance (n, n), and the sum of squares of the images.

    What smooth errors do is nearly all taken up by the poses of stops: it comes out right only with the linearization
    that the profile's solutions are of.
    """
    d_shared, d_stops, d_local, cov = profile.averaged()
    best = profile.solution.at(profile.best)
    cov = cov + systematic_covariance(problem, at, components, weights, best, share=share)
    at = linearize(problem, moved(problem, at.state, components, (d_shared, d_stops, d_local)), weights)
    return at, cov, picture_equations(problem, at, components)[1]


def _with_its_floor(
    problem: Problem, at: Linearization, components: VarianceComponents, weights: Weights
) -> tuple[Problem, Linearization, VarianceComponents] | None:
    """Return data, likelihood and components with the floor that the corners show; None if it is the one they have."""
    floor = corner_floor(problem, at)
    if not differs(problem, floor):
        return None
    wider = with_floor(problem, floor)
    return wider, rewhitened(problem, wider, at, weights), replace(components, corner_floor=floor)


def _beginning(
    problem: Problem, state: State, options: EstimateOptions, known: Known | None
) -> tuple[Linearization, Weights, VarianceComponents]:
    """Return where the rounds begin: robust guesses from medians, or what a solution near by ended with."""
    if known is not None:
        return linearize(problem, state, known.weights), known.weights, known.components
    everything = Weights(corners=np.ones(len(problem.uv_px)), legs=problem.leg_known.astype(np.float64))
    at = linearize(problem, state, everything)
    scale = options.noise_scale or max(robust_scale(at.residual_px), smallest_scale(problem))
    legs, slip = first_leg_weights(problem, at)
    weights = replace(everything, legs=legs) if options.find_faults else everything
    slip = max(slip if options.slip is None else options.slip, quiet_slip(problem, at) * _LEAST_OF_QUIET)
    return at, weights, first_components(problem, scale, slip)


def _corner_weights(
    problem: Problem, at: Linearization, components: VarianceComponents, options: EstimateOptions, first: bool
) -> tuple[Array, Ids]:
    """Return the corners' weights and the unreliable stops; in the first round the median estimates their noise."""
    scale = components.noise_scale
    if first and options.noise_scale is None:
        scale = max(robust_scale(at.residual_px), smallest_scale(problem))
    return flag_corners(problem, at.residual_px, scale, options.false_alarm)


def refit(fit: Fit, explanations: Sequence[Explanation]) -> Fit:
    """Return the solution with more explanations in the model, started from a solution without them."""
    problem, state = extended(fit.problem, fit.state, explanations)
    options = replace(fit.options, explanations=problem.explanations)
    return solve_likelihood(problem, state, options, fit)


def _components(  # noqa: PLR0917 - a solution and what it is of
    problem: Problem,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    options: EstimateOptions,
    near: SlipProfile | None,
) -> tuple[VarianceComponents, float, SlipProfile]:
    """Return all variance components from the likelihood about one state, and the profile of slip that belongs to them.

    Nothing is linearized again: the fixed point of the variances is iterated on the same normal equations. ``near`` is
    a profile nearby.
    """
    scale_sigma = 0.0
    steps: list[VarianceComponents] = [components]
    legs = leg_equations(problem, at.legs, leg_information(problem, at.legs, weights, np.array(components.slip)))
    for _ in range(_INNER):  # slip stays
        pictures, eliminated, _ = reduced_picture_equations(problem, at, components)
        solution = solve_chain(pictures.plus(legs), eliminated)
        joint = solution.joint_covariances()
        new = updated(problem, at, components, solution, joint)
        if options.noise_scale is None:
            scale, scale_sigma = noise_scale(problem, at, components, weights, solution, joint)
            new = replace(new, noise_scale=scale)
        change = largest_change(components, new)
        components = new
        if change < _CLOSE:
            break
        steps.append(new)
        if len(steps) == _EXTRAPOLATED:
            components = extrapolated(*steps)
            steps = [components]
    if options.slip is None and np.any(weights.legs > 0):
        profile = slip_profile(problem, at, components, weights, near)
    else:
        profile = fixed_profile(problem, at, components, weights)
    return replace(components, slip=profile.typical), scale_sigma, profile


def _settled(before: VarianceComponents, after: VarianceComponents, scale_sigma: float, profile: SlipProfile) -> bool:
    scale = abs(after.noise_scale / before.noise_scale - 1)
    slip = abs(np.log(after.slip / before.slip))
    return (
        scale < max(_CLOSE * scale_sigma / after.noise_scale, 1e-3)
        and bool(slip < max(_CLOSE, 0.2 * profile.sigma / profile.typical))
        and largest_change(replace(before, noise_scale=after.noise_scale), after) < _LOOSE
    )
