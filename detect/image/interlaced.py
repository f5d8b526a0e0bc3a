"""Interlaced images of something that moved: two fields, of the even and of the odd rows, half a frame apart."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

_FIELDS = np.array([0.25, 0.5, 0.25])
"""Of a row and its neighbours: both fields count alike, and a row stays where it is."""


def averaged_fields(image: NDArray[Any]) -> NDArray[Any]:
    """Return an interlaced grey image (H, W) with its fields averaged in every row: blurred, and of the time midway."""
    return np.asarray(cv2.sepFilter2D(image, -1, np.ones(1), _FIELDS, borderType=cv2.BORDER_REFLECT_101))
