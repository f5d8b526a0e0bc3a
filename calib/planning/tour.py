"""A whole drive among the candidates: which stops in which order, with what information and time."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.planning.chain import append, first_stop, of_shared, quantity_values, reverse, stop_alone, through
from boxcal.calib.planning.leg_information import leg_information_of
from boxcal.calib.planning.paths import Paths
from boxcal.calib.planning.search import Search
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True, kw_only=True)
class Tour:
    """Stops of a drive by their candidates, in order, with the whole turns made on arriving at each.

    Attributes
    ----------
    rows, spins
        Candidate and whole turns to the left of each stop; there are no turns at the first.
    """

    rows: tuple[int, ...]
    spins: tuple[int, ...]

    def with_stop(self, k: int, row: int, spin: int) -> "Tour":
        """Return the drive with another stop at a place in the order."""
        rows, spins = list(self.rows), list(self.spins)
        rows[k], spins[k] = row, spin
        return Tour(rows=tuple(rows), spins=tuple(spins))


def paths_of(search: Search, tour: Tour) -> Paths:
    """Return the paths of a drive between its stops."""
    poses = search.choice.poses[list(tour.rows)]
    return search.router.paths(poses[:-1], poses[1:]).with_whole_turns(np.array(tour.spins[1:], dtype=np.int64))


def legs_of(search: Search, starts: Array, goals: Array, paths: Paths) -> Array:
    """Return the information of paths from poses (N, 3) to poses (N, 3), (N, 13, 13)."""
    of_pictures = (search.choice.problem, search.choice.state)
    return leg_information_of(search.model, of_pictures, paths, start=starts, end=goals)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Messages:
    """Information of a drive from both of its ends.

    Attributes
    ----------
    before : (P, n + 5, n + 5)
        Of shared unknowns and each stop, from the stops up to it and with its image.
    after : (P, n + 5, n + 5)
        The same from the stops that follow it.
    legs : (P - 1, 13, 13)
        Of the paths.
    """

    before: Array
    after: Array
    legs: Array


def messages(search: Search, prior: Array, tour: Tour, paths: Paths) -> Messages:
    """Return the information of a drive at each of its stops, from before and from after."""
    poses, pictures = search.choice.poses[list(tour.rows)], search.choice.pictures[list(tour.rows)]
    legs = legs_of(search, poses[:-1], poses[1:], paths)
    before = [first_stop(prior, pictures[:1])[0]]
    for k in range(len(legs)):
        before.append(append(before[-1], legs[k : k + 1], pictures[k + 1 : k + 2])[0])
    own, back = stop_alone(pictures), reverse(legs)
    after = [np.zeros_like(before[0])]
    for k in range(len(legs) - 1, -1, -1):
        after.append(through(own[k + 1] + after[-1], back[k : k + 1])[0])
    return Messages(before=np.array(before), after=np.array(after[::-1]), legs=legs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """Quantities, time and path of a drive.

    Attributes
    ----------
    values : (6,)
        Quantities in the order of :class:`boxcal.calib.planning.goal.Goal`.
    seconds : s
        Time that it takes.
    length : m
        Its path.
    possible
        Whether all paths are free.
    """

    values: Array
    seconds: float
    length: float
    possible: bool


def seconds_of(search: Search, paths: Paths) -> Array:
    """Return how long each path takes with the stop at its end, (N,), s."""
    given = search.model.assumptions
    return np.asarray(2 * paths.rolled(search.model.robot.b) / given.max_speed + given.stand_s)


def evaluated(search: Search, prior: Array, tour: Tour) -> Evaluation:
    """Return what a drive gives and costs."""
    paths = paths_of(search, tour)
    last = messages(search, prior, tour, paths).before[-1]
    return Evaluation(
        values=quantity_values(search.quantities, of_shared(last[None]))[0],
        seconds=float(seconds_of(search, paths).sum()) + search.model.assumptions.stand_s,
        length=float(paths.length.sum()),
        possible=bool(np.all(paths.possible)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Replacements:
    """Drives with another stop at one place in the order, N of them.

    Attributes
    ----------
    rows, spins : (N,)
        The stop there.
    values : (N, 6)
        Quantities.
    seconds : (N,)
        Time of the paths to and from it.
    """

    rows: Ids
    spins: Ids
    values: Array
    seconds: Array


def replacements(search: Search, prior: Array, tour: Tour, at: Messages, place: tuple[int, Ids, Ids]) -> Replacements:
    """Return what a drive would be with other stops at one place in the order.

    Parameters
    ----------
    search, prior, tour, at
        The drive and its information.
    place
        Which of its stops, and the candidates (N,) with their whole turns (N,) to try there.
    """
    k, rows, spins = place
    poses, last = search.choice.poses, len(tour.rows) - 1
    there, seconds = poses[rows], np.zeros(len(rows))
    possible = np.ones(len(rows), dtype=np.bool_)
    if k == 0:
        chain = first_stop(prior, search.choice.pictures[rows])
    else:
        start = np.broadcast_to(poses[tour.rows[k - 1]], there.shape)
        paths = search.router.paths(start, there).with_whole_turns(spins)
        chain = append(at.before[k - 1], legs_of(search, start, there, paths), search.choice.pictures[rows])
        seconds, possible = seconds_of(search, paths), paths.possible
    if k < last:
        end = np.broadcast_to(poses[tour.rows[k + 1]], there.shape)
        paths = search.router.paths(there, end).with_whole_turns(np.full(len(rows), tour.spins[k + 1]))
        following = np.repeat(search.choice.pictures[tour.rows[k + 1] : tour.rows[k + 1] + 1], len(rows), axis=0)
        chain = append(chain, legs_of(search, there, end, paths), following) + at.after[k + 1]
        seconds, possible = seconds + seconds_of(search, paths), possible & paths.possible
    fine = np.flatnonzero(possible)
    return Replacements(
        rows=rows[fine],
        spins=spins[fine],
        values=quantity_values(search.quantities, of_shared(chain[fine])),
        seconds=seconds[fine],
    )
