"""Face numbers as straight strokes: they need no font, and can be milled, cut or printed as bars."""

from itertools import pairwise

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import Box
from boxcal.target.cad.build import margins
from boxcal.target.tags.families import modules_per_side

_A, _B, _C, _D, _E, _F = (0.0, 1.0), (0.5, 1.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.0), (0.0, 0.5)
_STROKES = {
    0: ((_A, _B, _D, _E, _A),),
    1: ((_B, _D),),
    2: ((_A, _B, _C, _F, _E, _D),),
    3: ((_A, _B, _D, _E), (_F, _C)),
}
TALLEST = 0.010
"""Height of a number, m, where there is space."""
_LEAST = 0.002
"""Space below the tags that a number needs, m."""
_BREADTH = 0.12
"""Breadth of a stroke, as a fraction of the height."""


def strokes(digit: int, height: float) -> tuple[Array, ...]:
    """Return the centre lines of a digit 0 to 3, each (N, 2) m, about its middle."""
    scale = height * (1 - _BREADTH)
    return tuple((np.array(line) - (0.25, 0.5)) * scale for line in _STROKES[digit])


def bars(digit: int, height: float) -> tuple[tuple[Array, Array], ...]:
    """Return the rectangles that make up a digit: low and high corner, each (2,) m, about its middle; they overlap."""
    half = height * _BREADTH / 2
    found = []
    for line in strokes(digit, height):
        found += [(np.minimum(a, b) - half, np.maximum(a, b) + half) for a, b in pairwise(line)]
    return tuple(found)


def face_number(box: Box, face: int) -> tuple[Array, float] | None:
    """Return where a face's number stands, (2,) m in frame ``face``, and its height: below the tags' white border.

    None where the tags leave no room to read it.
    """
    _, below = margins(box, face)
    room = below - box.tag_size / modules_per_side(box.dictionary)
    if room < _LEAST:
        return None
    return np.array([0.0, (room - box.height) / 2]), min(0.8 * room, TALLEST)


def T_box_lid_number(box: Box, face: int) -> Array:
    """Return the pose (4, 4) of a face's number on top of the box: upright for who stands before the face."""
    T = box.T_box_face(face)
    half = (box.width if face % 2 == 0 else box.depth) / 2
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1] = T[:3, 0], -T[:3, 2]
    pose[:3, 3] = (half - lid_number_inset(box)) * T[:3, 2] + (0, 0, box.height)
    return pose


def lid_number_inset(box: Box) -> float:
    """Return how far the middle of a number on the lid lies from the edge of the box, m."""
    return min(2 * TALLEST, min(box.width, box.depth) / 5)


def lid_number_height(box: Box) -> float:
    """Return the height of the numbers on the lid, m."""
    return min(TALLEST, min(box.width, box.depth) / 10)
