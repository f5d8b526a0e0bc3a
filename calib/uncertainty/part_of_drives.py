"""Solution from some of the stops, in one round from the estimate of all of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import solve_likelihood, step_of
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.levenberg_marquardt import Weights
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.calib.likelihood.state_of_estimate import state_of
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


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
    problem = build_problem(drives, kept, options, step_of(drives, options))
    problem = with_floor(problem, found.components.corner_floor)
    weights = Weights(corners=_corners(problem, drives, found), legs=_legs(problem, found))
    start = _Start(weights=weights, components=found.components)
    return solve_likelihood(problem, state_of(problem, found), options, start, rounds=1)


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
