"""Advice to the driver: how far the goal is, which stops come next, and the path to the first of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, pi, sin

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.guide.drive.whereabouts import Whereabouts
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.planning.goal import Bar, Goal, bars_of_estimate
from boxcal.calib.planning.next_stops import NextStop, first_stops, what_next
from boxcal.calib.simulate.kinematics import arc_path
from boxcal.calib.simulate.robot import Robot, turtlebot
from boxcal.calib.simulate.route import KeepOut, route
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import Target

CLEARANCE_M = 0.15
_LEAST_M, _LEAST_DEG = 0.02, 2.0
_POINTS = 8
"""Points of an arc that a map shows."""
_FIRST = 3
_RING, _RING_FROM, _RING_STEP = 3.4, 2.6, 2.2
"""Radius in half diagonals of the box's base, and angles (rad), of places where nothing better is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A stop to drive to.

    Attributes
    ----------
    x, y, heading : m, m, rad
        Of the body, in the box's frame.
    whole_turns
        Whole turns on the spot, to the left, to make there first.
    gain
        Sentence about what it promises, empty where nothing is known yet.
    """

    x: float
    y: float
    heading: float
    whole_turns: int = 0
    gain: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """The path to a place.

    Attributes
    ----------
    steps
        What to do, a few words each.
    points : (N, 2)
        Along it, m, for a map.
    """

    steps: tuple[str, ...]
    points: tuple[tuple[float, float], ...]


def bars(estimate: Estimate, goal: Goal, image_size: tuple[int, int]) -> tuple[Bar, ...]:
    """Return the quantities that a user cares about, beside their goals."""
    return bars_of_estimate(estimate, goal, image_size)


def next_places(
    estimate: Estimate, drive: Correspondences, target: Target, goal: Goal, count: int = 2
) -> tuple[Place, ...]:
    """Return the most informative next places, in the order to drive to them."""
    found = what_next(estimate, [drive], target, goal=goal, count=count)
    return tuple(Place(x=s.x, y=s.y, heading=s.heading, whole_turns=s.whole_turns, gain=_gain(s)) for s in found)


def first_places(target: Target, taken: int, image_size: tuple[int, int] | None) -> tuple[Place, ...]:
    """Return the places of the first stops that are still to be taken, for a robot of which nothing is known."""
    poses = _first_poses(target, image_size or (640, 480)).tolist()
    first = [Place(x=x, y=y, heading=heading) for x, y, heading in poses]
    return tuple((first + [_another(target, k) for k in range(taken + 2 - len(first))])[taken : taken + 2])


def _another(target: Target, k: int) -> Place:
    """Return a further place, where the first ones determine nothing: each with a whole turn in the other direction."""
    radius = _RING * hypot(target.box.width, target.box.depth) / 2
    angle = _RING_FROM + k * _RING_STEP
    x, y = radius * cos(angle), radius * sin(angle)
    return Place(x=x, y=y, heading=angle - pi, whole_turns=1 if k % 2 else -1)


_FIRST_POSES: dict[tuple[int, int], Array] = {}


def _first_poses(target: Target, image_size: tuple[int, int]) -> Array:
    if image_size not in _FIRST_POSES:
        try:
            _FIRST_POSES[image_size] = first_stops(_usual_robot(image_size), target, count=_FIRST)
        except CalibError:
            others = [_another(target, k) for k in range(_FIRST)]
            _FIRST_POSES[image_size] = np.array([[p.x, p.y, p.heading] for p in others])
    return _FIRST_POSES[image_size]


def _usual_robot(image_size: tuple[int, int]) -> Robot:
    usual = turtlebot()
    scale = image_size[0] / usual.image_size[0]
    values = usual.camera.values.copy()
    values[:4] *= scale
    camera = type(usual.camera).from_values(usual.camera.kind, values)
    return Robot(
        name=usual.name,
        camera=camera,
        image_size=image_size,
        rR=usual.rR,
        rL=usual.rL,
        b=usual.b,
        T_body_cam=usual.T_body_cam,
    )


def route_to(place: Place, here: Whereabouts, target: Target, reach: float) -> Route:
    """Return how to drive to a place without touching the box.

    Parameters
    ----------
    place
        Where to.
    here
        Where the robot is.
    target
        The box.
    reach : m
        How far the robot's outermost part is from its middle.
    """
    start = np.array([here.x, here.y, here.heading])
    goal = np.array([place.x, place.y, place.heading])
    keep_out = KeepOut.around(target.box, CLEARANCE_M / 2 + reach)
    try:
        arcs = route(start, goal, keep_out, None, exact_heading=False)
    except CalibError:
        return Route(steps=_straight(start, goal), points=((here.x, here.y), (place.x, place.y)))
    pose, points, steps = start, [(float(start[0]), float(start[1]))], []
    for arc in arcs:
        path = arc_path(pose, np.full(_POINTS, arc.distance / _POINTS), np.full(_POINTS, arc.turn / _POINTS))
        pose = path[-1]
        if abs(arc.distance) > _LEAST_M:
            points += [(float(x), float(y)) for x, y in (path[1:, :2] if abs(arc.turn) > 1e-6 else path[-1:, :2])]
        steps += _said(arc.distance, arc.turn)
    if place.whole_turns:
        steps.append(f"turn once around to the {'left' if place.whole_turns > 0 else 'right'}")
    return Route(steps=tuple(steps), points=tuple(points))


def _said(distance: float, turn: float) -> list[str]:
    angle = degrees(turn)
    side = "left" if angle > 0 else "right"
    ahead = f"{abs(distance):.2f} m {'ahead' if distance > 0 else 'back'}"
    if abs(distance) < _LEAST_M:
        return [f"turn {side} {abs(angle):.0f}\N{DEGREE SIGN}"] if abs(angle) > _LEAST_DEG else []
    return [ahead if abs(angle) < _LEAST_DEG else f"{ahead} in a curve to the {side}"]


def _straight(start: Array, goal: Array) -> tuple[str, ...]:
    d = goal[:2] - start[:2]
    towards = degrees((atan2(d[1], d[0]) - start[2] + pi) % (2 * pi) - pi)
    return (*_said(0.0, np.radians(towards)), *_said(float(np.hypot(*d)), 0.0))


def _gain(stop: NextStop) -> str:
    return stop.text.rpartition(": ")[2].rstrip(".")


def reached(found: Sequence[Bar]) -> bool:
    """Return whether all goals are reached."""
    return bool(found) and all(bar.reached for bar in found)
