"""What a camera sees of the box, from any pose outside it: pictures with edges right to a hundredth of a pixel.

A face is a sheet of black and white modules, so the mean of its ink over any rectangle of the sheet is exact from a
few look-ups (:mod:`boxcal.target.render.texture`). A pixel that lies within one colour needs one such mean; a pixel
that an edge crosses is split into samples, each the mean over its own footprint.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array, Ids, Index, Reals
from boxcal.target.box import FACES, Box, Target
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.errors import TargetError
from boxcal.target.render.background import background
from boxcal.target.render.rays import Rays, pixel_rays
from boxcal.target.render.sensor import SensorModel, expose
from boxcal.target.render.texture import FaceTexture, face_texture

__all__ = ["SensorModel", "encode_jpeg", "render", "visible_tags"]

MAX_SIDE_PX = 16_384
TOP, BOTTOM = FACES, FACES + 1
_BATCH = 4096
_NEAREST = np.float32(1e-6)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Side:
    """One side of the box, as the camera has it before it.

    Attributes
    ----------
    edges : (4, 3)
        Normals, frame ``cam``, of the planes through the camera and each edge; a ray meets the side where all four
        products with it are positive. Opposite edges are 0 and 2, 1 and 3.
    sheet_cam : (3, 3) or None
        Maps a ray (xc/zc, yc/zc, 1) to homogeneous sheet coordinates; None where the side is plain.
    texture
        What is printed on it.
    paper, ink
        Linear intensity of white and from black modules.
    """

    edges: Reals
    sheet_cam: Reals | None
    texture: FaceTexture | None
    paper: np.float32
    ink: np.float32


def render(  # noqa: PLR0917 - the noise source last, as a simulation's other steps have it
    target: Target,
    camera: CameraModel,
    T_cam_box: Array,
    image_size: tuple[int, int],
    sensor: SensorModel = SensorModel(),  # noqa: B008 - frozen
    rng: np.random.Generator | None = None,
) -> NDArray[np.uint8]:
    """Return the grey picture (H, W) that a camera takes of the box.

    Parameters
    ----------
    target
        The box. Its outline is that of its figures; the print on its faces follows ``tag_corners``.
    camera
        Intrinsics.
    T_cam_box : (4, 4), m
        Pose of the box before the camera.
    image_size
        (width, height), px.
    look
        Lens and sensor.
    rng
        Source of the noise; needed if the sensor has any.

    Raises
    ------
    TargetError
        If the size or the pose is impossible, the camera is inside the box, or noise is asked for without ``rng``.
    """
    width, height = _checked_size(image_size)
    T_cam_box = _checked_pose(T_cam_box, target.box)
    if sensor.noise > 0 and rng is None:
        raise TargetError(
            f"sensor: noise is {sensor.noise:g} grey levels but no random generator was given", remedy="pass rng"
        )
    rays = pixel_rays(camera, width, height)
    light = np.zeros(width * height, dtype=np.float32)
    cover = np.zeros(width * height, dtype=np.float32)
    for side in _sides(target, T_cam_box, sensor):
        inside, border = _regions(side, rays)
        light[inside] = _inside_light(side, rays, inside, sensor.supersample)
        cover[inside] = 1
        for at in _batches(border, sensor.supersample):
            samples = _Samples(rays, at, sensor.supersample)
            share = samples.coverage(side.edges)
            light[at] += (share * samples.light(side)).mean(axis=1)
            cover[at] += share.mean(axis=1)
    light /= np.maximum(cover, 1)
    if cover.min() < 1:
        focal = (camera.fu + camera.fv) / 2
        room = sensor.background == "room"
        behind = background(rays.directions, (height, width), T_cam_box, focal_px=focal, box=target.box, room=room)
        light += np.maximum(1 - cover, 0) * behind.ravel()
    if rays.dark is not None:
        light[rays.dark] = 0
    return expose(light.reshape(height, width), sensor, rng)


def visible_tags(
    target: Target, camera: CameraModel, T_cam_box: Array, image_size: tuple[int, int], margin_px: float = 0.0
) -> Ids:
    """Return the ids of the tags that lie wholly inside the image, on faces turned to the camera.

    Parameters
    ----------
    target, camera, T_cam_box, image_size
        As for :func:`render`.
    margin_px : px
        How far from the image's border all four corners must stay; the border runs half a pixel outside the
        outermost pixel centres.

    Returns
    -------
    (N,), ascending.
    """
    width, height = _checked_size(image_size)
    T_cam_box = _checked_pose(T_cam_box, target.box)
    facing = np.isin(target.tag_faces, _facing(target.box, T_cam_box))
    p_cam = target.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
    before = np.all(p_cam[..., 2] > 0, axis=1)
    p_cam[~before] = (0, 0, 1)
    uv_px = project(camera, p_cam)
    rho2 = np.sum((p_cam[..., :2] / p_cam[..., 2:]) ** 2, axis=-1)
    reached = np.all(1 + 3 * camera.kr * rho2 > 0, axis=1)
    low = margin_px - 0.5
    inside = np.all((uv_px >= low) & (uv_px <= (width - 1 - low, height - 1 - low)), axis=(1, 2))
    return np.asarray(np.sort(target.tag_ids[facing & before & reached & inside]))


def encode_jpeg(image: NDArray[np.uint8], quality: int = 90) -> bytes:
    """Return a grey or colour picture as JPEG, quality 1 to 100.

    Raises
    ------
    TargetError
        If the quality is out of range or OpenCV cannot encode the picture.
    """
    if not 1 <= quality <= 100:
        raise TargetError(f"JPEG quality is {quality}, 1 to 100 is needed")
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(quality)])
    if not done:
        raise TargetError(f"picture of shape {image.shape} and type {image.dtype}: cannot be encoded as JPEG")
    return bytes(data.tobytes())


def _checked_size(image_size: tuple[int, int]) -> tuple[int, int]:
    width, height = image_size
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX):
        raise TargetError(f"image size {width} x {height}: 1 to {MAX_SIDE_PX} px a side are needed")
    return int(width), int(height)


def _checked_pose(T_cam_box: Array, box: Box) -> Array:
    T = np.asarray(T_cam_box, dtype=np.float64)
    rigid = T.shape == (4, 4) and bool(np.isfinite(T).all())
    rigid = rigid and np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() < 1e-6 and np.linalg.det(T[:3, :3]) > 0
    if not rigid:
        raise TargetError("T_cam_box: not a rigid pose, a finite (4, 4) matrix with a rotation in it is needed")
    if not _facing(box, T):
        x, y, z = -T[:3, :3].T @ T[:3, 3]
        raise TargetError(
            f"T_cam_box: the camera is inside the box, at ({x:.3f}, {y:.3f}, {z:.3f}) m", remedy="move it out"
        )
    return T


def _outline(box: Box, side: int) -> tuple[Array, Array]:
    """Return a side's corners (4, 3) in order around it and its outward normal (3,), frame ``box``."""
    if side in (TOP, BOTTOM):
        x, y = box.width / 2, box.depth / 2
        z, up = (box.height, 1.0) if side == TOP else (0.0, -1.0)
        return np.array([[x, y, z], [-x, y, z], [-x, -y, z], [x, -y, z]]), np.array([0.0, 0.0, up])
    T = box.T_box_face(side)
    w, h = box.face_width(side) / 2, box.height / 2
    return np.array([[-w, h, 0], [w, h, 0], [w, -h, 0], [-w, -h, 0]]) @ T[:3, :3].T + T[:3, 3], T[:3, 2]


def _facing(box: Box, T_cam_box: Array) -> list[int]:
    """Return the sides of the box whose outside the camera is on."""
    centre = -T_cam_box[:3, :3].T @ T_cam_box[:3, 3]
    outlines = {side: _outline(box, side) for side in range(BOTTOM + 1)}
    return [side for side, (corners, normal) in outlines.items() if (centre - corners[0]) @ normal > 1e-9]


def _sides(target: Target, T_cam_box: Array, sensor: SensorModel) -> list[_Side]:
    R, t = T_cam_box[:3, :3], T_cam_box[:3, 3]
    sides = []
    textures = _textures(target)
    for side in _facing(target.box, T_cam_box):
        corners = _outline(target.box, side)[0] @ R.T + t
        normals = np.cross(corners, np.roll(corners, -1, axis=0))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals *= np.sign(normals @ corners.mean(axis=0))[:, None]
        texture = textures[side] if side < FACES else None
        sheet_cam = None
        if texture is not None:
            sheet_cam = np.linalg.inv(R @ texture.p_box_sheet + np.outer(t, (0, 0, 1))).astype(np.float32)
        shade = sensor.shade[min(side, TOP)]
        sides.append(
            _Side(
                edges=normals.astype(np.float32),
                sheet_cam=sheet_cam,
                texture=texture,
                paper=np.float32(sensor.paper * shade),
                ink=np.float32(sensor.ink * shade),
            )
        )
    return sides


@lru_cache(maxsize=8)
def _textures(target: Target) -> tuple[FaceTexture | None, ...]:
    return tuple(face_texture(target, face) for face in range(FACES))


def _regions(side: _Side, rays: Rays) -> tuple[Index, Index]:
    """Return the pixels that lie wholly within a side, and those that its outline may cross."""
    slopes = np.maximum(np.hypot(side.edges[:, 0], side.edges[:, 1]), np.float32(1e-12))
    depth = ((side.edges / slopes[:, None]) @ rays.directions).min(axis=0)
    inside = depth >= rays.reach
    border = (depth > -rays.reach) & ~inside
    if rays.dark is not None:
        inside &= ~rays.dark
        border &= ~rays.dark
    return np.flatnonzero(inside), np.flatnonzero(border)


def _inside_light(side: _Side, rays: Rays, at: Index, supersample: int) -> Reals:
    """Return the light of pixels (indices (N,)) that lie wholly within a side."""
    light = np.full(len(at), side.paper, dtype=np.float32)
    if side.texture is None or side.sheet_cam is None:
        return light
    for first in range(0, len(at), 8 * _BATCH):
        part = at[first : first + 8 * _BATCH]
        forms = _Forms(side.sheet_cam, rays, part)
        half_u, half_v = (0.5 * (np.abs(a) + np.abs(b)) for a, b in (forms.slope(0), forms.slope(1)))
        uniform, ink = side.texture.uniform(*forms.centre(), half_u, half_v)
        light[first : first + 8 * _BATCH] += ink * (side.ink - side.paper)
        mixed = np.flatnonzero(~uniform)
        for chosen in _batches(mixed, supersample):
            light[first + chosen] = _Samples(rays, part[chosen], supersample).light(side).mean(axis=1)
    return light


def _batches(at: Index, supersample: int) -> list[Index]:
    size = max(1, _BATCH * 16 // supersample**2)
    return [at[first : first + size] for first in range(0, len(at), size)]


class _Forms:
    """Three linear forms of the ray, (3, N), and their derivatives by the pixel; their quotients are places."""

    def __init__(self, matrix: Reals, rays: Rays, at: Index) -> None:
        xu, xv, yu, yv = rays.jacobian(at)
        self.value = matrix @ rays.directions[:, at]
        self.by_u = matrix[:, 0, None] * xu + matrix[:, 1, None] * yu
        self.by_v = matrix[:, 0, None] * xv + matrix[:, 1, None] * yv

    def centre(self) -> tuple[Reals, Reals]:
        """Return where the pixels' centres fall on the sheet."""
        w = np.maximum(self.value[2], _NEAREST)
        return self.value[0] / w, self.value[1] / w

    def slope(self, axis: int) -> tuple[Reals, Reals]:
        """Return how fast a sheet coordinate changes along the image's u and v, modules/px."""
        w = np.maximum(self.value[2], _NEAREST)
        place = self.value[axis] / w
        by_u = (self.by_u[axis] - place * self.by_u[2]) / w
        return by_u, (self.by_v[axis] - place * self.by_v[2]) / w


class _Samples:
    """The samples (N, S * S) of some pixels, on a regular grid within each."""

    def __init__(self, rays: Rays, at: Index, supersample: int) -> None:
        self.rays, self.at, self.supersample = rays, at, supersample
        steps = (np.arange(supersample) + 0.5) / supersample - 0.5
        dv, du = np.meshgrid(steps, steps, indexing="ij")
        self.offsets = np.stack([np.ones(du.size), du.ravel(), dv.ravel()]).astype(np.float32)

    def _spread(self, forms: _Forms, row: int) -> Reals:
        """Return one linear form at every sample, (N, S * S)."""
        return np.stack([forms.value[row], forms.by_u[row], forms.by_v[row]], axis=1) @ self.offsets

    def light(self, side: _Side) -> Reals:
        """Return the side's light at every sample, each the mean over its footprint.

        The footprint on the sheet is a small parallelogram; the rectangle with its second moments stands for it.
        """
        if side.texture is None or side.sheet_cam is None:
            return np.full((len(self.at), self.offsets.shape[1]), side.paper, dtype=np.float32)
        forms = _Forms(side.sheet_cam, self.rays, self.at)
        w = np.maximum(self._spread(forms, 2), _NEAREST)
        u, v = self._spread(forms, 0) / w, self._spread(forms, 1) / w
        width_u, width_v = (np.hypot(*forms.slope(k))[:, None] / np.float32(self.supersample) for k in (0, 1))
        wide = (np.maximum(width_u, width_v) > 1).ravel()
        if not wide.any():
            ink = side.texture.mean_ink(u, v, width_u, width_v)
        else:
            ink = np.empty_like(u)
            ink[~wide] = side.texture.mean_ink(u[~wide], v[~wide], width_u[~wide], width_v[~wide])
            ink[wide] = side.texture.mean_ink_wide(u[wide], v[wide], width_u[wide], width_v[wide])
        return np.asarray(side.paper + ink * (side.ink - side.paper), dtype=np.float32)

    def coverage(self, edges: Reals) -> Reals:
        """Return the share of every sample that lies within the outline.

        A sample's share on one side of an edge follows from its distance to the edge; between two opposite edges
        the shares overlap, so that two sides that meet in an edge share it without gap or excess.
        """
        shares = []
        for pair in (edges[0::2], edges[1::2]):
            both = np.float32(-1)
            for edge in pair:
                forms = _Forms(edge[None, :], self.rays, self.at)
                slope = np.maximum(np.hypot(forms.by_u[0], forms.by_v[0]), np.float32(1e-12))
                distance = self._spread(forms, 0) * (np.float32(self.supersample) / slope)[:, None]
                both = both + np.clip(distance + np.float32(0.5), 0, 1)
            shares.append(np.maximum(both, 0))
        return np.asarray(shares[0] * shares[1], dtype=np.float32)
