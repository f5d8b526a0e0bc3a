"""Wheels on the floor: smooth turns of the wheels, what slip makes of them, and the path that comes out."""

from dataclasses import dataclass
from math import ceil, pi, sqrt

import numpy as np

from boxcal.target.arrays import Array

MAX_ACCELERATION = 1.0
"""Of a wheel's rim, m/s^2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """A piece of path of constant curvature, from standstill to standstill.

    Attributes
    ----------
    distance : m
        Rolled by the body's origin; negative backwards, 0 for a turn on the spot.
    turn : rad
        Change of heading, positive to the left.
    """

    distance: float
    turn: float


def arc_progress(arc: Arc, b: float, max_speed: float, step_s: float) -> Array:
    """Return the fraction of an arc that lies behind at each step's end, (N,), ascending to 1.

    The speed is a raised cosine over time, so it starts and ends smoothly. Its peak on the faster wheel's rim is
    ``max_speed`` (m/s), or what 1 m/s^2 allows on a short arc. It is constant within a step.
    """
    rim = abs(arc.distance) + b / 2 * abs(arc.turn)
    steps = max(ceil(max(2 * rim / max_speed, sqrt(2 * pi * rim / MAX_ACCELERATION)) / step_s), 1)
    fraction = np.arange(1, steps + 1) / steps
    progress: Array = fraction - np.sin(2 * pi * fraction) / (2 * pi)
    progress[-1] = 1.0
    return progress


def wheel_turns(
    arcs: list[Arc], *, rR: float, rL: float, b: float, max_speed: float, step_s: float
) -> tuple[Array, Array]:
    """Return the angles (rad) that the right and left wheel turn in each step, (N,) and (N,), if nothing slips.

    The inverse of ``v = (rR wR + rL wL)/2``, ``w = (rR wR - rL wL)/b`` (Antonelli et al. 2010, eq. 2).
    """
    none = np.zeros(0)
    dphi_R, dphi_L = [none], [none]
    for arc in arcs:
        fraction = np.diff(arc_progress(arc, b, max_speed, step_s), prepend=0.0)
        dphi_R.append(fraction * ((arc.distance + b / 2 * arc.turn) / rR))
        dphi_L.append(fraction * ((arc.distance - b / 2 * arc.turn) / rL))
    return np.concatenate(dphi_R), np.concatenate(dphi_L)


def slipped(distance: Array, slip: float, rng: np.random.Generator) -> Array:
    """Return the distances that a wheel moves over the floor, (N,) m, where it rolled the given ones.

    The error has zero mean and the variance ``slip^2 |distance|``, so that its standard deviation over a whole path
    is ``slip`` times the square root of the path's length, however it is cut into steps.

    Parameters
    ----------
    distance : (N,), m
    slip : m per sqrt(m)
    """
    if slip == 0:
        return distance
    return np.asarray(distance + slip * np.sqrt(np.abs(distance)) * rng.standard_normal(distance.shape))


def arc_path(start: Array, distance: Array, turn: Array) -> Array:
    """Return the poses (x, y, heading) along a chain of arcs, (N + 1, 3), the start included.

    Exact: the chord of an arc is ``distance * sin(turn/2)/(turn/2)`` along its middle heading.

    Parameters
    ----------
    start : (3,), m and rad
    distance, turn : (N,), m and rad
    """
    heading = start[2] + np.concatenate([[0.0], np.cumsum(turn)])
    middle = heading[:-1] + turn / 2
    chord = distance * np.sinc(turn / (2 * pi))
    x = start[0] + np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y = start[1] + np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    return np.stack([x, y, heading], axis=1)


def within_arc(start: Array, end: Array, fraction: Array) -> Array:
    """Return the poses (N, 3) at a fraction (N,), 0..1, of the arcs from start to end poses, (N, 3) each."""
    turn = end[:, 2] - start[:, 2]
    middle = start[:, 2] + turn / 2
    along = (end[:, 0] - start[:, 0]) * np.cos(middle) + (end[:, 1] - start[:, 1]) * np.sin(middle)
    distance = along / np.sinc(turn / (2 * pi))
    part = fraction * turn
    chord = fraction * distance * np.sinc(part / (2 * pi))
    heading = start[:, 2] + part / 2
    return np.stack(
        [start[:, 0] + chord * np.cos(heading), start[:, 1] + chord * np.sin(heading), start[:, 2] + part], axis=1
    )
