"""Estimates from the first P stops of a drive, P = 3, 4, ...: the paper's figures 8 and 9."""

from dataclasses import dataclass, replace

import numpy as np
from runs import difference, estimate_sigma, estimate_values, step_values

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Growth:
    """Errors over the number of stops, in the order of ``PARAMETERS`` (px, m, rad); NaN where a procedure gave up.

    Attributes
    ----------
    title
        Of the drive.
    truth : (14,)
    stops : (n,)
        P.
    closed, likelihood, sigma : (n, 14)
        Errors of the paper's procedure and ours, and what ours says about itself.
    singular : (n, 2)
        sigma5/sigma4 and sigma4/sigma3 of the paper's step 4.
    rms_px
        Mean distance of all corners from where the paper's procedure predicts them (root mean square).
    """

    title: str
    truth: Array
    stops: Array
    closed: Array
    likelihood: Array
    sigma: Array
    singular: Array
    rms_px: float


def grow(title: str, seen: Correspondences, truth: Array, options: EstimateOptions, stops: list[int]) -> Growth:
    """Return the estimates of both procedures from the first P stops of one drive."""
    closed, likelihood, sigma = (np.full((len(stops), 14), np.nan) for _ in range(3))
    singular, rms_px = np.full((len(stops), 2), np.nan), np.nan
    for row, P in enumerate(stops):
        first = replace(seen, stops=seen.stops[:P])
        try:
            steps = solve_four_steps(first)
            closed[row] = difference(step_values(steps), truth)
            singular[row] = steps.mounting.null_ratio, steps.mounting.rank_ratio
            rms_px = steps.camera.rms_px
        except CalibError as error:
            print(f"{title}, P = {P}, paper's procedure: {error}")
        try:
            found = estimate([first], None, options)
        except CalibError as error:
            print(f"{title}, P = {P}, likelihood: {error}")
            continue
        likelihood[row], sigma[row] = difference(estimate_values(found), truth), estimate_sigma(found)
    return Growth(
        title=title,
        truth=truth,
        stops=np.array(stops),
        closed=closed,
        likelihood=likelihood,
        sigma=sigma,
        singular=singular,
        rms_px=rms_px,
    )
