"""The sides of the box that a camera sees: outlines, and what is printed on each."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from boxcal.target.arrays import Array, Reals
from boxcal.target.box import FACES, Box, Target
from boxcal.target.render.sensor import SensorModel
from boxcal.target.render.texture import FaceTexture, face_texture

TOP, BOTTOM = FACES, FACES + 1
_ROUNDS = 4
"""Steps that find where a ray meets a bowed face; each gains two digits or more on a face bowed by 1 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bow:
    """A face that is bowed outwards, as seen from one camera: a parabola over the face's width.

    Lengths on the sheet are in modules.

    Attributes
    ----------
    eye : (2,)
        Foot of the camera's perpendicular on the sheet.
    sagitta
        Height of the face's middle over its plane, in camera distances from that plane.
    middle, half_width
        Along the sheet's u.
    """

    eye: tuple[float, float]
    sagitta: float
    middle: float
    half_width: float

    def place(self, u: Reals, v: Reals) -> tuple[Reals, Reals, Reals, Reals, Reals]:
        """Return where rays that meet the plane at (u, v) meet the face, and du/du, dv/du, dv/dv of that."""
        eye_u, eye_v = np.float32(self.eye[0]), np.float32(self.eye[1])
        raised_u = u
        for _ in range(_ROUNDS):
            height, _ = self._height(raised_u)
            raised_u = u + (eye_u - u) * height
        height, slope = self._height(raised_u)
        u_by_u = (1 - height) / (1 - (eye_u - u) * slope)
        return raised_u, v + (eye_v - v) * height, u_by_u, (eye_v - v) * slope * u_by_u, 1 - height

    def _height(self, u: Reals) -> tuple[Reals, Reals]:
        """Return the height over the plane in camera distances, and its derivative by u."""
        off = (u - np.float32(self.middle)) / np.float32(self.half_width)
        sagitta = np.float32(self.sagitta)
        return sagitta * (1 - off * off), -2 * sagitta * off / np.float32(self.half_width)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
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
    bow
        How the sheet is bowed; None where it is flat.
    paper, ink
        Linear intensity of white and of black modules.
    """

    edges: Reals
    sheet_cam: Reals | None
    texture: FaceTexture | None
    bow: Bow | None
    paper: np.float32
    ink: np.float32


def sides_seen(target: Target, T_cam_box: Array, sensor: SensorModel, bow: tuple[float, ...]) -> list[Side]:
    """Return the sides of the box whose outside the camera is on; ``bow`` is the faces' outward sagitta, m."""
    R, t = T_cam_box[:3, :3], T_cam_box[:3, 3]
    sides = []
    textures = _textures(target)
    for side in sides_facing(target.box, T_cam_box):
        corners = outline(target.box, side)[0] @ R.T + t
        normals = np.cross(corners, np.roll(corners, -1, axis=0))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals *= np.sign(normals @ corners.mean(axis=0))[:, None]
        texture = textures[side] if side < FACES else None
        sheet_cam = None
        if texture is not None:
            sheet_cam = np.linalg.inv(R @ texture.p_box_sheet + np.outer(t, (0, 0, 1))).astype(np.float32)
        shade = sensor.shade[min(side, TOP)]
        sides.append(
            Side(
                edges=normals.astype(np.float32),
                sheet_cam=sheet_cam,
                texture=texture,
                bow=_bow(target.box, texture, side, -R.T @ t, bow[side]) if texture and bow[side] else None,
                paper=np.float32(sensor.paper * shade),
                ink=np.float32(sensor.ink * shade),
            )
        )
    return sides


def _bow(box: Box, texture: FaceTexture, side: int, eye: Array, sagitta: float) -> Bow:
    along_u, along_v, origin = texture.p_box_sheet.T
    inward = np.cross(along_u, along_v)
    inward /= np.linalg.norm(inward)
    axes = np.stack([along_u, along_v, -inward], axis=1)
    u, v, distance = np.linalg.solve(axes, eye - origin)
    middle = np.linalg.solve(axes, box.T_box_face(side)[:3, 3] - origin)
    half_width = box.face_width(side) / 2 / np.linalg.norm(along_u)
    return Bow(
        eye=(float(u), float(v)),
        sagitta=sagitta / float(distance),
        middle=float(middle[0]),
        half_width=float(half_width),
    )


def outline(box: Box, side: int) -> tuple[Array, Array]:
    """Return a side's corners (4, 3) in order around it and its outward normal (3,), frame ``box``."""
    if side in (TOP, BOTTOM):
        x, y = box.width / 2, box.depth / 2
        z, up = (box.height, 1.0) if side == TOP else (0.0, -1.0)
        return np.array([[x, y, z], [-x, y, z], [-x, -y, z], [x, -y, z]]), np.array([0.0, 0.0, up])
    T = box.T_box_face(side)
    w, h = box.face_width(side) / 2, box.height / 2
    return np.array([[-w, h, 0], [w, h, 0], [w, -h, 0], [-w, -h, 0]]) @ T[:3, :3].T + T[:3, 3], T[:3, 2]


def sides_facing(box: Box, T_cam_box: Array) -> list[int]:
    """Return the sides of the box whose outside the camera is on."""
    centre = -T_cam_box[:3, :3].T @ T_cam_box[:3, 3]
    corners, normals = _planes(box)
    return np.flatnonzero(np.sum((centre - corners) * normals, axis=1) > 1e-9).tolist()


@lru_cache(maxsize=8)
def _planes(box: Box) -> tuple[Array, Array]:
    """Return a corner (6, 3) of every side and its outward normal (6, 3), frame ``box``."""
    outlines = [outline(box, side) for side in range(BOTTOM + 1)]
    return np.array([corners[0] for corners, _ in outlines]), np.array([normal for _, normal in outlines])


@lru_cache(maxsize=8)
def _textures(target: Target) -> tuple[FaceTexture | None, ...]:
    return tuple(face_texture(target, face) for face in range(FACES))
