"""The drive as the calibration sees it: where the robot stood, the path that its wheels describe, and their gaps."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from boxcal.calib.geometry.diff_drive import Legs, legs_between, unit_path
from boxcal.calib.geometry.so3_se3 import inverse, wrap
from boxcal.calib.likelihood.estimate import FlaggedLeg
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Leg
from boxcal.calib.results.stop_residuals import SeenStop
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

MAX_POINTS = 2500
"""Points of the whole path that are drawn at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivenLeg:
    """One leg between two stops that were used.

    Attributes
    ----------
    name
        Labels of its two stops.
    path : (N, 2), m
        Path on the floor by the wheels, from the first stop on; the gap at its end is the residual.
    gap : (3,), m and rad
        Wheels less images, in the frame of the second stop: forward, left, turn.
    rolled : m
        Path length of the axle's middle.
    turned : rad
        By the wheels.
    judged
        What the likelihood says of it, None for the closed form.
    fault
        Why it was left out, None if it was not.
    """

    name: str
    path: Array
    gap: Array
    rolled: float
    turned: float
    judged: Leg | None
    fault: FlaggedLeg | None


def floor_pose(T_box_cam: Array, T_body_cam: Array) -> Array:
    """Return x, y (m) and heading (rad) of the body in frame ``box``, (3,)."""
    T = T_box_cam @ inverse(T_body_cam)
    return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])


def driven_legs(
    calibration: Calibration, drives: Sequence[Correspondences], seen: tuple[SeenStop, ...]
) -> tuple[DrivenLeg, ...]:
    """Return the legs between the stops seen, in order; drives are not connected."""
    w, detail = calibration.wheels, calibration.detail
    judged = {(leg.drive, leg.t_start_ns): leg for leg in detail.legs} if detail else {}
    faults = {(leg.drive, leg.t_start_ns): leg for leg in detail.flagged_legs} if detail else {}
    every = max(1, sum(len(drive.wheels) for drive in drives) // MAX_POINTS)
    legs = []
    for a, b in pairwise(seen):
        if a.drive != b.drive:
            continue
        travel = legs_between(drives[a.drive], (a.number, b.number))
        samples = len(travel.dphi_R)
        at = (*range(0, samples, every), samples)
        xy, heading = unit_path(Legs(dphi_R=travel.dphi_R, dphi_L=travel.dphi_L, ends=at), w.rR / w.b, -w.rL / w.b)
        xy = xy * w.rL
        start, end = (floor_pose(s.result.T_box_cam, calibration.T_body_cam) for s in (a, b))
        path = xy @ _rot(start[2]).T + start[:2]
        gap = np.array([*(_rot(end[2]).T @ (path[-1] - end[:2])), wrap(start[2] + heading[-1] - end[2])])
        key = (a.drive, a.view.t_end_ns)
        legs.append(
            DrivenLeg(
                name=f"{a.label}\N{EN DASH}{b.label}",
                path=path,
                gap=gap,
                rolled=float(np.sum(np.abs(w.rR * travel.dphi_R + w.rL * travel.dphi_L)) / 2),
                turned=float(heading[-1]),
                judged=judged.get(key),
                fault=faults.get(key),
            )
        )
    return tuple(legs)


def _rot(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
