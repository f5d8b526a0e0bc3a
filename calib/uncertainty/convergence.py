"""Convergence over stops: estimates from a drive's first stops only (the paper's figures 8 and 9)."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.geometry.parameters import CAMERA, COUNT, ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.initial_guess import camera_start
from boxcal.calib.uncertainty.convergence_point import ConvergencePoint
from boxcal.calib.uncertainty.part_of_drives import part_with_noise_known
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS
from boxcal.target.arrays import Array

STEPS = 4
"""How many numbers of stops are tried of a long drive: estimates of all would cost more than the calibration itself."""
FROM_THE_END = 6
"""Number of stops from which on one answer is near that of all stops."""


def grow(
    drive: Correspondences, steps: FourSteps, final: Estimate, options: EstimateOptions
) -> tuple[ConvergencePoint, ...]:
    """Return estimates from the first 3, ... and all stops of a drive, in growing steps.

    Noise levels, and what is left out, are those of all stops. From ``FROM_THE_END`` stops on the search begins where
    all stops lead; fewer leave more than one answer open, and begin like any drive. Numbers of stops that do not
    determine the calibration are left out.

    Parameters
    ----------
    drive, steps
        The drive, and what the four steps found in it (their camera poses are the start).
    final
        The estimate from all stops.
    options
        As it was made with.
    """
    kept, cameras = steps.camera.kept, camera_start([drive], steps)
    out = []
    for count in _counts(len(kept)):
        first = [kept[:count]]
        start = cameras.only(first) if count < FROM_THE_END else None
        try:
            state, cov = part_with_noise_known([drive], first, final, options, start)
        except (CalibError, np.linalg.LinAlgError):  # too few stops to say anything: the chart begins later
            continue
        sigma = np.sqrt(np.diag(cov)[:COUNT])
        out.append(_point(count, (state.lens[CAMERA], state.wheels, state.T_body_cam), sigma, final))
    c, wheels = final.camera, np.array([final.rR, final.rL, final.b])
    told = np.array([final.sigma[name] for name in ORDER])
    camera = np.array([c.fu, c.fv, c.cu, c.cv, c.kr])
    return (*out, _point(len(kept), (camera, wheels, final.T_body_cam), told, final))


def _counts(stops: int) -> Sequence[int]:
    """Return the least number of stops, and some from which on the start is known, which cost less."""
    if stops <= FROM_THE_END:
        return range(MIN_STOPS, stops)
    later = np.unique(np.round(np.geomspace(FROM_THE_END, stops, STEPS - 1)).astype(int))
    return [MIN_STOPS, *(int(c) for c in later if c < stops)]


def _point(count: int, values: tuple[Array, Array, Array], sigma: Array, final: Estimate) -> ConvergencePoint:
    """Return the point of a camera's first five values, wheels and extrinsics (4, 4)."""
    camera, wheels, T_body_cam = values
    turn = log_so3(final.T_body_cam[:3, :3].T @ T_body_cam[:3, :3])
    ordered = np.concatenate([camera, wheels, turn, T_body_cam[:3, 3]])
    return ConvergencePoint(stops=count, values=tuple(ordered.tolist()), sigma=tuple(sigma.tolist()))
