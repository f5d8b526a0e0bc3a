"""Solution from some of the stops, in one round from the estimate of all of them, or with its noise levels held."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import negative_wheels, step_of
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.initial_guess import CameraStart, first_states
from boxcal.calib.likelihood.levenberg_marquardt import Weights, maximise
from boxcal.calib.likelihood.observability import open_directions
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.calib.likelihood.rounds import averaged_over_slip, solve_likelihood
from boxcal.calib.likelihood.slip_profile import fixed_profile
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.state_of_estimate import state_of
from boxcal.calib.likelihood.summary import measured_scale_covariance, reported_cov
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_NEAR = 1e-3
"""Promised decrease of the sum of squares at which the search ends where one more step follows: 3 % of a sigma."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Start:
    """Weights and components of some stops, from the estimate of all of them."""

    weights: Weights
    components: VarianceComponents
    profile: None = None


def fit_part(
    drives: Sequence[Correspondences], kept: Sequence[tuple[int, ...]], found: Estimate, options: EstimateOptions
) -> Fit:
    """Return the solution from some stops of some drives; what was left out of the estimate of all stays left out.

    Parameters
    ----------
    drives
        What was seen and rolled.
    kept
        Numbers of the stops to use, for each drive: some of those that the estimate used.
    found
        The estimate from all stops, of the camera model that the options name.
    options
        As it was made with.

    Raises
    ------
    LinAlgError
        If these stops do not determine the calibration.
    """
    options = replace(options, find_faults=False)
    problem, start = _prepared(drives, kept, found, options)
    return solve_likelihood(problem, state_of(problem, found), options, start, rounds=1)


def part_with_noise_known(
    drives: Sequence[Correspondences],
    kept: Sequence[tuple[int, ...]],
    found: Estimate,
    options: EstimateOptions,
    cameras: CameraStart | None = None,
) -> tuple[State, Array]:
    """Return where some stops lead when noise levels are those of all stops, and the covariance (n, n) there.

    The covariance is that of the shared unknowns, the extrinsics' translation along the body's axes; what these stops
    do not determine is infinite.

    Parameters
    ----------
    drives, kept, found, options
        As for :func:`fit_part`.
    cameras
        Poses of the camera at these stops: the solution begins with them, not with the estimate from all stops.

    Raises
    ------
    CalibError
        If no wheels explain these stops.
    LinAlgError
        If these stops do not determine the calibration.
    """
    problem, start = _prepared(drives, kept, found, options)
    components, weights = start.components, start.weights
    states = [state_of(problem, found)] if cameras is None else first_states(problem, drives, cameras)
    solved = [maximise(problem, state, components, weights, _NEAR)[0] for state in states]
    forward = [at for at in solved if np.all(at.state.wheels > 0)]
    if not forward:
        raise negative_wheels(len(problem.drive), problem.leg_known)
    profiles = [fixed_profile(problem, at, components, weights) for at in forward]
    best = int(np.argmax([profile.log_evidence for profile in profiles]))
    at, cov, _ = averaged_over_slip(
        problem, forward[best], components, weights, profiles[best], share=options.systematic_share
    )
    _, unknown = open_directions(problem, at.state, profiles[best].solution.information[0])
    return at.state, reported_cov(cov, at.state, unknown) + measured_scale_covariance(problem, at.state, options)


def _prepared(
    drives: Sequence[Correspondences], kept: Sequence[tuple[int, ...]], found: Estimate, options: EstimateOptions
) -> tuple[Problem, _Start]:
    """Return the data of some stops, and their weights and components from the estimate of all."""
    problem = build_problem(drives, kept, options, step_of(drives, options))
    problem = with_floor(problem, found.components.corner_floor)
    weights = Weights(corners=_corners(problem, drives, found), legs=_legs(problem, found))
    return problem, _Start(weights=weights, components=found.components)


def _corners(problem: Problem, drives: Sequence[Correspondences], found: Estimate) -> Array:
    """Return the weights of the corners, (L,): 0 for those that were left out."""
    out = {(c.drive, c.stop, c.landmark_id) for c in found.flagged_corners}
    weights = np.ones(len(problem.uv_px))
    if out:
        for k, (d, j) in enumerate(zip(problem.drive.tolist(), problem.stop.tolist(), strict=True)):
            ids = drives[d].stops[j].landmark_ids.tolist()
            weights[problem.corner_starts[k] : problem.corner_starts[k + 1]] = [(d, j, i) not in out for i in ids]
    return weights


def _legs(problem: Problem, found: Estimate) -> Array:
    """Return the weights of the legs, (N,): 0 for those that pass over one that was left out."""
    weights = problem.leg_known.astype(np.float64)
    for n, i in enumerate(problem.leg_stop.tolist()):
        drive = found.drives[int(problem.drive[i])]
        first, last = (drive.stops.index(int(problem.stop[k])) for k in (i, i + 1))
        weights[n] *= bool(np.all(drive.leg_used[first:last]))
    return weights
