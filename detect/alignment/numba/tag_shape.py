"""Shapes of tags, one after the other; the reference is :mod:`boxcal.detect.alignment.tag_shape`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.target.arrays import Array


def widths(corners_px: Array) -> Array:
    """Return what :func:`boxcal.detect.alignment.tag_shape.widths` does."""
    return _shapes(corners_px)[0]


def convex(corners_px: Array) -> NDArray[np.bool_]:
    """Return what :func:`boxcal.detect.alignment.tag_shape.convex` does."""
    return _shapes(corners_px)[1]


def _shapes(corners_px: Array) -> tuple[Array, NDArray[np.bool_]]:
    width, convex = np.empty(len(corners_px)), np.empty(len(corners_px), dtype=np.bool_)
    _fill(np.ascontiguousarray(corners_px, dtype=np.float64), width, convex)
    return width, convex


@kernel()
def _fill(corners: Any, width: Any, convex: Any) -> None:
    for k in range(len(corners)):
        longest, turning, area = 0.0, True, 0.0
        for c in range(4):
            b, d = (c + 1) & 3, (c + 2) & 3
            ax, ay = corners[k, b, 0] - corners[k, c, 0], corners[k, b, 1] - corners[k, c, 1]
            bx, by = corners[k, d, 0] - corners[k, b, 0], corners[k, d, 1] - corners[k, b, 1]
            turn = ax * by - ay * bx
            turning, area = turning and turn > 0, area + 0.25 * turn
            side = np.hypot(ax, ay)
            longest = side if not side <= longest else longest
        width[k], convex[k] = abs(area) / (longest if not longest < 1e-9 else 1e-9), turning
