"""The floor that a robot may drive on: its bounds, what stands on it, and how far to keep off."""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.target.arrays import Array, Mask
from boxcal.target.box import Box

Rectangle = tuple[float, float, float, float]
"""x0, y0, x1, y1 along the box's axes, m."""
_NEVER = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """A floor around the box, in the box's frame.

    Attributes
    ----------
    bounds : m
        Rectangle that the robot may not leave; unbounded by default.
    obstacles : m
        Rectangles that it may not enter.
    clearance : m
        How far its outermost part stays off box, obstacles and bounds.
    """

    bounds: Rectangle = (-10.0, -10.0, 10.0, 10.0)
    obstacles: tuple[Rectangle, ...] = ()
    clearance: float = 0.15

    def __post_init__(self) -> None:
        for name, rectangle in (("bounds", self.bounds), *(("an obstacle", o) for o in self.obstacles)):
            x0, y0, x1, y1 = rectangle
            if not (all(map(isfinite, rectangle)) and x0 < x1 and y0 < y1):
                raise CalibError(
                    f"{name} of the floor: {rectangle}", needed="X0 Y0 X1 Y1 in m with X0 < X1 and Y0 < Y1 is needed"
                )
        if not (isfinite(self.clearance) and self.clearance >= 0):
            raise CalibError(f"clearance is {self.clearance} m", needed="a length from 0 on")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeSpace:
    """Free part of the floor for one robot's origin.

    Attributes
    ----------
    low, high : (2,), m
        Corners of the rectangle that it stays in.
    blocked : (K, 4), m
        Rectangles x0, y0, x1, y1 that it stays out of: box and obstacles, enlarged by reach and clearance.
    solid : (K, 4), m
        The same enlarged by its reach only.
    """

    low: Array
    high: Array
    blocked: Array
    solid: Array

    def free(self, xy: Array) -> Mask:
        """Return which points (N, 2) the origin may be at."""
        inside = np.all((xy >= self.low) & (xy <= self.high), axis=1)
        x0, y0, x1, y1 = self.blocked.T
        x, y = xy[:, :1], xy[:, 1:]
        hit = (x > x0 + _NEVER) & (x < x1 - _NEVER) & (y > y0 + _NEVER) & (y < y1 - _NEVER)
        return np.asarray(inside & ~np.any(hit, axis=1))

    def clear(self, start: Array, end: Array) -> Mask:
        """Return which straight paths from points (N, 2) to points (N, 2) touch nothing (slab method)."""
        low, high, ignored = self._in_the_way(start, end)
        p, d = start[:, None], (end - start)[:, None]  # (N, 1, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - p) / d, (high - p) / d
        parallel = np.abs(d) < _NEVER
        within = (p > low) & (p < high)
        enter = np.where(parallel, np.where(within, -np.inf, np.inf), np.minimum(a, b)).max(axis=2)
        leave = np.where(parallel, np.where(within, np.inf, -np.inf), np.maximum(a, b)).min(axis=2)
        hit = (np.maximum(enter, 0.0) < np.minimum(leave, 1.0)) & (leave > 0) & (enter < 1)
        return np.asarray(~np.any(hit & ~ignored, axis=1))

    def _in_the_way(self, start: Array, end: Array) -> tuple[Array, Array, Mask]:
        """Return the rectangles' corners (N, K, 2), and which of them do not count (N, K), for paths between points.

        A robot that stands closer than it should may drive away: then only what it would touch is an obstacle, and what
        it touches already is not.
        """

        def holding(rectangles: Array) -> Mask:
            low, high = rectangles[:, :2] + _NEVER, rectangles[:, 2:] - _NEVER
            inside = [np.all((q[:, None] > low) & (q[:, None] < high), axis=2) for q in (start, end)]
            return np.asarray(inside[0] | inside[1])

        too_close, touching = holding(self.blocked)[:, :, None], holding(self.solid)
        low = np.where(too_close, self.solid[:, :2], self.blocked[:, :2]) + _NEVER
        high = np.where(too_close, self.solid[:, 2:], self.blocked[:, 2:]) - _NEVER
        return low, high, touching


def free_space(floor: Floor, box: Box, reach: float) -> FreeSpace:
    """Return where a robot whose outermost part is ``reach`` (m) from its origin may be.

    Raises
    ------
    CalibError
        If the floor leaves no room.
    """
    gap = floor.clearance + reach
    low, high = np.array(floor.bounds[:2]) + gap, np.array(floor.bounds[2:]) - gap
    half = np.array([box.width, box.depth]) / 2
    standing, outward = np.array([(*-half, *half), *floor.obstacles]), np.array([-1.0, -1.0, 1.0, 1.0])
    if np.any(low >= high):
        raise CalibError(
            f"the floor {floor.bounds} leaves no room for a robot that reaches {reach:.2f} m and keeps "
            f"{floor.clearance:.2f} m off",
            remedy="give a larger floor or a smaller clearance",
        )
    return FreeSpace(low=low, high=high, blocked=standing + gap * outward, solid=standing + reach * outward)
