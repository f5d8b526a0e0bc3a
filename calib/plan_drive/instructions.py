"""A plan in words: distances from the box's corners, and what to drive from stop to stop."""

from dataclasses import dataclass
from math import degrees, hypot, pi

import numpy as np

from boxcal.calib.planning.plan import DrivePlan, PlannedStop
from boxcal.target.box import Box

CORNERS = ("A", "B", "C", "D")
"""Corners of the base: A between faces 0 and 1, then counterclockwise as seen from above."""
_SMALL_TURN = pi / 90
_SHOWN = 3


def corner_places(box: Box) -> dict[str, tuple[float, float]]:
    """Return where the base's corners lie, m."""
    x, y = box.width / 2, box.depth / 2
    return dict(zip(CORNERS, ((x, y), (-x, y), (-x, -y), (x, -y)), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class TapedStop:
    """One stop as it is taped to the floor.

    Attributes
    ----------
    number
        From 1.
    from_corners : m
        Distances of the body's origin from the nearest three corners of the box's base, the nearest first.
    heading_deg
        Of the arrow, counterclockwise from the direction out of face 0.
    drive
        Path from the stop before, in words.
    """

    number: int
    from_corners: tuple[tuple[str, float], ...]
    heading_deg: float
    drive: str


def taped_stops(plan: DrivePlan) -> tuple[TapedStop, ...]:
    """Return all stops of a plan as they are taped to the floor."""
    corners = corner_places(plan.target.box)
    out = []
    for number, stop in enumerate(plan.stops, 1):
        x, y, heading = (float(v) for v in stop.pose)
        off = sorted(((name, hypot(x - cx, y - cy)) for name, (cx, cy) in corners.items()), key=lambda c: c[1])
        out.append(
            TapedStop(
                number=number,
                from_corners=tuple(off[:_SHOWN]),
                heading_deg=float((degrees(heading) + 180) % 360 - 180),
                drive=way_in_words(stop) if number > 1 else "Begin here.",
            )
        )
    return tuple(out)


def way_in_words(stop: PlannedStop) -> str:
    """Return the path to a stop: turns to the degree, straights to the centimetre; small turns go without saying."""
    parts = []
    for distance, turn in zip(stop.distance, stop.turn, strict=True):
        side = "left" if turn > 0 else "right"
        if distance == 0:
            if abs(turn) > _SMALL_TURN:
                parts.append(f"turn {side} {_turn(abs(float(turn)))}")
            continue
        move = f"{'back' if distance < 0 else 'forward'} {abs(distance):.2f} m"
        parts.append(move if turn == 0 else f"{move} in a curve to the {side}, {degrees(abs(turn)):.0f}\N{DEGREE SIGN}")
    text = ", ".join(parts)
    return f"{text[:1].upper()}{text[1:]}." if text else "Stay."


def _turn(angle: float) -> str:
    whole = int(np.floor((angle + _SMALL_TURN) / (2 * pi)))
    rest = degrees(angle - 2 * pi * whole)
    if not whole:
        return f"{rest:.0f}\N{DEGREE SIGN}"
    return f"{degrees(angle):.0f}\N{DEGREE SIGN} (a whole turn and {rest:.0f}\N{DEGREE SIGN})"
