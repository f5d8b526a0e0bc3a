"""The search for the next stop: all candidates with all paths there, on one floor, for one robot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.planning.assumptions import Model, vague_sigma
from boxcal.calib.planning.candidates import Candidates, Distances, candidates_at, free_poses
from boxcal.calib.planning.chain import append, first_stop, of_shared, quantity_values
from boxcal.calib.planning.floor import Floor, free_space
from boxcal.calib.planning.goal import Goal, Quantities, along_camera, quantities
from boxcal.calib.planning.leg_information import leg_information_of
from boxcal.calib.planning.objective import Criterion, score
from boxcal.calib.planning.paths import CurveRouter, Paths, Router
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One more stop of a drive.

    Attributes
    ----------
    row
        Which candidate it is.
    whole_turns
        Whole turns on the spot to make there, to the left.
    turn : rad
        Net change of heading on the path.
    length : m
        Of the path.
    chain : (n + 5, n + 5)
        Information of the drive with it.
    values : (6,)
        Quantities after it.
    """

    row: int
    whole_turns: int
    turn: float
    length: float
    chain: Array
    values: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """Candidates, paths and quantities of one robot on one floor.

    Attributes
    ----------
    model
        Robot, box and noise.
    choice
        Places to stop at.
    router
        Paths.
    quantities
        What is to become certain, by the shared unknowns in the solver's terms.
    criterion
        What of it is to be small.
    """

    model: Model
    choice: Candidates
    router: Router
    quantities: Quantities
    criterion: Criterion

    def score(self, values: Array) -> Array:
        """Return one number for quantities (..., 6): smaller is better."""
        return score(values / self.quantities.goals, self.criterion)

    def appended(self, chain: Array, here: Array, rows: Ids, paths: Paths) -> Array:
        """Return the information after paths from a pose (3,) to candidates (N,), (N, n + 5, n + 5)."""
        there = self.choice.poses[rows]
        start = np.broadcast_to(here, there.shape)
        legs = leg_information_of(self.model, (self.choice.problem, self.choice.state), paths, start=start, end=there)
        return append(chain, legs, self.choice.pictures[rows])

    def first(self, prior: Array) -> Step:
        """Return the best first stop."""
        chains = first_stop(prior, self.choice.pictures)
        values = quantity_values(self.quantities, of_shared(chains))
        row = int(np.argmin(score(values / self.quantities.goals, Criterion.MEAN)))
        return Step(row=row, whole_turns=0, turn=0.0, length=0.0, chain=chains[row], values=values[row])

    def next(self, chain: Array, here: Array, visited: Sequence[int] = ()) -> Step | None:
        """Return the best stop to append to a drive whose robot stands at a pose (3,); None if it cannot get away.

        Candidates that were visited are left out.
        """
        C, kinds = len(self.choice), self.router.spins()
        rows, spins = np.tile(np.arange(C), len(kinds)), np.repeat(kinds, C)
        direct = self.router.paths(np.broadcast_to(here, (C, 3)), self.choice.poses)
        paths = direct.take(rows).with_whole_turns(spins)
        fine = np.flatnonzero(paths.possible & ~np.isin(rows, visited))
        if not len(fine):
            return None
        rows, spins, paths = rows[fine], spins[fine], paths.take(fine)
        chains = self.appended(chain, here, rows, paths)
        values = quantity_values(self.quantities, of_shared(chains))
        best = int(np.argmin(self.score(values)))
        return Step(
            row=int(rows[best]),
            whole_turns=int(spins[best]),
            turn=float(paths.turn[best].sum()),
            length=float(paths.length[best]),
            chain=chains[best],
            values=values[best],
        )


def make_search(
    model: Model,
    floor: Floor,
    goal: Goal,
    *,
    criterion: Criterion = Criterion.WORST,
    distances: Distances | None = None,
    turning_radius: float = 0.0,
    count: int = 150,
    rng: np.random.Generator,
) -> Search:
    """Return candidates, paths and quantities for a robot on a floor.

    Raises
    ------
    CalibError
        If the floor leaves no room, or the box is seen from nowhere on it.
    """
    robot = model.robot
    space = free_space(floor, model.target.box, robot.reach)
    poses, seen = free_poses(
        robot,
        model.target,
        space,
        distances or Distances(),
        min_side_px=model.assumptions.min_side_px,
        count=count,
        rng=rng,
    )
    choice = candidates_at(model, poses, seen)
    found = quantities(choice.problem.names, robot, robot.image_size, goal)
    return Search(
        model=model,
        choice=choice,
        router=CurveRouter(space, turning_radius) if turning_radius > 0 else Router(space),
        quantities=along_camera(found, robot.T_body_cam[:3, :3]),
        criterion=criterion,
    )


def prior_information(model: Model, problem: Problem) -> Array:
    """Return the information on the shared unknowns before any stop, (n, n): priors, and vague values of the rest."""
    sigma = model.components.prior_sigma(problem)
    vague = vague_sigma(problem.names, model.robot)
    return np.asarray(problem.information + np.diag(1 / np.square(sigma) + 1 / np.square(vague)))
