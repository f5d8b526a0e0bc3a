"""Views of the box between stops as the wheels predict them, by the closed form from the stops."""

from dataclasses import dataclass

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
    return PredictedViews(camera=steps.camera.camera, T_cam_box_at=_path(drive, steps).T_cam_box_at)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Path:
    """The path of a robot by its wheels from the first stop to the last, sample by sample.

    Attributes
    ----------
    t_ns, since_s : (), (S,)
        Time of the first sample, ns, and of all since then, s.
    pose : (3, S), m and rad
        Where the robot is on the floor, from the first sample.
    rolled : (S,), rad
        What both wheels rolled since then.
    leaves, arrives : (P - 1,)
        Samples at which the robot leaves the stop before each leg, and arrives at the one behind it.
    until_ns : (P,)
        When each stop ends.
    T_cam_body : (4, 4)
        The camera's extrinsics.
    T_floor_box : (2, P - 1, 4, 4)
        Where the box stands on the floor of the path, by what the stop before and the stop behind each leg saw.
    """

    t_ns: int
    since_s: Array
    pose: Array
    rolled: Array
    leaves: Ids
    arrives: Ids
    until_ns: Ids
    T_cam_body: Array
    T_floor_box: Array

    def T_cam_box_at(self, t_ns: Ids) -> Array:
        """Return the box's poses (N, 4, 4) at times (N,), ns; NaN before the first stop and behind the last."""
        leg = np.searchsorted(self.until_ns, t_ns, side="right") - 1
        known = (leg >= 0) & (leg < len(self.leaves))
        leg = np.where(known, leg, 0)
        first, last = self.leaves[leg], self.arrives[leg]
        at = np.clip(1e-9 * (t_ns - self.t_ns), self.since_s[first], self.since_s[last])
        T_floor_body = _planar(np.stack([np.interp(at, self.since_s, column) for column in self.pose], axis=1))
        rolled = 2 * np.interp(at, self.since_s, self.rolled)
        nearer_end = rolled > self.rolled[first] + self.rolled[last]
        out = self.T_cam_body @ inverse(T_floor_body) @ self.T_floor_box[nearer_end.astype(np.int64), leg]
        out[~known] = np.nan
        return np.asarray(out)


def _path(drive: Correspondences, steps: FourSteps) -> _Path:
    """Return the path between the stops that the closed form used."""
    stops, wheels = [drive.stops[k] for k in steps.camera.kept], drive.wheels
    between = slice(stops[0].last_sample, stops[-1].first_sample + 1)
    dphi_R, dphi_L = np.diff(wheels.phi_R[between]), np.diff(wheels.phi_L[between])
    xy, heading = dead_reckoned(dphi_R, dphi_L, steps.heading.aR, steps.heading.aL)
    pose = np.column_stack([steps.mounting.rL * xy, heading])
    leaves, arrives = (
        np.array(samples) - between.start
        for samples in ([stop.last_sample for stop in stops[:-1]], [stop.first_sample for stop in stops[1:]])
    )
    T_body_box = steps.T_body_cam @ steps.camera.T_cam_box
    return _Path(
        t_ns=int(wheels.t_ns[between.start]),
        since_s=1e-9 * (wheels.t_ns[between] - wheels.t_ns[between.start]),
        pose=pose.T.copy(),
        rolled=np.concatenate([[0.0], np.cumsum(np.abs(dphi_R) + np.abs(dphi_L))]),
        leaves=leaves,
        arrives=arrives,
        until_ns=np.array([stop.t_end_ns for stop in stops]),
        T_cam_body=inverse(steps.T_body_cam),
        T_floor_box=np.stack([_planar(pose[leaves]) @ T_body_box[:-1], _planar(pose[arrives]) @ T_body_box[1:]]),
    )


def _planar(pose: Array) -> Array:
    """Return motions (N, 4, 4) of poses (N, 3) on the floor: x, y, m, and heading, rad."""
    out = np.tile(np.eye(4), (len(pose), 1, 1))
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    out[:, 0, 0], out[:, 0, 1], out[:, 1, 0], out[:, 1, 1] = c, -s, s, c
    out[:, :2, 3] = pose[:, :2]
    return out
