"""Dubins curves: shortest paths between poses for a given turning radius, two turns and a straight or three turns.

L. E. Dubins, "On curves of minimal length with a constraint on average curvature", American Journal of Mathematics
79:497-516, 1957, DOI 10.2307/2372560; closed forms after A. M. Shkel and V. Lumelsky, "Classification of the Dubins
set", Robotics and Autonomous Systems 34:179-202, 2001, DOI 10.1016/S0921-8890(00)00127-5.
"""

from collections.abc import Iterator
from math import pi

import numpy as np

from boxcal.target.arrays import Array

_POINTS = 12
"""Points along each of the three pieces at which a curve is checked."""


def dubins_curves(starts: Array, goals: Array, radius: float) -> Iterator[tuple[Array, Array]]:
    """Yield distances (N, 3), m, and turns (N, 3), rad, of all six kinds of curve between poses (N, 3).

    Where a kind does not reach, its distances are infinite.
    """
    delta = goals - starts
    d = np.hypot(delta[:, 0], delta[:, 1]) / radius
    along = np.arctan2(delta[:, 1], delta[:, 0])
    a, b = (starts[:, 2] - along) % (2 * pi), (goals[:, 2] - along) % (2 * pi)
    for kind, lengths in _kinds(d, a, b):
        sign = np.array([{"L": 1.0, "S": 0.0, "R": -1.0}[letter] for letter in kind])
        reached = np.all(np.isfinite(lengths), axis=1)
        arcs = np.where(reached[:, None], lengths, 0.0)
        yield np.where(reached[:, None], arcs * radius, np.inf), arcs * sign


def _kinds(d: Array, a: Array, b: Array) -> Iterator[tuple[str, Array]]:
    """Yield each kind's three lengths in radii, (N, 3), NaN where it does not reach."""
    sa, ca, sb, cb, c = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.cos(a - b)
    with np.errstate(invalid="ignore"):
        p = np.sqrt(2 + d**2 - 2 * c + 2 * d * (sa - sb))
        to = np.arctan2(cb - ca, d + sa - sb)
        yield "LSL", _pieces(to - a, p, b - to)
        p = np.sqrt(2 + d**2 - 2 * c + 2 * d * (sb - sa))
        to = np.arctan2(ca - cb, d - sa + sb)
        yield "RSR", _pieces(a - to, p, to - b)
        p = np.sqrt(-2 + d**2 + 2 * c + 2 * d * (sa + sb))
        to = np.arctan2(-ca - cb, d + sa + sb) - np.arctan2(-2.0, p)
        yield "LSR", _pieces(to - a, p, to - b)
        p = np.sqrt(-2 + d**2 + 2 * c - 2 * d * (sa + sb))
        to = np.arctan2(ca + cb, d - sa - sb) - np.arctan2(2.0, p)
        yield "RSL", _pieces(a - to, p, b - to)
        p = 2 * pi - np.arccos((6 - d**2 + 2 * c + 2 * d * (sa - sb)) / 8)
        t = a - np.arctan2(ca - cb, d - sa + sb) + p / 2
        yield "RLR", _pieces(t, p, a - b - t + p)
        p = 2 * pi - np.arccos((6 - d**2 + 2 * c + 2 * d * (sb - sa)) / 8)
        t = np.arctan2(cb - ca, d + sa - sb) - a + p / 2
        yield "LRL", _pieces(t, p, b - a - t + p)


def _pieces(first: Array, middle: Array, last: Array) -> Array:
    return np.stack([first % (2 * pi), middle, last % (2 * pi)], axis=1)


def points_along(starts: Array, distance: Array, turn: Array) -> Array:
    """Return points (N, K, 2) along chains of three arcs from poses (N, 3)."""
    ds = np.repeat(distance / _POINTS, _POINTS, axis=1)
    dth = np.repeat(turn / _POINTS, _POINTS, axis=1)
    end = starts[:, 2:] + np.cumsum(dth, axis=1)
    middle = end - dth / 2
    chord = ds * np.sinc(dth / (2 * pi))
    x = starts[:, :1] + np.cumsum(chord * np.cos(middle), axis=1)
    y = starts[:, 1:2] + np.cumsum(chord * np.sin(middle), axis=1)
    return np.stack([x, y], axis=2)
