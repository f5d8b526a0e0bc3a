"""Images of what is printed on a face: every pixel is the exact mean of the ink below it."""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, isfinite

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array, Reals
from boxcal.target.box import FACES, Target
from boxcal.target.errors import TargetError
from boxcal.target.render.texture import Axis, FaceTexture, face_texture
from boxcal.target.tags.families import modules_per_side

INCH = 0.0254
MAX_PIXELS = 400_000_000
_BAND = 512
_PNG_HEAD = 33
"""Bytes of a PNG's signature and its first chunk (IHDR)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FaceImage:
    """An image of a face's sheet, upright as seen from outside.

    Attributes
    ----------
    grey : (H, W) uint8
        255 is paper, 0 is ink; row 0 is at the top.
    origin : (2,), modules
        Sheet coordinates (see :class:`boxcal.target.render.texture.FaceTexture`) of the image's top left corner, not
        of the centre of its first pixel.
    texel : modules
        Side of a pixel.
    """

    grey: NDArray[np.uint8]
    origin: Array
    texel: float

    def place(self, sheet: Array) -> Array:
        """Return where sheet points (N, 2) fall in the image: (N, 2), 0 to 1, right and down from its top left."""
        height, width = self.grey.shape
        return np.asarray((sheet - self.origin) / (self.texel * width, self.texel * height))


def face_png(target: Target, face: int, *, dpi: float = 300.0) -> bytes:
    """Return a face as designed, its whole outline, as a PNG that knows its resolution.

    The image begins at the outline's top left corner; where the face is no whole number of pixels wide or high, the
    last column and row are white beyond it. It shows the dimensions, not a measured print: at ``dpi`` its tags have the
    size that ``target.box`` says.

    Parameters
    ----------
    target
        The box.
    face
        0 to 3.
    dpi
        Pixels per inch.

    Raises
    ------
    TargetError
        If there is no such face, or the image would be empty or larger than ``MAX_PIXELS``.
    """
    box = target.box
    texture = _checked_texture(target, face)
    if not (isfinite(dpi) and dpi > 0):
        raise TargetError(f"dpi is {dpi}: a positive number of pixels per inch is needed")
    pixel = INCH / dpi
    module = box.tag_size / modules_per_side(box.dictionary)
    width, height = (ceil(round(length / pixel, 6)) for length in (box.face_width(face), box.height))
    if width * height > MAX_PIXELS:
        raise TargetError(
            f"dpi is {dpi:g}: face {face} would have {width} x {height} px, at most {MAX_PIXELS} px are drawn",
            remedy="lower it",
        )
    top_left = box.grid_corners()[0, 0]
    origin = np.array([-box.face_width(face) / 2 - top_left[0], top_left[1] - box.height / 2]) / module
    return encode_png(draw(texture, origin, pixel / module, (height, width)), dpi=dpi)


def face_pngs(target: Target, *, dpi: float = 300.0) -> Mapping[str, bytes]:
    """Return the four faces as PNGs (see :func:`face_png`): file name -> content."""
    return {f"face-{face}.png": face_png(target, face, dpi=dpi) for face in range(FACES)}


def draw(texture: FaceTexture, origin: Array, texel: float, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Return an image (H, W) of a sheet whose top left corner is at ``origin``, pixels of ``texel`` modules.

    Along each axis a pixel shares its length among the sheet's cells; the mean ink is the product of both, exactly.
    """
    height, width = shape
    along_u = _shares(texture.along_u, origin[0], texel, width)
    along_v = _shares(texture.along_v, origin[1], texel, height)
    rows = texture.cells.astype(np.float32) @ along_u.T
    grey = np.empty(shape, dtype=np.uint8)
    for first in range(0, height, _BAND):
        band = slice(first, first + _BAND)
        grey[band] = np.rint(255 - 255 * (along_v[band] @ rows))
    return grey


def encode_png(grey: NDArray[np.uint8], *, dpi: float | None = None) -> bytes:
    """Return a grey image as PNG; with ``dpi``, a pHYs chunk says how large it is (PNG specification, 11.3.5.3)."""
    import cv2  # noqa: PLC0415 - heavy

    done, data = cv2.imencode(".png", grey)
    if not done:
        raise TargetError(f"picture of shape {grey.shape}: cannot be encoded as PNG", remedy="lower its resolution")
    png = bytes(data.tobytes())
    if dpi is None:
        return png
    per_metre = round(dpi / INCH)
    chunk = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    chunk = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return png[:_PNG_HEAD] + chunk + png[_PNG_HEAD:]


def _shares(axis: Axis, origin: float, texel: float, count: int) -> Reals:
    """Return the fraction of each pixel (count, cells) within each cell; what lies before or beyond all is paper."""
    breaks = axis.breaks[:-1].astype(float)
    before = np.clip((breaks - origin) / texel - np.arange(count)[:, None], 0, 1)
    fractions = np.zeros((count, len(axis.breaks)), dtype=np.float32)
    fractions[:, 1:-1] = np.diff(before, axis=1)
    return fractions


def _checked_texture(target: Target, face: int) -> FaceTexture:
    if face not in range(FACES):
        raise TargetError(f"face is {face!r}: 0, 1, 2 or 3 is needed")
    texture = face_texture(target, face)
    if texture is None:
        raise TargetError(f"face {face}: carries no tags, there is nothing to draw", remedy="choose another face")
    return texture
