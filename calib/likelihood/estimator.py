"""The estimator: from the four steps to the answer of maximum likelihood."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood.camera_selection import choose_camera, with_camera
from boxcal.calib.likelihood.components import VarianceComponents, extrapolated, largest_change
from boxcal.calib.likelihood.corner_floor import corner_floor, differs, with_floor
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.fit import Fit, Known, log_noise
from boxcal.calib.likelihood.initial_guess import CameraStart, camera_start, first_states
from boxcal.calib.likelihood.leg_spread import spread_of, spread_weights
from boxcal.calib.likelihood.levenberg_marquardt import (
    CONVERGED,
    Linearization,
    Weights,
    equations,
    leg_information,
    linearize,
    maximise,
    moved,
    picture_equations,
)
from boxcal.calib.likelihood.normal_equations import solve
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.outliers import (
    LegMemory,
    first_leg_weights,
    flag_corners,
    flag_legs,
    leg_tests,
    robust_scale,
)
from boxcal.calib.likelihood.problem import Problem, build_problem, with_kind
from boxcal.calib.likelihood.score_test import extended
from boxcal.calib.likelihood.slip_profile import SlipProfile, fixed_profile, quiet_slip, slip_profile
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.summary import summarise
from boxcal.calib.likelihood.systematic_errors import systematic_covariance
from boxcal.calib.likelihood.variance_components import (
    first_components,
    noise_scale,
    smallest_scale,
    updated,
)
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import CameraKind

MIN_STOPS = 3
ASSUMED_SLIP = 1e-3
"""Slip (m/sqrt(m)) where there are too few legs to estimate it: a careful figure for small robots on hard floors."""
LEGS_FOR_SLIP = 3
"""Two legs fit any wheels and mounting exactly: nothing is left over to tell slip from."""
_ROUNDS = 25
_INNER = 12
_EXTRAPOLATED = 3
"""After so many values of the components they are extrapolated."""
_CLOSE, _LOOSE = 0.02, 0.1
"""Relative changes of a component at which its fixed point, and the rounds, end."""
_ROUGH = 1.0
"""Promised decrease of the sum of squares at which the first round ends: its components are a guess."""
_CLOSE_WEIGHT = 0.05
"""Change of a leg's weight at which it stays put."""
_FLOORS = 3
"""How often the floor of the corners' errors is found anew."""
_MOST_STEPS = 100
"""Steps of all rounds after which they end, settled or not."""
_LEAST_OF_QUIET = 0.05
"""Slip is first taken as at least this share of what equals the quantisation."""
_CORNER_LEFT_OUT, _LEG_LEFT_OUT = 12.0, 10.0
"""What leaving out one of them costs, in log likelihood: about where the tests draw the line."""


def estimate(
    drives: Sequence[Correspondences],
    start: Sequence[FourSteps] | FourSteps | None = None,
    options: EstimateOptions | None = None,
) -> Estimate:
    """Return the calibration of one robot by maximum likelihood, from one or several of its drives.

    Corners are weighed by their covariance, wheels by the noise that they propagate through the path driven; both
    levels come from the data. Legs and corners that noise does not explain are named and left out.

    Parameters
    ----------
    drives
        Drives of one robot, each with its own floor tilt; legs of different drives are not connected.
    start
        The four steps of each drive, or of the first, or None: only their camera poses are used.
    options
        Unknowns, priors and tests.

    Raises
    ------
    CalibError
        If the drives do not determine the calibration: what is missing.
    """
    return reported(fit(drives, start, options), drives, options)


def reported(found: Fit, drives: Sequence[Correspondences], options: EstimateOptions | None) -> Estimate:
    """Return the estimate that a solution amounts to, with notes on what was assumed and chosen for it."""
    result = summarise(found, drives)
    if found.options.slip is not None and (options is None or options.slip is None):
        legs = len(found.problem.leg_stop)
        note = (
            f"{legs} legs do not show how much the wheels slip: {1e3 * ASSUMED_SLIP:g} mm/sqrt(m) is assumed; add stops"
        )
        result = replace(result, notes=(*result.notes, note))
    if found.camera_scores:
        note = f"camera model: {found.camera_scores[0].kind} (chosen by the images)"
        result = replace(result, notes=(*result.notes, note))
    return result


def fit(
    drives: Sequence[Correspondences],
    start: Sequence[FourSteps] | FourSteps | None = None,
    options: EstimateOptions | None = None,
) -> Fit:
    """Return the solution in the solver's own terms; see :func:`estimate`."""
    options = options or EstimateOptions()
    if not drives:
        raise CalibError("no drives were given", needed="at least one is needed")
    cameras, step = camera_start(drives, start), step_of(drives, options)
    if options.lens is not None:
        return fit_cameras(drives, cameras, options, step)

    def solve_with(kind: CameraKind, known: Fit | None) -> Fit:
        told = replace(options, lens=kind)
        if known is None:
            return fit_cameras(drives, cameras, told, step)
        problem, state = with_kind(known.problem, kind), with_camera(known.problem, known.state, kind)
        return solve_likelihood(problem, state, replace(known.options, lens=kind), known)

    try:
        found, scores = choose_camera(solve_with, drives[0].image_size)
    except np.linalg.LinAlgError as error:
        raise unsolvable(sum(len(k) for k in cameras.kept), error) from error
    return replace(found, camera_scores=scores)


def negative_wheels(stops: int) -> CalibError:
    """Return the error that says that wheels of negative size fit some stops best."""
    return CalibError(
        f"{stops} stops fit wheels of negative size best: the moves do not tell forward from backward",
        remedy="add stops",
    )


def unsolvable(stops: int, error: Exception) -> CalibError:
    """Return the error that says that the equations of some stops are singular."""
    return CalibError(
        f"the equations of {stops} stops cannot be solved ({error}): a stop is held by neither images nor wheels",
        remedy="leave out stops that show few tags",
    )


def fit_cameras(drives: Sequence[Correspondences], cameras: CameraStart, options: EstimateOptions, step: float) -> Fit:
    """Return the solution from known camera poses and a known encoder step (rad)."""
    count = sum(len(k) for k in cameras.kept)
    if count < MIN_STOPS:
        raise CalibError(f"{count} usable stops, at least {MIN_STOPS} are needed; add stops")
    problem = build_problem(drives, cameras.kept, options, step)
    if options.slip is None and 0 < len(problem.leg_stop) < LEGS_FOR_SLIP:
        options = replace(options, slip=ASSUMED_SLIP)
    states = first_states(problem, drives, cameras)
    try:
        fits = [solve_likelihood(problem, state, options) for state in states]
    except np.linalg.LinAlgError as error:
        raise unsolvable(count, error) from error
    forward = [found for found in fits if np.all(found.state.wheels > 0)]
    if not forward:
        raise negative_wheels(count)
    return max(forward, key=_log_evidence)


def _log_evidence(fit: Fit) -> float:
    """Return how well a solution explains the data; what it had to leave out counts against it."""
    corners, legs = fit.weights.corners, fit.weights.legs
    left_out = _CORNER_LEFT_OUT * np.sum(corners == 0) + _LEG_LEFT_OUT * np.sum(legs == 0)
    return float(fit.profile.log_evidence - log_noise(fit) - left_out)


def step_of(drives: Sequence[Correspondences], options: EstimateOptions) -> float:
    """Return the encoders' step, rad: given, or the coarsest of any wheel of any drive; 0 if there is none."""
    if options.encoder_step is not None:
        return options.encoder_step
    return max(step for drive in drives for step in drive.wheels.encoder_steps)


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
        close = _ROUGH if first else CONVERGED
        at, steps = maximise(problem, at if fresh else at.state, components, weights, close)
        iterations += steps
        corners, unreliable = weights.corners, np.zeros(0, dtype=np.int64)
        if options.find_faults:
            corners, unreliable = _corner_weights(problem, at, components, options, first)
        fresh = np.array_equal(corners, weights.corners)
        if first and not fresh:
            weights = replace(weights, corners=corners)
            continue
        if known is None and options.noise_scale is None and floors > 0:
            other = _with_its_floor(problem, at, components, replace(weights, corners=corners))
            if other is not None:
                (problem, at, components), floors, fresh = other, floors - 1, False
        before = components
        components, scale_sigma, profile = _components(problem, at, components, weights, options, near)
        tests = leg_tests(problem, at, weights, profile)
        legs = weights.legs
        if options.find_faults:
            kept = legs_seen.settled(flag_legs(problem, tests, weights, options.false_alarm, legs_seen.stay))
            spread = legs_seen.widest(spread_of(tests.square[kept > 0]) if options.slip is None else 0.0)
            legs = spread_weights(tests.expected_square, kept, spread)
        same = fresh and bool(np.all(np.abs(legs - weights.legs) < _CLOSE_WEIGHT))
        near = profile if np.array_equal(legs > 0, weights.legs > 0) else None
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
    """Return the likelihood at the mean over slip, the covariance (n, n), and the sum of squares of the pictures."""
    d_shared, d_stops, d_local, cov = profile.averaged()
    at = linearize(problem, moved(problem, at.state, components, (d_shared, d_stops, d_local)), weights)
    best = profile.solution.at(profile.best)
    cov = cov + systematic_covariance(problem, at, components, weights, best, share=share)
    return at, cov, picture_equations(problem, at, components)[1]


def _with_its_floor(
    problem: Problem, at: Linearization, components: VarianceComponents, weights: Weights
) -> tuple[Problem, Linearization, VarianceComponents] | None:
    """Return data, likelihood and components with the floor that the corners show; None if it is the one they have."""
    floor = corner_floor(problem, at)
    if not differs(problem, floor):
        return None
    problem = with_floor(problem, floor)
    return problem, linearize(problem, at.state, weights), replace(components, corner_floor=floor)


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
    """Return the corners' weights and the unreliable stops; in the first round their noise is told by the median."""
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
    a profile nearby, with the same legs.
    """
    scale_sigma = 0.0
    steps: list[VarianceComponents] = [components]
    for _ in range(_INNER):
        information = leg_information(problem, at.legs, weights, np.array(components.slip))
        normal, _ = equations(problem, at, components, information)
        solution = solve(normal)
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
