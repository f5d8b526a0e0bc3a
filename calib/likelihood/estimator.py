"""The estimator: from the four steps to the answer of maximum likelihood."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood.camera_selection import choose_camera, with_camera, without_further
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.fit import Fit, log_noise
from boxcal.calib.likelihood.initial_guess import CameraStart, camera_start, first_states
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import build_problem, with_kind
from boxcal.calib.likelihood.rounds import solve_likelihood
from boxcal.calib.likelihood.summary import summarise
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS
from boxcal.target.arrays import Mask
from boxcal.target.camera.camera_model import CameraKind

ASSUMED_SLIP = 1e-3
"""Slip (m/sqrt(m)) where there are too few legs to estimate it: a cautious value for small robots on hard floors."""
LEGS_FOR_SLIP = 3
"""Two legs fit any wheels and extrinsics exactly: nothing is left over to estimate slip from."""
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
    """Return the estimate that a solution amounts to, with notes on what was assumed and chosen for it.

    Raises
    ------
    CalibError
        If the equations without some stop or leg have no solution.
    """
    try:
        result = summarise(found, drives)
    except np.linalg.LinAlgError as error:
        raise unsolvable(len(found.problem.drive)) from error
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
        state = without_further(known) if kind is CameraKind.RADIAL else known.state
        problem, state = with_kind(known.problem, kind), with_camera(known.problem, state, kind)
        return solve_likelihood(problem, state, replace(known.options, lens=kind), known)

    try:
        found, scores = choose_camera(solve_with, drives[0].image_size)
    except np.linalg.LinAlgError as error:
        raise unsolvable(sum(len(k) for k in cameras.kept)) from error
    return replace(found, camera_scores=scores)


def negative_wheels(stops: int, leg_known: Mask) -> CalibError:
    """Return the error that says that wheels of negative size fit some stops best; legs (N,) known or not."""
    few = "" if np.all(leg_known) else f", and the wheels' travel between them is known {np.sum(leg_known)} times"
    return CalibError(
        f"{stops} stops fit wheels of negative size best: the moves do not tell forward from backward{few}, or wheels "
        "and pictures do not fit together",
        remedy="add stops, and check that the wheels' readings count alike all along and that the box stood still",
    )


def unsolvable(stops: int) -> CalibError:
    """Return the error that says that the equations of some stops are singular."""
    return CalibError(
        f"the equations of {stops} stops cannot be solved: a stop is held by neither images nor wheels",
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
        raise unsolvable(count) from error
    forward = [found for found in fits if np.all(found.state.wheels > 0)]
    if not forward:
        raise negative_wheels(count, problem.leg_known)
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
