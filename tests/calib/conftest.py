"""Exact drives for the tests of the four steps: poses, wheel samples and landmarks without any noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from boxcal.calib.four_steps.step1_camera import CameraStep
from boxcal.calib.geometry.diff_drive import Legs, Wheels
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, planar, rigid, rot_y, rot_z, wrap
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel, project

CAMERA = CameraModel(fu=561.3, fv=557.8, cu=327.4, cv=231.9, kr=-0.21)
WHEELS = Wheels(rR=0.02113, rL=0.02087, b=0.0893)
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
SAMPLES_A_MOVE = 25


def mounting(
    yaw_deg: float, pitch_deg: float, roll_deg: float = 0.0, t: Sequence[float] = (0.03, -0.005, 0.12)
) -> Array:
    """T_body_cam of a camera that looks to yaw (left), pitch (down) and roll."""
    yaw, pitch, roll = np.radians([yaw_deg, pitch_deg, roll_deg])
    R = rot_z(yaw) @ rot_y(pitch) @ exp_so3(np.array([roll, 0.0, 0.0])) @ OPTICAL
    return rigid(R, np.array(t, dtype=float))


@dataclass(frozen=True, kw_only=True)
class ExactDrive:
    """A drive without noise: body poses at the stops, and the wheel samples between them."""

    wheels: Wheels
    T_body_cam: Array
    T_box_body: Array
    dphi: Array  # (S, 2) right, left
    ends: tuple[int, ...]

    @property
    def legs(self) -> Legs:
        return Legs(dphi_R=self.dphi[:, 0], dphi_L=self.dphi[:, 1], ends=self.ends)

    @property
    def T_cam_box(self) -> Array:
        return inverse(self.T_box_body @ self.T_body_cam)

    def camera_step(self) -> CameraStep:
        n = len(self.ends)
        return CameraStep(
            camera=CAMERA, kept=tuple(range(n)), T_cam_box=self.T_cam_box, rms_px=0.0, stop_rms_px=np.zeros(n)
        )

    def correspondences(self, sigma_px: float = 0.0, rng: np.random.Generator | None = None) -> Correspondences:
        phi = np.concatenate([np.zeros((1, 2)), np.cumsum(self.dphi, axis=0)])
        stops = []
        for end, T_cam_box in zip(self.ends, self.T_cam_box, strict=True):
            ids, p_box, uv_px = see(T_cam_box)
            if rng is not None:
                uv_px = uv_px + sigma_px * rng.normal(size=uv_px.shape)
            stops.append(
                StopObservation(
                    t_start_ns=end * 20_000_000,
                    t_end_ns=end * 20_000_000,
                    first_sample=end,
                    last_sample=end,
                    phi_R=phi[end, 0],
                    phi_L=phi[end, 1],
                    landmark_ids=ids,
                    p_box=p_box,
                    uv_px=uv_px,
                    cov_px2=np.tile(np.eye(2) * max(sigma_px, 1e-3) ** 2, (len(ids), 1, 1)),
                    frames=1,
                )
            )
        samples = WheelSamples(t_ns=np.arange(len(phi)) * 20_000_000, phi_R=phi[:, 0], phi_L=phi[:, 1])
        return Correspondences(robot="exact", image_size=(640, 480), wheels=samples, stops=tuple(stops))


def see(T_cam_box: Array) -> tuple[Array, Array, Array]:
    """Landmarks of the default box that a camera of 640 x 480 sees, exactly: ids, p_box, uv_px."""
    target = make_target()
    centre = inverse(T_cam_box)[:3, 3]
    normals = np.array([target.box.T_box_face(int(f))[:3, 2] for f in target.tag_faces])
    p_cam = target.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
    facing = np.sum((centre - target.tag_corners[:, 0]) * normals, axis=1) > 0.02
    ahead = np.all(p_cam[..., 2] > 0.05, axis=1)
    narrow = np.all(np.abs(p_cam[..., :2]) < 0.9 * np.maximum(p_cam[..., 2:], 1e-3), axis=(1, 2))
    uv = project(CAMERA, np.where(ahead[:, None, None], p_cam, 1.0))
    inside = np.all((uv >= 0) & (uv <= (639, 479)), axis=(1, 2))
    seen = facing & ahead & narrow & inside
    ids = (4 * target.tag_ids[seen][:, None] + np.arange(4)).ravel()
    return ids, target.tag_corners[seen].reshape(-1, 3), uv[seen].reshape(-1, 2)


def drive_through(stops: Array, T_body_cam: Array, wheels: Wheels = WHEELS, spins: Sequence[int] = ()) -> ExactDrive:
    """A drive through body poses (P, 3) x, y, theta: turn, go straight, turn; constant speeds within a sample.

    ``spins[i]`` adds that many whole turns on the spot to the last turn of leg i.
    """
    dphi: list[Array] = []
    ends = [0]
    for i in range(len(stops) - 1):
        d = stops[i + 1, :2] - stops[i, :2]
        first = float(wrap(np.arctan2(d[1], d[0]) - stops[i, 2])) if np.any(d) else 0.0
        last = stops[i + 1, 2] - stops[i, 2] - first
        last = float(wrap(last)) + 2 * np.pi * (spins[i] if i < len(spins) else 0)
        one = np.ones((SAMPLES_A_MOVE, 1)) / SAMPLES_A_MOVE
        turn = np.array([[wheels.b / 2 / wheels.rR, -wheels.b / 2 / wheels.rL]])
        straight = np.array([[1 / wheels.rR, 1 / wheels.rL]])
        dphi += [one * turn * first, one * straight * float(np.hypot(*d)), one * turn * last]
        ends.append(sum(len(m) for m in dphi))
    poses = np.array([planar(*stop) for stop in stops])
    return ExactDrive(
        wheels=wheels, T_body_cam=T_body_cam, T_box_body=poses, dphi=np.concatenate(dphi), ends=tuple(ends)
    )


def drive_arcs(arcs: Array, start: Sequence[float], T_body_cam: Array, wheels: Wheels = WHEELS) -> ExactDrive:
    """A drive along arcs: one leg a row of arcs (P - 1, 2), wheel angles travelled right and left."""
    poses = [np.array(start, dtype=float)]
    for dR, dL in arcs:
        x, y, th = poses[-1]
        ds, dth = (wheels.rR * dR + wheels.rL * dL) / 2, (wheels.rR * dR - wheels.rL * dL) / wheels.b
        chord = ds * np.sinc(dth / 2 / np.pi)
        poses.append(np.array([x + chord * np.cos(th + dth / 2), y + chord * np.sin(th + dth / 2), th + dth]))
    return ExactDrive(
        wheels=wheels,
        T_body_cam=T_body_cam,
        T_box_body=np.array([planar(*p) for p in poses]),
        dphi=np.repeat(arcs, SAMPLES_A_MOVE, axis=0) / SAMPLES_A_MOVE,
        ends=tuple(range(0, SAMPLES_A_MOVE * len(arcs) + 1, SAMPLES_A_MOVE)),
    )


def stops_around(count: int, rounds: float, yaw_deg: float, rng: np.random.Generator) -> Array:
    """Stops (count, 3) on rounds about the box, at which a camera with this yaw looks at it, some 0.6 m away."""
    around = np.linspace(0, 2 * np.pi * rounds, count, endpoint=False) + rng.uniform(-0.2, 0.2, count)
    radius = rng.uniform(0.55, 0.75, count)
    heading = around + np.pi - np.radians(yaw_deg) + rng.uniform(-0.1, 0.1, count)
    return np.stack([radius * np.cos(around), radius * np.sin(around), heading], axis=1)


@pytest.fixture(scope="session")
def exact() -> "Exact":
    """Builders of exact drives."""
    return Exact()


class Exact:
    """The builders of this file, by name."""

    camera = CAMERA
    wheels = WHEELS
    mounting: Callable[..., Array] = staticmethod(mounting)
    through: Callable[..., ExactDrive] = staticmethod(drive_through)
    arcs: Callable[..., ExactDrive] = staticmethod(drive_arcs)
    around: Callable[..., Array] = staticmethod(stops_around)
