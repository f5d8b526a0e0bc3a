"""Shapes of tags as they are seen; :mod:`boxcal.detect.alignment.numba.tag_shape` finds the same."""

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array

_NEXT = np.array([1, 2, 3, 0])


def widths(corners_px: Array) -> Array:
    """Return the smaller width of quadrilaterals (N, 4, 2), (N,) px: area over longest side."""
    x, y = corners_px[..., 0], corners_px[..., 1]
    area = 0.5 * np.abs((x[:, 2] - x[:, 0]) * (y[:, 3] - y[:, 1]) - (y[:, 2] - y[:, 0]) * (x[:, 3] - x[:, 1]))
    side = np.hypot(x[:, _NEXT] - x, y[:, _NEXT] - y).max(axis=1)
    return np.asarray(area / np.maximum(side, 1e-9))


def convex(corners_px: Array) -> NDArray[np.bool_]:
    """Return which quadrilaterals (N, 4, 2) run clockwise as seen, without dents."""
    along = corners_px[:, _NEXT] - corners_px
    after = along[:, _NEXT]
    return np.asarray(np.all(along[..., 0] * after[..., 1] - along[..., 1] * after[..., 0] > 0, axis=1))


def sides(corners_px: Array) -> tuple[Array, Array]:
    """Return the mean sides of tags (N, 4, 2), px, to the right and down as they are printed, (N, 2) px each."""
    top_left, top_right, bottom_right, bottom_left = corners_px.transpose(1, 0, 2)
    right = 0.5 * (top_right + bottom_right - top_left - bottom_left)
    return right, 0.5 * (bottom_right + bottom_left - top_right - top_left)
