"""The box as six textured rectangles: the one geometry behind all models."""

from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.models.faces import FaceImage, draw
from boxcal.target.render.texture import FaceTexture, face_texture

TRIANGLES = ((0, 1, 2), (0, 2, 3))
"""A side's corners as triangles, counter-clockwise as seen from outside."""
_TEXELS_A_MODULE = 16
_MAX_SIDE_PX = 4096
_RIM = 4
"""White pixels around what can be seen, so that a viewer's filter finds nothing else there."""
_MULTIPLE = 64
"""Images are a whole multiple of this wide and high and begin at a whole module, so that a viewer's half, quarter ...
sized copies of an image have the tags' edges between pixels, too, and are not shifted against it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """One side of the box.

    Attributes
    ----------
    name
        ``face0`` to ``face3``, ``top`` or ``bottom``.
    corners : (4, 3), m
        Frame ``box``, counter-clockwise as seen from outside; on faces from the bottom left.
    normal : (3,)
        Outward.
    image : FaceImage or None
        What is printed on it; None where it is plain white.
    uv : (4, 2)
        Where the corners fall in the image: 0 to 1, right and **down** from its top left.
    """

    name: str
    corners: Array
    normal: Array
    image: FaceImage | None
    uv: Array


def sides(target: Target) -> tuple[Side, ...]:
    """Return the box's four faces, its top and its bottom.

    The outline is that of the box's dimensions. The print follows ``tag_corners``: a face's rectangle lies in the plane
    of its tags, and the image is placed by the affine map that takes the designed grid to them best, so a print at
    another scale or a sheet glued low shows as it is.
    """
    box = target.box
    found = []
    for face in range(FACES):
        T = box.T_box_face(face)
        w, h = box.face_width(face) / 2, box.height / 2
        outline = np.array([[-w, -h, 0], [w, -h, 0], [w, h, 0], [-w, h, 0]]) @ T[:3, :3].T + T[:3, 3]
        found.append(_face(f"face{face}", outline, T[:3, 2], face_texture(target, face)))
    x, y, z = box.width / 2, box.depth / 2, box.height
    around = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    for name, level, up in (("top", z, 1.0), ("bottom", 0.0, -1.0)):
        corners = np.column_stack([around, np.full(4, level)])[:: int(up)]
        found.append(Side(name=name, corners=corners, normal=np.array([0, 0, up]), image=None, uv=np.full((4, 2), 0.5)))
    return tuple(found)


def _face(name: str, outline: Array, normal: Array, texture: FaceTexture | None) -> Side:
    if texture is None:
        return Side(name=name, corners=outline, normal=normal, image=None, uv=np.full((4, 2), 0.5))
    along = np.column_stack([texture.p_box_sheet[:, :2], -normal])
    u, v, lift = np.linalg.solve(along, (outline - texture.p_box_sheet[:, 2]).T)
    sheet = np.column_stack([u, v])
    fine = min(_TEXELS_A_MODULE, max(1, floor(_MAX_SIDE_PX / (np.ptp(sheet, axis=0).max() + 1))))
    first = np.floor(sheet.min(axis=0) - _RIM / fine) * fine
    spans = np.round(sheet.max(axis=0) * fine, 6) + _RIM - first
    columns, rows = (ceil(span / _MULTIPLE) * _MULTIPLE for span in spans)
    image = FaceImage(grey=draw(texture, first / fine, 1 / fine, (rows, columns)), origin=first / fine, texel=1 / fine)
    return Side(
        name=name,
        corners=outline + lift[:, None] * normal,
        normal=normal,
        image=image,
        uv=image.place(sheet),
    )
