"""Boxes that sessions were driven around: each has a size of its own, which all its robots' lengths follow."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.history.channels import KEYS, Series
from boxcal.calib.history.session import Session
from boxcal.target.arrays import Array

LEAST_ROBOTS = 3
"""Robots that must have driven around a box before its size is distinguished from their changes."""
_ROUNDS = 30
_LENGTHS = ("r", "b", "rL", "rR")
_PLACES = ("tx", "ty", "tz")


def of_one_size(fleet: Sequence[Series], sessions: Sequence[Sequence[Session]]) -> tuple[list[Series], set[str]]:
    """Return the series with all lengths scaled to one box, and the boxes of a size that could not be compared.

    Another box, or the same measured anew, changes the lengths of all its robots by one factor. It is found as the
    median, over robots, of what their radii differ from their own levels (median polish of a table of robots and
    boxes), so that single robots that changed do not count; the box with most sessions is the measure.

    Parameters
    ----------
    fleet
        Of each robot.
    sessions
        Of each robot, in the order of its series.
    """
    boxes = [s.target for own in sessions for s in own]
    kinds = sorted(set(boxes), key=lambda box: (-boxes.count(box), box))
    if len(kinds) < 2:
        return list(fleet), set()
    r = KEYS.index("r")
    robot = np.repeat(np.arange(len(fleet)), [len(s.years) for s in fleet])
    box = np.array([kinds.index(b) for b in boxes])
    known = np.concatenate([np.isfinite(s.variances[:, r]) for s in fleet])
    values = np.concatenate([s.values[:, r] for s in fleet])
    enough = np.array([len(set(robot[(box == k) & known].tolist())) >= LEAST_ROBOTS for k in range(len(kinds))])
    size = np.zeros(len(kinds))
    for _ in range(_ROUNDS):
        level = np.zeros(len(fleet))
        for i in set(robot[known].tolist()):
            level[i] = np.median((values - size[box])[known & (robot == i)])
        for k in np.flatnonzero(enough):
            size[k] = np.median((values - level[robot])[known & (box == k)])
        size -= size[0]
    ends = np.cumsum([len(s.years) for s in fleet])[:-1]
    told = [_without(s, own, d) for s, own, d in zip(fleet, sessions, np.split(size[box], ends), strict=True)]
    return told, {kind for kind, is_told in zip(kinds, enough, strict=True) if not is_told}


def _without(series: Series, sessions: Sequence[Session], size: Array) -> Series:
    """Return a robot's series with each session's lengths divided by the size of its box, relative to the measure."""
    values = series.values.copy()
    for key in _LENGTHS:
        values[:, KEYS.index(key)] -= size
    for axis, key in enumerate(_PLACES):
        values[:, KEYS.index(key)] -= size * np.array([s.T_body_cam[axis, 3] for s in sessions])
    return replace(series, values=values)
