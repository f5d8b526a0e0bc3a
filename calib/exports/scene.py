"""Scene of a robot's drives for 3-D viewers: stops, path over time, and the box."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from boxcal.calib.geometry.diff_drive import legs_between, unit_path
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.stop_residuals import SeenStop, stops_seen
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target

PATH_HZ = 10.0
"""Poses along the path a second, at most."""
MAGNIFIED = 20.0
"""By how much residuals are drawn longer than they are."""
FULL_SCALE_PX = 1.0
"""A residual of this length or more is red."""

Images = Mapping[tuple[int, int], tuple[int, bytes]]
"""Time (ns) and JPEG of a frame, by number of the drive and of the stop in it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivenPath:
    """The path between two stops as the wheels measure it, from the first stop on.

    Attributes
    ----------
    t_ns : (N,), ns
        Ascending.
    poses : (N, 3), m and rad
        x, y and heading in frame ``box``.
    used
        False if the leg was found faulty and left out.
    """

    t_ns: Ids
    poses: Array
    used: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """The drives of a calibrated robot.

    Attributes
    ----------
    calibration, target
        The robot's calibration, and the box.
    stops
        The stops used.
    path
        The paths between them; those of different drives are not connected.
    """

    calibration: Calibration
    target: Target
    stops: tuple[SeenStop, ...]
    path: tuple[DrivenPath, ...]


def make_scene(calibration: Calibration, drives: Sequence[Correspondences], target: Target) -> Scene:
    """Return what happened on the drives that a calibration was made from."""
    stops = stops_seen(calibration, drives, target)
    path = tuple(_driven(calibration, drives[a.drive], a, b) for a, b in pairwise(stops) if a.drive == b.drive)
    return Scene(calibration=calibration, target=target, stops=stops, path=path)


def residual_colours(error_px: Array, used: NDArray[np.bool_]) -> Array:
    """Return colours (N, 3), red, green and blue from 0 to 1: green at 0 px, red from 1 px on; magenta if not used."""
    fraction = np.clip(np.linalg.norm(error_px, axis=1) / FULL_SCALE_PX, 0, 1)
    colours = np.stack([np.minimum(1, 2 * fraction), np.minimum(1, 2 - 2 * fraction), np.zeros(len(fraction))], axis=1)
    return np.where(used[:, None], colours, (1.0, 0.0, 1.0))


def _driven(calibration: Calibration, drive: Correspondences, a: SeenStop, b: SeenStop) -> DrivenPath:
    travel = legs_between(drive, (a.number, b.number))
    w = calibration.wheels
    times = [np.array([a.view.t_end_ns])]
    for i in range(a.number, b.number):
        inner = slice(drive.stops[i].last_sample + 1, drive.stops[i + 1].first_sample)
        times += [drive.wheels.t_ns[inner], np.array([drive.stops[i + 1].t_start_ns])]
    t_ns = np.concatenate(times)
    every = np.zeros(len(t_ns), dtype=bool)
    every[np.unique(((t_ns - t_ns[0]) * (PATH_HZ / 1e9)).astype(np.int64), return_index=True)[1]] = True
    every[[0, -1]] = True
    xy, heading = unit_path(replace(travel, ends=tuple(np.flatnonzero(every).tolist())), w.rR / w.b, -w.rL / w.b)
    T = a.result.T_box_cam @ inverse(calibration.T_body_cam)
    start = float(np.arctan2(T[1, 0], T[0, 0]))
    c, s = np.cos(start), np.sin(start)
    turned = w.rL * xy @ np.array([[c, s], [-s, c]]) + T[:2, 3]
    faults = {(leg.drive, leg.t_start_ns) for leg in calibration.detail.flagged_legs} if calibration.detail else set()
    return DrivenPath(
        t_ns=t_ns[every],
        poses=np.column_stack([turned, heading + start]),
        used=(a.drive, a.view.t_end_ns) not in faults,
    )
