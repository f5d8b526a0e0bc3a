"""The estimator: from the four steps to the answer of maximum likelihood."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.errors import CalibError
from calib.estimate.faults import (
    first_leg_weights,
    flag_corners,
    flag_legs,
    leg_tests,
    robust_factor,
)
from calib.estimate.fit import Fit
from calib.estimate.levels import fixed_profile, pixel_factor, quiet_slip, slip_profile
from calib.estimate.model import Problem, State, build_problem, moved
from calib.estimate.options import EstimateOptions
from calib.estimate.result import Estimate
from calib.estimate.solver import Levels, Weights, linearise, maximise
from calib.estimate.start import camera_start, first_state
from calib.estimate.summary import summarise
from calib.four_steps import FourSteps
from detect.correspondences import Correspondences
from detect.encoder import encoder_step
from detect.wheels import Ids

MIN_STOPS = 3
_ROUNDS = 25
_CLOSE = 0.02


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
    return summarise(fit(drives, start, options), drives)


def fit(
    drives: Sequence[Correspondences],
    start: Sequence[FourSteps] | FourSteps | None = None,
    options: EstimateOptions | None = None,
    *,
    kept: Sequence[tuple[int, ...]] | None = None,
) -> Fit:
    """Return the solution in the solver's own terms; see :func:`estimate`.

    Parameters
    ----------
    drives, start, options
        As for :func:`estimate`.
    kept
        Stops to use, for each drive, of those that the camera step kept.
    """
    options = options or EstimateOptions()
    if not drives:
        raise CalibError("no drives were given: at least one is needed")
    cameras = camera_start(drives, start)
    if kept is not None:
        cameras = cameras.only(kept)
    if sum(len(k) for k in cameras.kept) < MIN_STOPS:
        raise CalibError(
            f"{sum(len(k) for k in cameras.kept)} usable stops, at least {MIN_STOPS} are needed; add stops"
        )
    step = find_step(drives) if options.encoder_step is None else options.encoder_step
    problem = build_problem(drives, cameras.kept, options, step)
    return solve_likelihood(problem, first_state(problem, drives, cameras, options.lens), options)


def find_step(drives: Sequence[Correspondences]) -> float:
    """Return the encoders' step, rad: the coarsest that any wheel of any drive shows, 0 if there is none."""
    return max(encoder_step(phi) for d in drives for phi in (d.wheels.phi_R, d.wheels.phi_L))


def solve_likelihood(problem: Problem, state: State, options: EstimateOptions) -> Fit:
    """Return the solution from a first state.

    Each round maximises the likelihood for fixed levels and weights, then updates the levels, then tests legs and
    corners. Rounds end when no weight changes and the levels stay put.
    """
    N = len(problem.leg_stop)
    everything = Weights(corners=np.ones(len(problem.uv_px)), legs=np.ones(N))
    at = linearise(problem, state, everything)
    factor = options.pixel_factor or robust_factor(at.residual_px)
    legs, slip = first_leg_weights(problem, at)
    weights = replace(everything, legs=legs) if options.find_faults else everything
    slip = max(slip if options.slip is None else options.slip, quiet_slip(problem, at) * 0.05)
    levels = Levels(pixel_factor=factor, slip=slip)
    converged = False
    hopeless: Ids = np.zeros(0, dtype=np.int64)
    iterations, factor_sigma = 0, 0.0
    for round_ in range(_ROUNDS):
        at, steps = maximise(problem, at.state, levels, weights)
        iterations += steps
        new = weights
        if options.find_faults:
            spread = robust_factor(at.residual_px) if round_ == 0 and options.pixel_factor is None else factor
            corners, hopeless = flag_corners(problem, at.residual_px, spread, options.false_alarm)
            new = replace(new, corners=corners)
        if round_ == 0 and not np.array_equal(new.corners, weights.corners):
            weights = new
            continue
        if options.slip is None and N:
            profile = slip_profile(problem, at, levels.pixel_factor, weights)
        else:
            profile = fixed_profile(problem, at, levels, weights)
        if options.pixel_factor is None:
            factor, factor_sigma = pixel_factor(at, levels.pixel_factor, weights, profile)
        tests = leg_tests(problem, at, weights, profile)
        if options.find_faults:
            new = replace(new, legs=flag_legs(problem, tests, weights, options.false_alarm))
        same = np.array_equal(new.corners, weights.corners) and np.array_equal(new.legs, weights.legs)
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
