"""The black and white modules of a tag, from OpenCV's dictionaries.

OpenCV is imported where it is needed, so that a command's ``--help`` does not wait for it.
"""

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from boxcal.target.errors import TargetError

if TYPE_CHECKING:
    import cv2

_PREFIX = "DICT_"
BORDER_MODULES = 1
"""Width of a tag's black border in modules; OpenCV's families all use one."""


def dictionary_names() -> tuple[str, ...]:
    """Return the names of all tag families that can be used, sorted."""
    import cv2  # noqa: PLC0415

    return tuple(sorted(name for name in dir(cv2.aruco) if name.startswith(_PREFIX)))


@cache
def load_dictionary(name: str) -> "cv2.aruco.Dictionary":
    """Return OpenCV's dictionary of that name, such as ``DICT_APRILTAG_36h11``.

    Raises
    ------
    TargetError
        If no family has that name; the message lists the valid ones.
    """
    import cv2  # noqa: PLC0415

    if name not in dictionary_names():
        valid = ", ".join(dictionary_names())
        raise TargetError(f"dictionary {name!r}: no such tag family", remedy=f"use one of {valid}")
    return cv2.aruco.getPredefinedDictionary(int(getattr(cv2.aruco, name)))


def family_size(name: str) -> int:
    """Return how many ids the family has."""
    return int(load_dictionary(name).bytesList.shape[0])


def modules_per_side(name: str) -> int:
    """Return the modules along a tag's side, black border included (8 for 36h11)."""
    return int(load_dictionary(name).markerSize) + 2 * BORDER_MODULES


def tag_modules(name: str, tag_id: int) -> NDArray[np.bool_]:
    """Return a tag's modules, border included, seen upright.

    Parameters
    ----------
    name
        Tag family, as :func:`load_dictionary` takes it.
    tag_id
        Id within the family.

    Returns
    -------
    (M, M) bool, row 0 at the top; true is white.

    Raises
    ------
    TargetError
        If the family has no such id.
    """
    import cv2  # noqa: PLC0415

    if not 0 <= tag_id < family_size(name):
        raise TargetError(f"tag id {tag_id}: {name} has ids 0 to {family_size(name) - 1}", remedy="use one of them")
    side = modules_per_side(name)
    image = cv2.aruco.generateImageMarker(load_dictionary(name), tag_id, side, borderBits=BORDER_MODULES)
    return np.asarray(image > 127)
