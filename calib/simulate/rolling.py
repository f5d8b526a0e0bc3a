"""Wheels that are not round or not alike in both directions, that slip or scrub: how far they roll, where they lead."""

import numpy as np

from boxcal.calib.simulate.imperfections import WheelFaults
from boxcal.calib.simulate.kinematics import arc_path
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array, Ids

_SPOT = 0.1
"""A turn is one on the spot where the body moves less than this fraction of what the wheels' rims do."""


def rolled(robot: Robot, w: WheelFaults, first: Array, dphi: Array, before: Array) -> tuple[Array, Array]:
    """Return how far each wheel rolls in each step (N, 2), m, and the direction in which each turned last (2,).

    Parameters
    ----------
    robot, w
        The wheels, and what is not exact about them.
    first : (2,), rad
        Their angles at the beginning, right and left.
    dphi : (N, 2), rad
        What the encoders see of each step.
    before : (2,)
        The direction in which each turned last before that: 1, -1, or 0 for not at all.
    """
    radius = np.array([robot.rR, robot.rL])
    start = first + np.concatenate([np.zeros((1, 2)), np.cumsum(dphi, axis=0)])
    turned = dphi.copy()
    direction = np.sign(dphi)
    last = before.copy()
    for k in (0, 1):
        moving = np.flatnonzero(direction[:, k])
        directions = np.concatenate([before[k : k + 1], direction[moving, k]])
        for i in np.flatnonzero((directions[1:] != directions[:-1]) & (directions[:-1] != 0)):
            _take(turned[:, k], moving[i:], w.backlash)
        last[k] = directions[-1]
    cosine, sine = np.array(w.eccentric[0::2]), np.array(w.eccentric[1::2])
    u = radius * (turned + cosine * np.diff(np.sin(start), axis=0) - sine * np.diff(np.cos(start), axis=0))
    u = u * np.where(dphi < 0, 1 + w.backward, 1.0)
    outer = np.sign(np.abs(u[:, :1]) - np.abs(u[:, 1:])) * (1.0, -1.0)
    return u * (1 + w.outer / 2 * outer), last


def _take(turned: Array, rows: Ids, backlash: float) -> None:
    """Take dead travel off the first steps after a reversal."""
    for row in rows:
        if backlash <= 0:
            return
        lost = min(backlash, abs(turned[row]))
        turned[row] -= np.sign(turned[row]) * lost
        backlash -= lost


def driven_path(start: Array, travel: Array, b: float, w: WheelFaults, leg: int) -> Array:
    """Return the poses (N, 3), m and rad, after each step of a leg.

    Parameters
    ----------
    start : (3,), m and rad
        Pose at the beginning.
    travel : (N, 2), m
        How far each wheel moves over the floor, right and left.
    b : m
        Wheel separation.
    w
        What is not exact.
    leg
        Number of the leg, from 0.
    """
    half = len(travel) // 2
    if w.slipped is not None and w.slipped[0] == leg:
        travel = travel.copy()
        travel[half] -= w.slipped[1:]
    distance, turn = travel.mean(axis=1), (travel[:, 0] - travel[:, 1]) / b
    left, right, spot = w.scrub
    on_spot = np.abs(distance) < _SPOT * np.abs(travel[:, 0] - travel[:, 1])
    turn = turn * (1 - np.where(turn > 0, left, right) - spot * on_spot)
    carried = w.carried is not None and w.carried[0] == leg
    if not carried and w.drift == 0:
        return arc_path(start, distance, turn)[1:]
    x, y, about = w.carried[1:] if carried and w.carried is not None else (0.0, 0.0, 0.0)
    heading = start[2] + np.concatenate([[0.0], np.cumsum(turn)])
    heading[half + 1 :] += about
    middle = heading[:-1] + turn / 2
    chord, aside = distance * np.sinc(turn / 2 / np.pi), w.drift * np.abs(turn)
    step = np.stack(
        [chord * np.cos(middle) - aside * np.sin(middle), chord * np.sin(middle) + aside * np.cos(middle)], axis=1
    )
    c, s = np.cos(heading[half]), np.sin(heading[half])
    step[half] += (c * x - s * y, s * x + c * y)
    return np.concatenate([start[:2] + np.cumsum(step, axis=0), heading[1:, None]], axis=1)
