"""Convergence over stops: estimates from a drive's first stops only (the paper's figures 8 and 9)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood import Estimate, EstimateOptions, estimate
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.arrays import Array

STEPS = 6
"""How many numbers of stops are tried: estimates of all would cost more than the calibration itself."""


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

    Numbers of stops that do not determine the calibration are left out.

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
            found = estimate([replace(drive, stops=_first(drive, kept, count))], _start(steps, count), quick)
        except CalibError:  # too few stops to say anything: the chart begins later
            continue
        out.append(_point(count, found, final))
    return (*out, _point(len(kept), final, final))


def _counts(stops: int) -> Sequence[int]:
    counts = np.unique(np.round(np.geomspace(3, max(stops, 3), STEPS)).astype(int))
    return [int(c) for c in counts if c < stops]


def _first(drive: Correspondences, kept: tuple[int, ...], count: int) -> tuple[StopObservation, ...]:
    return tuple(drive.stops[j] for j in kept[:count])


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
