"""The estimator: from the four steps to the answer of maximum likelihood."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.initial_guess import CameraStart, camera_start, first_states
from boxcal.calib.likelihood.levenberg_marquardt import Levels, Weights, linearise, maximise
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.outliers import (
    first_leg_weights,
    flag_corners,
    flag_legs,
    leg_tests,
    robust_factor,
)
from boxcal.calib.likelihood.problem import Problem, State, build_problem, moved
from boxcal.calib.likelihood.summary import summarise
from boxcal.calib.likelihood.variance_components import (
    fixed_profile,
    pixel_factor,
    quiet_slip,
    slip_profile,
    smallest_factor,
)
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Ids

MIN_STOPS = 3
ASSUMED_SLIP = 1e-3
"""Slip (m/sqrt(m)) where there are too few legs to estimate it: a careful figure for small robots on hard floors."""
LEGS_FOR_SLIP = 3
"""Two legs fit any wheels and mounting exactly: nothing is left over to tell slip from."""
_ROUNDS = 25
_CLOSE = 0.02
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
    found = fit(drives, start, options)
    result = summarise(found, drives)
    if found.options.slip is not None and (options is None or options.slip is None):
        legs = len(found.problem.leg_stop)
        note = (
            f"{legs} legs do not show how much the wheels slip: {1e3 * ASSUMED_SLIP:g} mm/sqrt(m) is assumed; add stops"
        )
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
        raise CalibError("no drives were given: at least one is needed")
    return fit_cameras(drives, camera_start(drives, start), options, step_of(drives, options))


def fit_cameras(drives: Sequence[Correspondences], cameras: CameraStart, options: EstimateOptions, step: float) -> Fit:
    """Return the solution from known camera poses and a known encoder step (rad)."""
    count = sum(len(k) for k in cameras.kept)
    if count < MIN_STOPS:
        raise CalibError(f"{count} usable stops, at least {MIN_STOPS} are needed; add stops")
    problem = build_problem(drives, cameras.kept, options, step)
    if options.slip is None and 0 < len(problem.leg_stop) < LEGS_FOR_SLIP:
        options = replace(options, slip=ASSUMED_SLIP)
    states = first_states(problem, drives, cameras, options.lens)
    try:
        fits = [solve_likelihood(problem, state, options) for state in states]
    except np.linalg.LinAlgError as error:
        raise CalibError(
            f"the equations of {count} stops cannot be solved ({error}): a stop is held by neither images nor wheels; "
            "leave out stops that show few tags"
        ) from error
    forward = [found for found in fits if np.all(found.at.state.wheels > 0)]
    if not forward:
        raise CalibError(
            f"{count} stops fit wheels of negative size best: the moves do not tell forward from backward; add stops"
        )
    return max(forward, key=_log_evidence)


def _log_evidence(fit: Fit) -> float:
    """Return how well a solution explains the data; what it had to leave out counts against it."""
    corners, legs = fit.weights.corners, fit.weights.legs
    left_out = _CORNER_LEFT_OUT * np.sum(corners == 0) + _LEG_LEFT_OUT * np.sum(legs == 0)
    return float(fit.profile.log_evidence - 2 * np.sum(corners) * np.log(fit.levels.pixel_factor) - left_out)


def step_of(drives: Sequence[Correspondences], options: EstimateOptions) -> float:
    """Return the encoders' step, rad: given, or the coarsest of any wheel of any drive; 0 if there is none."""
    if options.encoder_step is not None:
        return options.encoder_step
    return max(step for drive in drives for step in drive.wheels.encoder_steps)


def solve_likelihood(problem: Problem, state: State, options: EstimateOptions) -> Fit:
    """Return the solution from a first state.

    Each round maximises the likelihood for fixed levels and weights, then updates the levels, then tests legs and
    corners. Rounds end when no weight changes and the levels stay put.
    """
    N = len(problem.leg_stop)
    everything = Weights(corners=np.ones(len(problem.uv_px)), legs=np.ones(N))
    at = linearise(problem, state, everything)
    smallest = smallest_factor(problem)
    factor = options.pixel_factor or max(robust_factor(at.residual_px), smallest)
    legs, slip = first_leg_weights(problem, at)
    weights = replace(everything, legs=legs) if options.find_faults else everything
    slip = max(slip if options.slip is None else options.slip, quiet_slip(problem, at) * 0.05)
    levels = Levels(pixel_factor=factor, slip=slip)
    converged = False
    hopeless: Ids = np.zeros(0, dtype=np.int64)
    iterations, factor_sigma, fresh = 0, 0.0, True
    for round_ in range(_ROUNDS):
        at, steps = maximise(problem, at if fresh else at.state, levels, weights)
        iterations += steps
        new = weights
        if options.find_faults:
            spread = (
                max(robust_factor(at.residual_px), smallest) if round_ == 0 and options.pixel_factor is None else factor
            )
            corners, hopeless = flag_corners(problem, at.residual_px, spread, options.false_alarm)
            new = replace(new, corners=corners)
        if round_ == 0 and not np.array_equal(new.corners, weights.corners):
            weights, fresh = new, False
            continue
        if options.slip is None and N:
            profile = slip_profile(problem, at, levels.pixel_factor, weights)
        else:
            profile = fixed_profile(problem, at, levels, weights)
        if options.pixel_factor is None:
            factor, factor_sigma = pixel_factor(at, levels.pixel_factor, weights, profile, smallest)
        tests = leg_tests(problem, at, weights, profile)
        if options.find_faults:
            new = replace(new, legs=flag_legs(problem, tests, weights, options.false_alarm))
        fresh = np.array_equal(new.corners, weights.corners)
        same = fresh and np.array_equal(new.legs, weights.legs)
        settled = abs(factor / levels.pixel_factor - 1) < max(_CLOSE * factor_sigma / factor, 1e-6) and (
            abs(np.log(profile.typical / levels.slip)) < max(_CLOSE, 0.2 * profile.sigma / profile.typical)
        )
        weights, levels = new, Levels(pixel_factor=factor, slip=profile.typical)
        converged = same and settled
        if converged:
            break
    d_shared, d_stops, cov = profile.averaged()
    at = linearise(problem, moved(problem, at.state, d_shared, d_stops), weights)
    cost = float(at.corner_squares.sum() / factor**2 + at.prior_squares + np.sum((tests.whitened**2).T * weights.legs))
    return Fit(
        problem=problem,
        options=options,
        at=at,
        cov=cov,
        levels=levels,
        factor_sigma=factor_sigma,
        profile=profile,
        weights=weights,
        tests=tests,
        hopeless=hopeless,
        iterations=iterations,
        converged=converged,
        cost=cost,
    )
