"""Convergence over stops: estimates from a drive's first stops only (the paper's figures 8 and 9)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood import Estimate, EstimateOptions, estimate
from boxcal.calib.likelihood.estimator import MIN_STOPS, reported
from boxcal.calib.uncertainty.part_of_drives import fit_part
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

STEPS = 4
"""How many numbers of stops are tried of a long drive: estimates of all would cost more than the calibration itself."""
FROM_THE_END = 6
"""Number of stops from which on one answer is near that of all stops."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvergencePoint:
    """The estimate from the first stops only (the paper's figures 8 and 9).

    Attributes
    ----------
    stops
        How many were used.
    values, sigma : (14,)
        In the order of ``ORDER``; for rx, ry, rz the difference from the final mounting.
    """

    stops: int
    values: tuple[float, ...]
    sigma: tuple[float, ...]


def grow(
    drive: Correspondences, steps: FourSteps, final: Estimate, options: EstimateOptions
) -> tuple[ConvergencePoint, ...]:
    """Return estimates from the first 3, ... and all stops of a drive, in growing steps.

    From ``FROM_THE_END`` stops on they are found from where all stops lead, in one round; fewer leave more than one
    answer open, and are solved like any drive. Numbers of stops that do not determine the calibration are left out.

    Parameters
    ----------
    drive, steps
        The drive, and what the four steps found in it (their camera poses are the start).
    final
        The estimate from all stops.
    options
        As it was made with.
    """
    kept = steps.camera.kept
    quick = replace(options, find_faults=False)
    out = []
    for count in _counts(len(kept)):
        try:
            if count < FROM_THE_END:
                first = replace(drive, stops=tuple(drive.stops[j] for j in kept[:count]))
                found = estimate([first], _start(steps, count), quick)
            else:
                found = reported(fit_part([drive], [kept[:count]], final, options), [drive], quick)
        except (CalibError, np.linalg.LinAlgError):  # too few stops to say anything: the chart begins later
            continue
        out.append(_point(count, found, final))
    return (*out, _point(len(kept), final, final))


def _counts(stops: int) -> Sequence[int]:
    """Return the least number of stops, and some from which on the start is known, which cost less."""
    if stops <= FROM_THE_END:
        return range(MIN_STOPS, stops)
    later = np.unique(np.round(np.geomspace(FROM_THE_END, stops, STEPS - 1)).astype(int))
    return [MIN_STOPS, *(int(c) for c in later if c < stops)]


def _start(steps: FourSteps, count: int) -> FourSteps:
    camera = steps.camera
    few = replace(
        camera, kept=tuple(range(count)), T_cam_box=camera.T_cam_box[:count], stop_rms_px=camera.stop_rms_px[:count]
    )
    return replace(steps, camera=few)


def _point(count: int, found: Estimate, final: Estimate) -> ConvergencePoint:
    turn = log_so3(final.T_body_cam[:3, :3].T @ found.T_body_cam[:3, :3])
    c, t = found.camera, found.T_body_cam[:3, 3]
    values: Array = np.array([c.fu, c.fv, c.cu, c.cv, c.kr, found.rR, found.rL, found.b, *turn, *t])
    sigma = found.sigma
    return ConvergencePoint(stops=count, values=tuple(values.tolist()), sigma=tuple(sigma[name] for name in ORDER))
