"""An image, and some of its tags at their present parameters."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.tag_patterns import Index
from boxcal.target.arrays import Array

ROUND = np.array([1.0, 0.0, 1.0])
"""A PSF that is equally wide in all directions."""
LEVEL = 1 / 255
"""A grey level of 8 bits."""
_NO_GREY, _NO_GREY8 = np.zeros((1, 1), dtype=np.float32), np.zeros((1, 1), dtype=np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """An image with the way from its pixels to light and to straight lines.

    Attributes
    ----------
    grey : (H, W)
        Grey levels: float32, 1 at full scale, or of 8 bits as they are.
    response : (K,)
        Grey level T(m) of light m at ``m = k / (K - 1)``; the identity for a linear camera.
    lens : (6,)
        Centre (x, y) px, a1, a2, 1 / radius px and a3, see :mod:`boxcal.detect.alignment.radial_camera`.
    blur : (3,)
        The PSF's covariance over sigma^2 is ``L L^T``, L lower triangular: its entries (0, 0), (1, 0) and (1, 1).
    """

    grey: NDArray[np.float32] | NDArray[np.uint8]
    response: Array
    lens: Array
    blur: Array = field(default_factory=lambda: ROUND)

    def grey_at(self, rows: Index, columns: Index) -> Array:
        """Return the grey levels of pixels (P,), 1 at full scale."""
        levels = self.grey[rows, columns].astype(np.float32)
        return np.asarray(levels * np.float32(LEVEL) if self.grey.dtype == np.uint8 else levels, dtype=np.float64)

    @property
    def linear(self) -> bool:
        """Whether the response curve is the identity."""
        return bool(len(self.response) == 2 and self.response[0] == 0 and self.response[1] == 1)


class BatchArrays(NamedTuple):
    """A frame and its tags as compiled code takes them, see :class:`Frame` and :class:`Batch`.

    Grey levels stand in one of two arrays, by how many bits they have; so code is compiled once for both.
    """

    eight_bits: bool
    grey: NDArray[np.float32]
    grey8: NDArray[np.uint8]
    response: NDArray[np.float32]
    linear: bool
    lens: Array
    blur: Array
    cells: Array
    rows: Index
    theta: Array
    normalisation: Array
    bounding_boxes: NDArray[np.int64]
    margin: Array
    stride: NDArray[np.int64]
    near: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Tags, and which of their pixels count.

    Attributes
    ----------
    frame
        The image.
    cells : (T, M + 2, M + 2)
        Patterns of all tags.
    rows : (N,)
        Which of them each tag is.
    theta : (N, 14)
        Parameters; h maps normalised normalised, see ``normalisation``, to modules.
    normalisation : (N, 3)
        Centre (x, y) px and 1 / scale px: the normalised place of a pixel is ``(chart - centre) / scale``, on the chart
        about the centre (:mod:`boxcal.detect.alignment.radial_camera`).
    bounding_boxes : (N, 4)
        Pixels to use: first and last column, first and last row (last exclusive), within the image.
    margin : (N,)
        How many modules of the white ring count.
    stride : (N, 3)
        ``m, q, n``: of each row use the pixels whose column, counted from ``q row`` modulo m within the box, m
        divides; and those whose row and column together n divides, if an edge between black and white is near.
    near : (N,)
        How near, in standard deviations of the blur at the tag's centre.
    every
        Of all these only those whose column and twice the row together it divides.
    """

    frame: Frame
    cells: Array
    rows: Index
    theta: Array
    normalisation: Array
    bounding_boxes: NDArray[np.int64]
    margin: Array
    stride: NDArray[np.int64]
    near: Array
    every: int = 1

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, at: Index) -> "Batch":
        """Return some of the tags, copied."""
        names = ("rows", "theta", "normalisation", "bounding_boxes", "margin", "stride", "near")
        return replace(self, **{name: getattr(self, name)[at] for name in names})

    def arrays(self) -> BatchArrays:
        """Return all of it as compiled code takes it; the tags' parameters are shared, not copied."""
        frame = self.frame
        eight = frame.grey.dtype == np.uint8
        return BatchArrays(
            eight_bits=eight,
            grey=_NO_GREY if eight else np.require(frame.grey, np.float32, ["C", "W"]),
            grey8=np.require(frame.grey, np.uint8, ["C", "W"]) if eight else _NO_GREY8,
            response=frame.response.astype(np.float32),
            linear=frame.linear,
            lens=frame.lens,
            blur=frame.blur,
            cells=self.cells,
            rows=self.rows,
            theta=self.theta,
            normalisation=self.normalisation,
            bounding_boxes=self.bounding_boxes,
            margin=self.margin,
            stride=self.stride,
            near=self.near,
        )
