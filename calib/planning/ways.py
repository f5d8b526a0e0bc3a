"""Ways from stop to stop: turns on the spot and straights around what stands there, or curves of a turning radius."""

from dataclasses import dataclass
from math import pi

import numpy as np

from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.planning.floor import FreeSpace
from boxcal.target.arrays import Array, Ids, Mask

_TINY = 1e-9
_OFF_CORNER = 1e-6
_MOST_TURN = 2.9 * pi
"""Largest net turn of a leg, rad: images give headings modulo a turn, and what is far off is not told apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ways:
    """N ways, each a chain of arcs from standstill to standstill; unused arcs are zero.

    Attributes
    ----------
    distance, turn : (N, A), m and rad
        Way of the body's origin (negative backwards) and change of heading of each arc.
    possible : (N,) bool
        Whether there is such a way.
    """

    distance: Array
    turn: Array
    possible: Mask

    @property
    def length(self) -> Array:
        """Length of the ways of the body's origin, (N,), m."""
        return np.asarray(np.abs(self.distance).sum(axis=1))

    def rolled(self, b: float) -> Array:
        """Return how far the faster wheel's rim rolls along each way, (N,), m."""
        return np.asarray((np.abs(self.distance) + b / 2 * np.abs(self.turn)).sum(axis=1))

    def take(self, rows: Ids) -> "Ways":
        """Return some of the ways."""
        return Ways(distance=self.distance[rows], turn=self.turn[rows], possible=self.possible[rows])


class Router:
    """Finds ways on one floor: direct ones, else the shortest along the corners of what stands in between."""

    def __init__(self, space: FreeSpace) -> None:
        x0, y0, x1, y1 = (space.blocked + _OFF_CORNER * np.array([-1, -1, 1, 1])).T
        corners = np.concatenate([np.stack(c, axis=1) for c in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))])
        self.space, self.corners = space, corners[space.free(corners)]
        self.between, self.via = self._shortest()

    def _shortest(self) -> tuple[Array, Ids]:
        """Return the lengths of the shortest ways between corners, and the corner to go to next (Floyd-Warshall)."""
        n = len(self.corners)
        i, j = np.divmod(np.arange(n * n), max(n, 1))
        length = np.linalg.norm(self.corners[i] - self.corners[j], axis=1)
        length = np.where(self.space.clear(self.corners[i], self.corners[j]), length, np.inf).reshape(n, n)
        following = np.tile(np.arange(n), (n, 1))
        for k in range(n):
            over = length[:, k : k + 1] + length[k]
            better = over < length - _TINY
            length = np.where(better, over, length)
            following = np.where(better, following[:, k : k + 1], following)
        return length, following

    def stations(self, start: Array, goals: Array) -> tuple[Array, Mask]:
        """Return the places to pass on the way from a point (2,) to points (N, 2): (N, H, 2), the last the goal.

        Shorter chains repeat their goal. The second array (N,) tells whether there is a way.
        """
        starts = np.broadcast_to(start, goals.shape)
        direct = self.space.clear(starts, goals)
        chains: list[list[Array]] = [[goal] for goal in goals]
        possible = direct.copy()
        blocked = np.flatnonzero(~direct)
        n = len(self.corners)
        if len(blocked) and n:
            from_start = np.linalg.norm(self.corners - start, axis=1)
            from_start[~self.space.clear(np.broadcast_to(start, (n, 2)), self.corners)] = np.inf
            ends = goals[blocked]
            gap = np.linalg.norm(self.corners[None] - ends[:, None], axis=2)
            seen = self.space.clear(np.tile(self.corners, (len(ends), 1)), np.repeat(ends, n, axis=0))
            gap[~seen.reshape(len(ends), n)] = np.inf
            reach = (from_start[:, None] + self.between).min(axis=0)
            first = (from_start[:, None] + self.between).argmin(axis=0)
            last = (reach + gap).argmin(axis=1)
            possible[blocked] = np.isfinite((reach + gap).min(axis=1))
            for row, end in zip(blocked, last, strict=True):
                at, chain = int(first[end]), []
                while at != end:
                    chain.append(self.corners[at])
                    at = int(self.via[at, end])
                chains[row] = [*chain, self.corners[end], goals[row]]
        most = max(len(chain) for chain in chains)
        return np.array([chain + [chain[-1]] * (most - len(chain)) for chain in chains]), possible


def turning_ways(router: Router, start: Array, goals: Array, whole_turns: Array) -> Ways:
    """Return ways of turns on the spot and straights from a pose (3,) to poses (N, 3).

    The gear of the first straight is that which needs the smaller first turn, and is kept.

    Parameters
    ----------
    router
        The floor.
    start, goals
        x, y (m) and heading (rad).
    whole_turns : (N,)
        Whole turns on the spot besides, to the left, at the end of each way.
    """
    stations, possible = router.stations(start[:2], goals[:, :2])
    N, H = stations.shape[:2]
    distance, turn = np.zeros((N, 2 * H + 1)), np.zeros((N, 2 * H + 1))
    here, heading = np.broadcast_to(start[:2], (N, 2)), np.full(N, start[2])
    backwards, begun = np.zeros(N, dtype=np.bool_), np.zeros(N, dtype=np.bool_)
    for h in range(H):
        chord = stations[:, h] - here
        way = np.hypot(chord[:, 0], chord[:, 1])
        drives = way > _TINY
        ahead = np.arctan2(chord[:, 1], chord[:, 0])
        gear = np.abs(wrap(ahead - heading)) > pi / 2 + _TINY
        backwards = np.where(begun | ~drives, backwards, gear)
        begun |= drives
        first = np.where(drives, wrap(ahead + np.where(backwards, pi, 0.0) - heading), 0.0)
        turn[:, 2 * h], distance[:, 2 * h + 1] = first, np.where(backwards, -way, way)
        here, heading = stations[:, h], heading + first
    turn[:, -1] = wrap(goals[:, 2] - heading) + 2 * pi * whole_turns
    within = np.abs(turn.sum(axis=1)) <= _MOST_TURN
    return Ways(distance=distance, turn=turn, possible=possible & within)
