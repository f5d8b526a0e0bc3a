"""Outlines of dark places that have four sides: what a tag's border looks like.

:mod:`boxcal.detect.alignment.numba.outlines` finds the same.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array

LEAST_FULL = 0.02
"""Area of an outline over its length squared, at least: a quadrilateral is then not thinner than 1 : 8."""
MOST_DEVIATION, LEAST_DEVIATION_PX = 0.035, 1.2
"""How far an outline may run beside the polygon that stands for it, lengths of the outline; but this many px always."""


def four_sided(binary: NDArray[np.uint8], least: int, most: int) -> Array:
    """Return the corners of dark places that have four sides, (N, 4, 2) px, clockwise as seen.

    Corners are centres of dark pixels.

    Parameters
    ----------
    binary : (H, W)
        1 where dark, 0 elsewhere.
    least, most
        Pixels of an outline.
    """
    contours, _ = cv2.findContours(binary, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return np.array(list(_four_sided(contours, least, most)), dtype=np.float64).reshape(-1, 4, 2)


def _four_sided(contours: Sequence[Any], least: int, most: int) -> Iterator[Array]:
    for contour in [c for c in contours if least <= len(c) <= most]:
        length = len(contour)
        area = cv2.contourArea(contour, oriented=True)
        # outer outlines are negative
        if -area < LEAST_FULL * length * length:
            continue
        polygon = cv2.approxPolyDP(contour, max(MOST_DEVIATION * length, LEAST_DEVIATION_PX), closed=True)
        if len(polygon) == 4 and cv2.isContourConvex(polygon):
            yield polygon[::-1, 0]
