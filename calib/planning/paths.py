"""Paths from stop to stop: turns on the spot and straights around what stands there, or curves of a turning radius."""

from dataclasses import dataclass
from math import pi

import numpy as np

from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.planning.dubins import dubins_curves, points_along
from boxcal.calib.planning.floor import FreeSpace
from boxcal.target.arrays import Array, Ids, Mask

_TINY = 1e-9
_OFF_CORNER = 1e-6
_MOST_TURN = 2.9 * pi
"""Largest net turn of a leg, rad: images give headings modulo a turn, and what is far off is not told apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Paths:
    """N paths, each a chain of arcs from standstill to standstill; unused arcs are zero.

    Attributes
    ----------
    distance, turn : (N, A), m and rad
        Path length of the body's origin (negative backwards) and change of heading of each arc.
    possible : (N,) bool
        Whether there is such a path.
    """

    distance: Array
    turn: Array
    possible: Mask

    @property
    def length(self) -> Array:
        """Length of the paths of the body's origin, (N,), m."""
        return np.asarray(np.abs(self.distance).sum(axis=1))

    def rolled(self, b: float) -> Array:
        """Return how far the faster wheel's rim rolls along each path, (N,), m."""
        return np.asarray((np.abs(self.distance) + b / 2 * np.abs(self.turn)).sum(axis=1))

    def take(self, rows: Ids) -> "Paths":
        """Return some of the paths."""
        return Paths(distance=self.distance[rows], turn=self.turn[rows], possible=self.possible[rows])

    def with_whole_turns(self, turns: Ids) -> "Paths":
        """Return the paths with whole turns to the left (N,) on the spot at their ends."""
        turn = self.turn.copy()
        turn[:, -1] += 2 * pi * turns
        within = np.abs(turn.sum(axis=1)) <= _MOST_TURN
        return Paths(distance=self.distance, turn=turn, possible=self.possible & within)


class Router:
    """Paths on one floor: direct ones, else the shortest along the corners of what stands in between."""

    def __init__(self, space: FreeSpace) -> None:
        x0, y0, x1, y1 = (space.blocked + _OFF_CORNER * np.array([-1, -1, 1, 1])).T
        corners = np.concatenate([np.stack(c, axis=1) for c in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))])
        self.space, self.corners = space, corners[space.free(corners)]
        self.between, self.via = self._shortest()

    def _shortest(self) -> tuple[Array, Ids]:
        """Return the lengths of the shortest paths between corners, and the corner to go to next (Floyd-Warshall)."""
        n = len(self.corners)
        length = self._lengths(self.corners)
        following = np.tile(np.arange(n), (n, 1))
        for k in range(n):
            over = length[:, k : k + 1] + length[k]
            better = over < length - _TINY
            length = np.where(better, over, length)
            following = np.where(better, following[:, k : k + 1], following)
        return length, following

    def _lengths(self, xy: Array) -> Array:
        """Return the lengths of straight paths from points (N, 2) to all corners, infinite where blocked."""
        N, n = len(xy), len(self.corners)
        start, end = np.repeat(xy, n, axis=0), np.tile(self.corners, (N, 1))
        length = np.hypot(*(end - start).T)
        return np.asarray(np.where(self.space.clear(start, end), length, np.inf).reshape(N, n))

    def stations(self, starts: Array, goals: Array) -> tuple[Array, Mask]:
        """Return the places to pass from points (N, 2) to points (N, 2), (N, H, 2), the last the goal.

        Shorter chains repeat their goal. The second array (N,) says whether there is a path.
        """
        possible = self.space.clear(starts, goals)
        chains: list[list[Array]] = [[goal] for goal in goals]
        blocked, n = np.flatnonzero(~possible), len(self.corners)
        if len(blocked) and n:
            away, to = self._lengths(starts[blocked]), self._lengths(goals[blocked])
            total = (away[:, :, None] + self.between + to[:, None, :]).reshape(len(blocked), -1)
            best = total.argmin(axis=1)
            possible[blocked] = np.isfinite(total[np.arange(len(blocked)), best])
            for row, first, last in zip(blocked, *np.divmod(best, n), strict=True):
                at, chain = first, [self.corners[first]]
                while at != last:
                    at = self.via[at, last]
                    chain.append(self.corners[at])
                chains[row] = [*chain, goals[row]]
        most = max(len(chain) for chain in chains)
        return np.array([chain + [chain[-1]] * (most - len(chain)) for chain in chains]), possible

    def paths(self, starts: Array, goals: Array) -> Paths:
        """Return paths of turns on the spot and straights from poses (N, 3) to poses (N, 3).

        The gear of the first straight is that which needs the smaller first turn, and is kept.
        """
        stations, possible = self.stations(starts[:, :2], goals[:, :2])
        N, H = stations.shape[:2]
        distance, turn = np.zeros((N, 2 * H + 1)), np.zeros((N, 2 * H + 1))
        here, heading = starts[:, :2], starts[:, 2]
        backwards, begun = np.zeros(N, dtype=np.bool_), np.zeros(N, dtype=np.bool_)
        for h in range(H):
            chord = stations[:, h] - here
            straight = np.hypot(chord[:, 0], chord[:, 1])
            drives = straight > _TINY
            ahead = np.arctan2(chord[:, 1], chord[:, 0])
            gear = np.abs(wrap(ahead - heading)) > pi / 2 + _TINY
            backwards = np.where(begun | ~drives, backwards, gear)
            begun |= drives
            first = np.where(drives, wrap(ahead + np.where(backwards, pi, 0.0) - heading), 0.0)
            turn[:, 2 * h], distance[:, 2 * h + 1] = first, np.where(backwards, -straight, straight)
            here, heading = stations[:, h], heading + first
        turn[:, -1] = wrap(goals[:, 2] - heading)
        return Paths(distance=distance, turn=turn, possible=possible)

    def spins(self) -> Ids:
        """Return the whole turns on the spot, to the left, that a path may end with."""
        return np.array([0, 1, -1])


class CurveRouter(Router):
    """Paths of a robot that cannot turn on the spot: Dubins curves, forwards or backwards.

    Parameters
    ----------
    space
        The free floor.
    radius : m
        Smallest turning radius.
    """

    def __init__(self, space: FreeSpace, radius: float) -> None:
        super().__init__(space)
        self.radius = radius

    def paths(self, starts: Array, goals: Array) -> Paths:
        """Return the shortest curves from poses (N, 3) to poses (N, 3) that touch nothing."""
        best = np.full(len(starts), np.inf)
        distance, turn = np.zeros((len(starts), 3)), np.zeros((len(starts), 3))
        for gear in (1.0, -1.0):
            flip = np.array([0.0, 0.0, 0.0 if gear > 0 else pi])
            for d, t in dubins_curves(starts + flip, goals + flip, self.radius):
                length = d.sum(axis=1)
                better = np.flatnonzero(length < best)
                xy = points_along(starts[better] + flip, d[better], t[better])
                better = better[self._free_along(xy)]
                best[better], distance[better], turn[better] = length[better], gear * d[better], t[better]
        return Paths(distance=distance, turn=turn, possible=np.isfinite(best))

    def _free_along(self, xy: Array) -> Mask:
        """Return which chains of points (N, K, 2) are free, and so are the chords between them."""
        N, K = xy.shape[:2]
        free: Mask = np.asarray(self.space.free(xy.reshape(-1, 2)).reshape(N, K).all(axis=1))
        chains = xy[free]
        chords = self.space.clear(chains[:, :-1].reshape(-1, 2), chains[:, 1:].reshape(-1, 2))
        free[free] = chords.reshape(len(chains), K - 1).all(axis=1)
        return free

    def spins(self) -> Ids:
        """Return that no whole turns on the spot can be made."""
        return np.array([0])
