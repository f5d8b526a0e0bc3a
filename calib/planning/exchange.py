"""Greedy choice of stops, and exchange of one for another until nothing becomes better."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.planning.candidates import enough_tags
from boxcal.calib.planning.search import Search, Step
from boxcal.calib.planning.tour import Evaluation, Tour, evaluated, messages, paths_of, replacements, seconds_of
from boxcal.target.arrays import Array, Ids

_SWEEPS = 3
_GAIN = 1e-3
"""Relative gain below which an exchange is not made."""
_MISSING = 0.5
"""Cost of a face of the box that no stop shows well, as a fraction of the whole."""

Cost = Callable[[Array, Array], Array]
"""Cost (N,) of drives from their quantities (N, 6) and times (N,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """The drive that is looked for.

    Attributes
    ----------
    searches
        The robot as it probably is, then as it might be: of each quantity the worst among them counts.
    priors
        Information on their shared unknowns before any stop.
    faces
        How many faces of the box must be seen well.
    """

    searches: tuple[Search, ...]
    priors: tuple[Array, ...]
    faces: int

    @property
    def nominal(self) -> Search:
        """The robot as it probably is."""
        return self.searches[0]

    def worst(self, tour: Tour) -> Evaluation:
        """Return what a drive gives whichever robot it is: the largest of each quantity among them, and of the time.

        One robot may be worst in one quantity and another in the next: a goal is reached if all of them reach it.
        """
        found = [evaluated(s, p, tour) for s, p in zip(self.searches, self.priors, strict=True)]
        return replace(
            found[0],
            values=np.max([w.values for w in found], axis=0),
            seconds=max(w.seconds for w in found),
            possible=all(w.possible for w in found),
        )

    def missing(self, rows: Ids) -> Array:
        """Return how many of the faces are still to be seen well, for stops (..., P) of a drive."""
        need = enough_tags(self.nominal.model.target)
        well = np.any(self.nominal.choice.faces[rows] >= need, axis=-2)
        return np.asarray(np.maximum(self.faces - well.sum(axis=-1), 0))


def greedy(problem: Problem, stops: int, enough: Callable[[Array], bool]) -> Tour:
    """Return a drive that takes at each stop the next that helps most, until it is enough or has the most stops."""
    search = problem.nominal
    step: Step | None = search.first(problem.priors[0])
    rows, spins = [], []
    while step is not None:
        rows.append(step.row)
        spins.append(step.whole_turns)
        if len(rows) == stops or (len(rows) > 2 and enough(step.values)):
            break
        step = search.next(step.chain, search.choice.poses[step.row], rows)
    return Tour(rows=tuple(rows), spins=tuple(spins))


def improved(problem: Problem, tour: Tour, cost: Cost, *, sweeps: int = _SWEEPS) -> Tour:
    """Return the drive after stops were exchanged for candidates as long as that lowers the cost.

    Candidates are compared for the robot as it probably is; a change is made only if it is better by the worst
    quantities among all that it might be.
    """
    now = total(problem, tour, cost)
    for _ in range(sweeps):
        before = now
        for k in range(len(tour.rows)):
            trial = _best_at(problem, tour, k, cost)
            if trial is None:
                continue
            then = total(problem, trial, cost)
            if then < now * (1 - _GAIN):
                tour, now = trial, then
        if now > before * (1 - _GAIN):
            break
    return tour


def total(problem: Problem, tour: Tour, cost: Cost) -> float:
    """Return the cost of a drive, faces that it does not show included; infinite where a path is blocked."""
    found = problem.worst(tour)
    if not found.possible:
        return np.inf
    missing = float(problem.missing(np.array(tour.rows)))
    return float(cost(found.values[None], np.array([found.seconds]))[0]) * (1 + _MISSING * missing)


def _best_at(problem: Problem, tour: Tour, k: int, cost: Cost) -> Tour | None:
    """Return the drive with the best stop at one place in the order; None if that is the one it has."""
    search, prior = problem.nominal, problem.priors[0]
    paths = paths_of(search, tour)
    at = messages(search, prior, tour, paths)
    C = len(search.choice)
    others = np.setdiff1d(np.arange(C), tour.rows)
    own = search.router.spins() if k else np.zeros(1, dtype=np.int64)
    rows = np.concatenate([others, np.full(len(own), tour.rows[k])])
    spins = np.concatenate([np.full(len(others), tour.spins[k]), own])
    found = replacements(search, prior, tour, at, (k, rows, spins))
    if not len(found.rows):
        return None
    elsewhere = evaluated(search, prior, tour).seconds - _seconds_at(problem, tour, k)
    drives = np.tile(np.array(tour.rows), (len(found.rows), 1))
    drives[:, k] = found.rows
    costs = cost(found.values, found.seconds + elsewhere) * (1 + _MISSING * problem.missing(drives))
    best = int(np.argmin(costs))
    trial = tour.with_stop(k, int(found.rows[best]), int(found.spins[best]))
    return None if trial == tour else trial


def _seconds_at(problem: Problem, tour: Tour, k: int) -> float:
    """Return the time of the paths to and from one stop of a drive, s."""
    seconds = seconds_of(problem.nominal, paths_of(problem.nominal, tour))
    return float(seconds[max(k - 1, 0) : k + 1].sum())
