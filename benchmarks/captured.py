"""Motion-captured runs of a real robot (OptiOdom), and what a camera carried along would have seen.

The robot drove far from any box, so the simulated camera looks at a papered room: walls 5 m apart around the middle of
each run's path carry tags that face inwards. The room is the run's frame ``box``.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.simulate.robot import mount
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array
from boxcal.target.box import Box, make_target
from boxcal.target.camera.camera_model import CameraModel, project

TICKS_A_TURN = 2796.8
NOMINAL = (0.042, 0.042, 0.200)
"""rR, rL, b as the makers give them, m."""
CAMERA = CameraModel(fu=600.0, fv=600.0, cu=319.5, cv=239.5, kr=-0.1)
IMAGE_SIZE = (640, 480)
SIGMA_PX = 0.25
T_CAPTURED_CAM = mount(x=0.05, z=0.3, pitch=0.05)
"""Maps camera points to the frame that the motion capture reports, put on the floor."""
_ROOM = Box(width=5.0, depth=5.0, height=2.0, columns=14, rows=5, tag_size=0.28, pitch=0.35)
_STOP_ROWS = 20
_LEAST_TURN = 0.02
_WINDOW = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CapturedRun:
    """One run, rows every 0.05 s.

    Attributes
    ----------
    name
    t : (S,), s
        Of the encoders.
    phi : (S, 2), rad
        Wheel angles, right and left.
    pose : (S, 3), m and rad
        x, y and heading (continuous) by motion capture.
    clock : (2,), s
        How far the motion capture's times lag at the run's beginning and end, as found and taken off; 0 as recorded.
    """

    name: str
    t: Array
    phi: Array
    pose: Array
    clock: Array


def load_run(path: Path) -> CapturedRun:
    """Read one file of the data set: ``t s, x m, y m, theta rad, ticks right, ticks left`` (increments)."""
    rows = np.loadtxt(path, delimiter=",")
    name = f"{path.parent.name.split('-')[0]} {int(path.stem[-2:])}"
    phi = np.cumsum(rows[:, 4:6], axis=0) * (2 * np.pi / TICKS_A_TURN)
    return CapturedRun(name=name, t=rows[:, 0], phi=phi, pose=rows[:, 1:4], clock=np.zeros(2))


def with_clock(run: CapturedRun) -> CapturedRun:
    """Return the run with the motion capture moved onto the encoders' clock.

    Offset and rate are those with which ``dtheta = aR dphi_R + aL dphi_L`` over one second fits best, aR and aL free:
    no dimension of the robot is needed.
    """
    share = (run.t - run.t[0]) / (run.t[-1] - run.t[0])
    wheels = CubicSpline(run.t, run.phi)
    turned = run.pose[_WINDOW:, 2] - run.pose[:-_WINDOW, 2]

    def lag(clock: Array) -> Array:
        return np.asarray(clock[0] * (1 - share) + clock[1] * share)

    def misfit(twentieths: Array) -> float:
        phi = wheels(np.clip(run.t + lag(twentieths / 20), run.t[0], run.t[-1]))
        rolled = phi[_WINDOW:] - phi[:-_WINDOW]
        fit, *_ = np.linalg.lstsq(rolled, turned, rcond=None)
        return float(np.std(turned - rolled @ fit))

    starts = [np.array([a, b]) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)]
    best = min((minimize(misfit, s, method="Nelder-Mead") for s in starts), key=lambda found: float(found.fun))
    clock = np.asarray(best.x / 20)
    at = run.t + lag(clock)
    pose = CubicSpline(at, run.pose)(np.clip(run.t, at[0], at[-1]))
    return replace(run, pose=pose, clock=clock)


def carry_camera(run: CapturedRun, rng: np.random.Generator) -> Correspondences:
    """Return what the camera would have seen every second while the robot drove, and what the encoders read.

    A second in which a wheel did not turn adds no stop.
    """
    p_room = make_target(_ROOM).tag_corners.reshape(-1, 3)
    middle = (run.pose[:, :2].min(axis=0) + run.pose[:, :2].max(axis=0)) / 2
    t_ns = np.rint(run.t * 1e9).astype(np.int64)
    rows: list[int] = []
    for k in range(0, len(run.t), _STOP_ROWS):
        if not rows or np.all(np.abs(run.phi[k] - run.phi[rows[-1]]) > _LEAST_TURN):
            rows.append(k)
    stops = []
    for k in rows:
        x, y, theta = run.pose[k]
        T_cam_room = inverse(planar(x - middle[0], y - middle[1], theta) @ T_CAPTURED_CAM)
        ids, uv_px = _seen(p_room @ T_cam_room[:3, :3].T + T_cam_room[:3, 3])
        stops.append(
            StopObservation(
                t_start_ns=int(t_ns[k]),
                t_end_ns=int(t_ns[k]),
                first_sample=k,
                last_sample=k,
                phi_R=float(run.phi[k, 0]),
                phi_L=float(run.phi[k, 1]),
                landmark_ids=ids,
                p_box=p_room[ids],
                uv_px=uv_px + SIGMA_PX * rng.standard_normal(uv_px.shape),
                cov_px2=np.tile(np.eye(2) * SIGMA_PX**2, (len(ids), 1, 1)),
                frames=1,
            )
        )
    return Correspondences(
        robot="optiodom",
        image_size=IMAGE_SIZE,
        wheels=WheelSamples(t_ns=t_ns, phi_R=run.phi[:, 0].copy(), phi_L=run.phi[:, 1].copy()),
        stops=tuple(stops),
    )


def _seen(p_cam: Array) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], Array]:
    """Return the numbers and pixels of the points in the image, of (N, 3) in the camera's frame."""
    ahead = np.flatnonzero(p_cam[:, 2] > 0.5 * np.linalg.norm(p_cam, axis=1))
    uv_px = project(CAMERA, p_cam[ahead])
    inside = np.all((uv_px >= 0) & (uv_px <= np.array(IMAGE_SIZE) - 1), axis=1)
    return ahead[inside].astype(np.int64), uv_px[inside]
