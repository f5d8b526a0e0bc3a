"""Drawings of the box as lines on paper: from above, and from a corner with its tags in place."""

from math import cos, radians, sin, sqrt
from typing import TYPE_CHECKING

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import Box, Target
from boxcal.target.print.ink import POINT, Point, draw_line, draw_shape, draw_tags
from boxcal.target.print.strips import Rect

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

_ELEVATION = radians(22)
_EDGE = 0.00035


class CornerView:
    """The box seen from above its edge between face 0 (left) and face 1 (right), without perspective."""

    def __init__(self, box: Box, area: Rect) -> None:
        right = np.array([-1, 1, 0]) / sqrt(2)
        up = np.array([-sin(_ELEVATION) / sqrt(2), -sin(_ELEVATION) / sqrt(2), cos(_ELEVATION)])
        self._box = box
        self._axes = np.stack([right, up])
        corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) / 2
        seen = corners * (box.width, box.depth, box.height) @ self._axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        self._scale = float(min(area.width / (high - low)[0], area.height / (high - low)[1]))
        middle = np.array([area.left + area.right, area.bottom + area.top]) / 2
        self._shift = middle - self._scale * (low + high) / 2

    def place(self, x: float, y: float, z: float) -> Point:
        """Return where a point lies on the page; x, y, z count in halves of width and depth, and in heights."""
        p = np.array([x * self._box.width / 2, y * self._box.depth / 2, z * self._box.height])
        u, v = self._scale * (self._axes @ p) + self._shift
        return float(u), float(v)

    def draw(self, canvas: "Canvas", target: Target | None) -> None:
        """Draw the box, with its tags if a target is given."""
        at = self.place
        draw_shape(canvas, at(1, -1, 1), at(1, 1, 1), at(-1, 1, 1), at(-1, -1, 1), grey=0.9)
        if target is not None:
            for face in (0, 1):
                self.draw_face(canvas, target, face)
        for corners in (
            (at(1, -1, 0), at(1, 1, 0), at(1, 1, 1), at(1, -1, 1)),
            (at(1, 1, 0), at(-1, 1, 0), at(-1, 1, 1), at(1, 1, 1)),
            (at(1, -1, 1), at(1, 1, 1), at(-1, 1, 1), at(-1, -1, 1)),
        ):
            draw_line(canvas, *corners, width=_EDGE, close=True)

    def draw_face(self, canvas: "Canvas", target: Target, face: int, off: float = 0.0) -> None:
        """Draw a face's tags where they stand, or off the box by a fraction of its half width or depth."""
        T: Array = self._box.T_box_face(face)
        T[:2, 3] *= 1 + off
        (a, b), (c, d) = (self._scale * (self._axes @ T[:3, k]) for k in (0, 1))
        e, f = (self._scale * (self._axes @ T[:3, 3]) + self._shift) / POINT
        canvas.saveState()
        canvas.transform(float(a), float(b), float(c), float(d), float(e), float(f))
        draw_tags(canvas, target, face, (0.0, 0.0))
        canvas.restoreState()


def plan(box: Box, area: Rect) -> Rect:
    """Return the box as seen from above, y up the page and x to the right, centred in an area."""
    scale = min(area.width / box.width, area.height / box.depth)
    x, y = (area.left + area.right) / 2, (area.bottom + area.top) / 2
    half = scale * box.width / 2, scale * box.depth / 2
    return Rect(left=x - half[0], right=x + half[0], bottom=y - half[1], top=y + half[1])


def draw_plan(canvas: "Canvas", rect: Rect) -> None:
    """Draw the box from above."""
    corners = ((rect.left, rect.bottom), (rect.right, rect.bottom), (rect.right, rect.top), (rect.left, rect.top))
    draw_shape(canvas, *corners, grey=0.9)
    draw_line(canvas, *corners, width=_EDGE, close=True)
