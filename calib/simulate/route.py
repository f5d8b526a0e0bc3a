"""Paths from stop to stop that keep off the box: turns on the spot, arcs and straights, forwards or backwards."""

from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, pi, radians, remainder, sin

import numpy as np

from boxcal.calib.simulate.kinematics import Arc, arc_path
from boxcal.target.arrays import Array
from boxcal.target.box import Box

_RING_STEP = radians(30)
_LEAST = 1e-9
_CHECKED = 41
"""Points along a hop at which its distance to the box is checked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepOut:
    """The part of the floor that the body's origin must not enter.

    Attributes
    ----------
    half_x, half_y : m
        Half the box's base.
    gap : m
        How far the origin must stay off the box's walls.
    """

    half_x: float
    half_y: float
    gap: float

    @classmethod
    def around(cls, box: Box, gap: float) -> "KeepOut":
        """Return the keep-out of a box."""
        return cls(half_x=box.width / 2, half_y=box.depth / 2, gap=gap)

    def off_box(self, xy: Array) -> Array:
        """Return the distances (N,), m, of points (N, 2) to the box's base; 0 on and in it."""
        over = np.maximum(np.abs(xy) - (self.half_x, self.half_y), 0)
        return np.asarray(np.hypot(over[:, 0], over[:, 1]))

    def ring(self) -> float:
        """Return the radius at which a polygon with corners every 30 deg about the box keeps off it, m."""
        return (hypot(self.half_x, self.half_y) + self.gap) / cos(_RING_STEP / 2)

    def clear(self, start: Array, arc: Arc) -> bool:
        """Return whether an arc from a pose (3,) keeps off; where an end is closer already, comes no closer."""
        n = _CHECKED - 1
        xy = arc_path(start, np.full(n, arc.distance / n), np.full(n, arc.turn / n))[:, :2]
        off = self.off_box(xy)
        return bool(off.min() >= min(self.gap, off[0], off[-1]) - 1e-6)


def route(
    start: Array, goal: Array, keep_out: KeepOut, rng: np.random.Generator | None, *, exact_heading: bool
) -> list[Arc]:
    """Return the arcs that lead from a pose to another without touching the box.

    Each hop is a turn on the spot and an arc; a last turn gives the heading. Where the direct hop would come too
    close, the path leads round the box, on the shorter side. To where the robot is, it is one arc of no length.

    Parameters
    ----------
    start, goal : (3,), m and rad
        x, y and heading.
    keep_out
        Where not to go.
    rng
        Draws bends and gears; without it hops are straight, in the gear that needs the smaller first turn.
    exact_heading
        Whether the goal's heading holds as a number, so that 2 pi more is one turn more; otherwise modulo 2 pi.
    """
    arcs: list[Arc] = []
    here = start
    stations = _stations(start[:2], goal[:2], keep_out)
    backwards: bool | None = None
    for station in stations:
        chord = station - here[:2]
        if hypot(*chord) < _LEAST:
            continue
        if backwards is None:
            backwards = abs(remainder(atan2(chord[1], chord[0]) - here[2], 2 * pi)) > pi / 2 + _LEAST
            if rng is not None and rng.random() < 0.15:
                backwards = not backwards
        for bend in _bends(rng):
            turn, arc = _hop(here, station, bend, backwards)
            turned = here + np.array([0.0, 0.0, turn])
            if bend == 0 or keep_out.clear(turned, arc):
                break
        arcs += [Arc(distance=0.0, turn=turn), arc]
        here = np.array([*station, turned[2] + arc.turn])
    last = float(goal[2] - here[2])
    arcs.append(Arc(distance=0.0, turn=last if exact_heading else remainder(last, 2 * pi)))
    moved = [a for a in arcs if abs(a.distance) > _LEAST or abs(a.turn) > _LEAST]
    return moved or [Arc(distance=0.0, turn=0.0)]


def _bends(rng: np.random.Generator | None) -> tuple[float, ...]:
    if rng is None:
        return (0.0,)
    bend = float(rng.uniform(-1.2, 1.2))
    return (bend, -bend, bend / 2, -bend / 2, 0.0)


def _hop(start: Array, goal_xy: Array, bend: float, backwards: bool) -> tuple[float, Arc]:
    """Return the first turn (rad) and the arc with a given change of heading that lead from a pose to a place."""
    dx, dy = goal_xy - start[:2]
    half = bend / 2
    distance = hypot(dx, dy) * (half / sin(half) if half else 1.0)
    heading = atan2(dy, dx) - half + (pi if backwards else 0.0)
    turn = remainder(heading - start[2], 2 * pi)
    return turn, Arc(distance=-distance if backwards else distance, turn=bend)


def _stations(start: Array, goal: Array, keep_out: KeepOut) -> list[Array]:
    """Return the places to pass, the goal last, so that straight hops between them keep off the box."""

    def straight(p: Array, q: Array) -> bool:
        dx, dy = q - p
        return keep_out.clear(np.array([*p, atan2(dy, dx)]), Arc(distance=hypot(dx, dy), turn=0.0))

    if straight(start, goal):
        return [goal]
    first, last = atan2(start[1], start[0]), atan2(goal[1], goal[0])
    round_by = remainder(last - first, 2 * pi)
    fraction = np.linspace(0, 1, ceil(abs(round_by) / _RING_STEP) + 1)
    radius = np.maximum(keep_out.ring(), hypot(*start) * (1 - fraction) + hypot(*goal) * fraction)
    angle = first + fraction * round_by
    places = [start, *np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), goal]
    kept, at = [], 0
    while at < len(places) - 1:
        # Moving straight away from the middle never comes closer, so the next place can always be reached.
        at = next((k for k in range(len(places) - 1, at + 1, -1) if straight(places[at], places[k])), at + 1)
        kept.append(places[at])
    return kept
