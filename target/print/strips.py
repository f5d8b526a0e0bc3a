"""Free strips of a page, and search for a place for a mark in them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

BETWEEN_MARKS = 0.001
"""From one mark to the next in a strip, m."""
OFF_JOINT = 0.002
"""From a mark to a line at which tiles are joined, m."""
TINY = 1e-9
"""Rounding that does not count, m."""

Side = Literal["top", "bottom", "left", "right"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rect:
    """A rectangle on the page, m, x right and y up from the page's bottom left corner."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def width(self) -> float:
        """Extent along x, m."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Extent along y, m."""
        return self.top - self.bottom

    def overlaps(self, other: "Rect") -> bool:
        """Return whether the two share more than an edge."""
        across = min(self.right, other.right) - max(self.left, other.left)
        up = min(self.top, other.top) - max(self.bottom, other.bottom)
        return across > TINY and up > TINY


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """Area for one mark; if ``turned``, it is written from bottom to top instead of from left to right."""

    area: Rect
    turned: bool

    @property
    def length(self) -> float:
        """Extent along the writing, m."""
        return self.area.height if self.turned else self.area.width


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """A free strip of the page, filled from one side."""

    area: Rect
    start: Side

    @property
    def turned(self) -> bool:
        """Whether marks on it are written from bottom to top."""
        return self.start in {"left", "right"}

    @property
    def length(self) -> float:
        """Extent along the writing, m."""
        return self.area.height if self.turned else self.area.width

    @property
    def thickness(self) -> float:
        """Extent across the writing, m."""
        return self.area.width if self.turned else self.area.height

    def pieces(self, cuts: Sequence[float]) -> "list[Strip]":
        """Return the parts of the strip between cuts across its writing (m on the page), the longest first."""
        r = self.area
        low, high = (r.bottom, r.top) if self.turned else (r.left, r.right)
        ends = [low, *sorted(c for c in cuts if low < c < high), high]
        # A mark keeps off the joint itself.
        spans = [(a + OFF_JOINT * (a > low), b - OFF_JOINT * (b < high)) for a, b in pairwise(ends)]
        spans = sorted((s for s in spans if s[1] > s[0]), key=lambda s: round(s[0] - s[1], 9))
        if self.turned:
            return [replace(self, area=replace(r, bottom=a, top=b)) for a, b in spans]
        return [replace(self, area=replace(r, left=a, right=b)) for a, b in spans]

    def slot(self, offset: float, thickness: float, length: float) -> Rect:
        """Return a piece of the strip, centred along it, ``offset`` from the side where filling starts."""
        r, spare = self.area, (self.length - length) / 2
        near = {"top": r.top, "bottom": r.bottom, "left": r.left, "right": r.right}[self.start]
        sign = 1 if self.start in {"left", "bottom"} else -1
        low, high = sorted((near + sign * offset, near + sign * (offset + thickness)))
        if self.turned:
            return Rect(left=low, right=high, bottom=r.bottom + spare, top=r.top - spare)
        return Rect(left=r.left + spare, right=r.right - spare, bottom=low, top=high)

    def offset_past(self, other: Rect) -> float:
        """Return the offset at which the next mark clears another."""
        r = self.area
        past = {
            "top": r.top - other.bottom,
            "bottom": other.top - r.bottom,
            "left": other.right - r.left,
            "right": r.right - other.left,
        }
        return past[self.start] + BETWEEN_MARKS


def first_free(strip: Strip, taken: list[Rect], thickness: float, length: float | None) -> Slot | None:
    """Return the first place in a strip that no other mark has taken, if there is one."""
    wanted = strip.length if length is None else length
    offset = 0.0
    while wanted <= strip.length + TINY and offset + thickness <= strip.thickness + TINY:
        area = strip.slot(offset, thickness, wanted)
        clash = [other for other in taken if area.overlaps(other)]
        if not clash:
            return Slot(area=area, turned=strip.turned)
        offset = max(strip.offset_past(other) for other in clash)
    return None
