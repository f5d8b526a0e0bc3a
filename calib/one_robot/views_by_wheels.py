"""Views of the box between stops as the wheels predict them, by the closed form from the stops."""

from dataclasses import dataclass, field

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps, solve_four_steps
from boxcal.calib.geometry.diff_drive import dead_reckoned
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.tags.predicted_views import PredictedViews
from boxcal.target.arrays import Array, Ids


def views_by_wheels(drive: Correspondences) -> PredictedViews | None:
    """Return where a robot's camera is between its stops, by its wheels from the nearer stop.

    None where the closed form finds no answer: then frames between stops are searched for the box.

    Parameters
    ----------
    drive
        What was seen at the stops.
    """
    try:
        steps = solve_four_steps(drive)
    except CalibError:
        return None
    path = _Path(drive=drive, stops=tuple(steps.camera.kept), steps=steps)
    return PredictedViews(camera=steps.camera.camera, T_cam_box_at=path.T_cam_box_at)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Leg:
    """The way between two stops, sample by sample.

    Attributes
    ----------
    t_ns : (S,)
        Times of the samples.
    pose : (S, 3), m and rad
        Where the robot is, from the first.
    rolled : (S,), rad
        What both wheels rolled since then.
    """

    t_ns: Ids
    pose: Array
    rolled: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Path:
    """The way of a robot by its wheels between some stops, and the box's poses at these.

    Attributes
    ----------
    drive, stops, steps
        The drive, numbers of the stops, and what the closed form makes of them.
    legs
        Those that were asked for, by number.
    """

    drive: Correspondences
    stops: tuple[int, ...]
    steps: FourSteps
    legs: dict[int, _Leg] = field(default_factory=dict)

    def T_cam_box_at(self, t_ns: Ids) -> Array:
        """Return the box's poses (N, 4, 4) at times (N,), ns; NaN before the first stop and behind the last."""
        ends = [self.drive.stops[k].t_end_ns for k in self.stops]
        out = np.full((len(t_ns), 4, 4), np.nan)
        number = np.searchsorted(ends, t_ns, side="right") - 1
        for k in np.unique(number[(number >= 0) & (number < len(ends) - 1)]).tolist():
            rows = np.flatnonzero(number == k)
            out[rows] = self._on_leg(k, t_ns[rows])
        return out

    def _leg(self, k: int) -> _Leg:
        """Return the way from a stop to the next."""
        if k not in self.legs:
            first, last = (self.drive.stops[self.stops[j]] for j in (k, k + 1))
            samples, wheels = slice(first.last_sample, last.first_sample + 1), self.drive.wheels
            dphi = np.diff(np.stack([wheels.phi_R[samples], wheels.phi_L[samples]], axis=1), axis=0)
            xy, heading = dead_reckoned(dphi[:, 0], dphi[:, 1], self.steps.heading.aR, self.steps.heading.aL)
            self.legs[k] = _Leg(
                t_ns=wheels.t_ns[samples],
                pose=np.column_stack([self.steps.mounting.rL * xy, heading]),
                rolled=np.concatenate([[0.0], np.cumsum(np.abs(dphi).sum(axis=1))]),
            )
        return self.legs[k]

    def _on_leg(self, k: int, t_ns: Ids) -> Array:
        """Return the box's poses (N, 4, 4) at times (N,), ns, on the way from a stop to the next."""
        leg, steps = self._leg(k), self.steps
        at, t = (t_ns - leg.t_ns[0]).astype(np.float64), leg.t_ns - leg.t_ns[0]
        T_first_here = _planar(np.stack([np.interp(at, t, column) for column in leg.pose.T], axis=1))
        nearer_end = np.interp(at, t, leg.rolled) > leg.rolled[-1] / 2
        T_end_here = inverse(_planar(leg.pose[-1:])) @ T_first_here
        T_stop_here = np.where(nearer_end[:, None, None], T_end_here, T_first_here)
        T_cam_box = steps.camera.T_cam_box[k + nearer_end.astype(np.int64)]
        return np.asarray(inverse(steps.T_body_cam) @ inverse(T_stop_here) @ steps.T_body_cam @ T_cam_box)


def _planar(pose: Array) -> Array:
    """Return motions (N, 4, 4) of poses (N, 3) on the floor: x, y, m, and heading, rad."""
    out = np.tile(np.eye(4), (len(pose), 1, 1))
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    out[:, 0, 0], out[:, 0, 1], out[:, 1, 0], out[:, 1, 1] = c, -s, s, c
    out[:, :2, 3] = pose[:, :2]
    return out
