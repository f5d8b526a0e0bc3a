"""Views of the box through fisheye lenses of up to 180 degrees and more, ray by ray, with their truth."""

from dataclasses import dataclass

import numpy as np
from aligned_views import PLAIN, TARGET

from boxcal.target.render.psf import gather
from boxcal.target.render.sensor import expose
from boxcal.target.render.texture import face_texture

TEXTURES = [face_texture(TARGET, face) for face in range(4)]
SAMPLES = 4


@dataclass(frozen=True, kw_only=True)
class Fisheye:
    """A camera that sees at an angle t at ``f t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)`` px from its centre."""

    size: tuple[int, int]
    f: float
    centre: tuple[float, float]
    k: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def _radius(self, theta):
        t2 = theta * theta
        k1, k2, k3, k4 = self.k
        return self.f * theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))

    def project(self, p_cam):
        rho = np.linalg.norm(p_cam[..., :2], axis=-1, keepdims=True)
        r = self._radius(np.arctan2(rho, p_cam[..., 2:]))
        return p_cam[..., :2] / np.maximum(rho, 1e-12) * r + self.centre

    def rays(self, uv):
        d = uv - self.centre
        r = np.linalg.norm(d, axis=-1, keepdims=True)
        angles = np.linspace(0, np.pi, 100_001)
        theta = np.interp(r, self._radius(angles), angles)
        return np.concatenate([d / np.maximum(r, 1e-12) * np.sin(theta), np.cos(theta)], axis=-1)


def fisheye(fov_deg, size=(640, 480), k=(0.0, 0.0, 0.0, 0.0)):
    """Return a camera that sees so far across the image's width."""
    half, at = np.deg2rad(fov_deg / 2), (size[0] / 2 + 4, size[1] / 2 - 3)
    unit = Fisheye(size=size, f=1.0, centre=at, k=k)
    return Fisheye(size=size, f=size[0] / 2 / float(unit._radius(half)), centre=at, k=k)


def aimed(T_cam_box, camera, uv):
    """Return the pose turned so that the box's middle is seen at a pixel."""
    middle = T_cam_box[:3, :3] @ (0, 0, 0.1) + T_cam_box[:3, 3]
    a, b = middle / np.linalg.norm(middle), camera.rays(np.array(uv, dtype=float))
    v, c = np.cross(a, b), float(a @ b)
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turn = np.eye(4)
    turn[:3, :3] = np.eye(3) + cross + cross @ cross / (1 + c)
    return turn @ T_cam_box


def fisheye_truth(T_cam_box, camera, margin_px=1.0):
    """Return where every tag's corners are, (T, 4, 2) px, and the rows of those wholly in view, seen within 60 deg."""
    p_cam = TARGET.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
    uv = camera.project(p_cam)
    inside = np.all((uv > margin_px - 0.5) & (uv < np.array(camera.size) - 0.5 - margin_px), axis=(1, 2))
    outward = np.cross(p_cam[:, 3] - p_cam[:, 0], p_cam[:, 1] - p_cam[:, 0])
    middle = p_cam.mean(axis=1)
    cosine = -np.sum(outward * middle, axis=1) / np.linalg.norm(outward, axis=1) / np.linalg.norm(middle, axis=1)
    return uv, np.flatnonzero(inside & (cosine > 0.5))


def fisheye_view(T_cam_box, camera, look=PLAIN, seed=1):
    """Return the picture: the mean of some samples a pixel, each the mean of the print over its footprint."""
    width, height = camera.size
    R, t = T_cam_box[:3, :3], T_cam_box[:3, 3]
    eye = -R.T @ t
    uv = np.stack(np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float)), axis=-1)
    light = _behind(camera.rays(uv.reshape(-1, 2)) @ R, eye).reshape(height, width)
    # samples only where the box may be
    about = camera.project(_surface() @ R.T + t)
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    part = np.s_[_within(about[:, 1], height), _within(about[:, 0], width)]
    shape = uv[part].shape[:2]
    light[part] = np.mean(
        [
            _light(camera, R, eye, (uv[part] + (du, dv)).reshape(-1, 2), look).reshape(shape)
            for dv in steps
            for du in steps
        ],
        axis=0,
    )
    nothing = np.zeros(0, dtype=np.intp), np.zeros((0, 1), dtype=np.float32)  # its samples are gathered already
    return expose(gather(np.asarray(light, dtype=np.float32), *nothing, look), look, np.random.default_rng(seed))


def _within(places, size):
    low, high = places.min() - 10, places.max() + 10
    return slice(int(np.clip(low, 0, size)), int(np.clip(high, 0, size)) + 1)


def _light(camera, R, eye, uv, look):
    ray = camera.rays(uv) @ R
    light = _behind(ray, eye)
    half = 0.5 / SAMPLES
    nearest = np.full(len(ray), np.inf)
    half_size = np.array([TARGET.box.width / 2, TARGET.box.depth / 2])
    for face, texture in enumerate(TEXTURES):
        T = TARGET.box.T_box_face(face)
        if (eye - T[:3, 3]) @ T[:3, 2] < 0:
            continue
        distance = ((T[:3, 3] - eye) @ T[:3, 2]) / (ray @ T[:3, 2])
        at = eye + distance[:, None] * ray
        hit = (distance > 0) & (distance < nearest) & (at[:, 2] > 0) & (at[:, 2] < TARGET.box.height)
        hit &= np.all(np.abs(at[:, :2]) < half_size + 1e-9, axis=1)
        nearest[hit] = distance[hit]
        S = np.linalg.inv(texture.p_box_sheet - np.outer(eye, (0, 0, 1)))
        chosen = uv[hit]
        u, v = _sheet(S, ray[hit])
        spread = []
        for move in ((half, 0), (0, half)):
            a, b = (_sheet(S, camera.rays(chosen + s * np.array(move)) @ R) for s in (-1, 1))
            spread.append((b[0] - a[0], b[1] - a[1]))
        width_u = np.hypot(spread[0][0], spread[1][0])
        width_v = np.hypot(spread[0][1], spread[1][1])
        ink = texture.mean_ink_wide(u, v, np.maximum(width_u, 1e-4), np.maximum(width_v, 1e-4))
        light[hit] = look.shade[face] * (look.paper + ink * (look.ink - look.paper))
    if eye[2] > TARGET.box.height:
        distance = (TARGET.box.height - eye[2]) / ray[:, 2]
        at = eye + distance[:, None] * ray
        hit = (distance > 0) & (distance < nearest) & np.all(np.abs(at[:, :2]) < half_size, axis=1)
        light[hit] = look.shade[4] * look.paper
    return light


def _surface():
    """Return points all over the box, (P, 3) m."""
    unit = np.stack(np.meshgrid(*[np.linspace(0, 1, 12)] * 3), axis=-1).reshape(-1, 3)
    return (unit - (0.5, 0.5, 0)) * (TARGET.box.width, TARGET.box.depth, TARGET.box.height)


def _sheet(S, ray):
    w = ray @ S.T
    return w[:, 0] / w[:, 2], w[:, 1] / w[:, 2]


def _behind(ray, eye):
    """Return the light of a tiled floor and a plain wall."""
    down = ray[:, 2] < -1e-6
    at = eye[:2] - eye[2] * ray[:, :2] / np.where(down, ray[:, 2], -1)[:, None]
    tiles = (np.floor(at[:, 0] / 0.3) + np.floor(at[:, 1] / 0.3)) % 2
    floor = np.where(np.abs(at).max(axis=1) < 4, 0.35 + 0.12 * tiles, 0.4)
    return np.where(down, floor, 0.5 + 0.1 * ray[:, 2]).astype(np.float32)
