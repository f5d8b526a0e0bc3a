"""The plan of a whole drive: the fewest stops that reach the goals, or the best drive of a given number of stops."""

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.planning.assumptions import Assumptions, assumed_model
from boxcal.calib.planning.candidates import Distances, candidates_at
from boxcal.calib.planning.exchange import Cost, Problem, greedy, improved
from boxcal.calib.planning.floor import Floor
from boxcal.calib.planning.goal import Bar, Goal, along_camera, quantities
from boxcal.calib.planning.objective import Criterion, score
from boxcal.calib.planning.search import Search, make_search, prior_information
from boxcal.calib.planning.tour import Tour, paths_of
from boxcal.calib.planning.views import tags_seen
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target

LEAST_STOPS = 8
"""With fewer a slipped wheel goes unnoticed: the verdict does not call them good."""
_MOST_STOPS = 40
_NEAR = 1.4
"""How far from its goal a greedy drive may be for an exchange to be tried."""
_A_MINUTE = 0.02
"""What a minute of driving costs in a drive of this many stops, as a fraction of its sigmas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions:
    """Wishes for a drive.

    Attributes
    ----------
    goal
        Standard deviations to reach.
    stops, optional
        How many stops; as few as reach the goals if None.
    least_stops
        The fewest that are planned where the number is free.
    criterion
        What of the quantities over their goals is to be small.
    floor
        Where the robot may drive.
    distances
        Least and largest distance of the camera from the box's middle.
    turning_radius : m
        Smallest; 0 for robots that turn on the spot.
    faces
        How many faces of the box must be seen well.
    candidates
        How many places are tried.
    seed
        Settles them.
    """

    goal: Goal = field(default_factory=Goal)
    stops: int | None = None
    least_stops: int = LEAST_STOPS
    criterion: Criterion = Criterion.WORST
    floor: Floor = field(default_factory=Floor)
    distances: Distances = field(default_factory=Distances)
    turning_radius: float = 0.0
    faces: int = FACES
    candidates: int = 150
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("stops", "least_stops"):
            count = getattr(self, name)
            if count is not None and not 3 <= count <= _MOST_STOPS:
                raise CalibError(f"{count} stops were asked for", needed=f"3 to {_MOST_STOPS} can be planned")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedStop:
    """One stop of a planned drive, and the path to it.

    Attributes
    ----------
    pose : (3,), m and rad
        x, y, heading of the body in the box's frame; headings run on from stop to stop, whole turns counted.
    distance, turn : (A,), m and rad
        Arcs of the path from the stop before: length (negative backwards) and change of heading; none at the first.
    tags
        How many tags are read.
    faces
        Of which faces.
    """

    pose: Array
    distance: Array
    turn: Array
    tags: int
    faces: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivePlan:
    """A planned drive.

    Attributes
    ----------
    robot
        As it was taken to be.
    target
        The box.
    options, assumptions
        What it was planned for.
    stops
        In order.
    bars
        Quantities that the drive promises, beside their goals; of each the worst among the robots that were considered.
    seconds, length : s, m
        Time and path.
    reached
        Whether all goals are reached.
    """

    robot: Robot
    target: Target
    options: PlanOptions
    assumptions: Assumptions
    stops: tuple[PlannedStop, ...]
    bars: tuple[Bar, ...]
    seconds: float
    length: float
    reached: bool

    @property
    def poses(self) -> Array:
        """Stops (P, 3), x, y (m) and heading (rad, running on)."""
        return np.array([stop.pose for stop in self.stops])


def plan_drive(
    robot: Robot,
    target: Target,
    options: PlanOptions | None = None,
    assumptions: Assumptions | None = None,
    *,
    others: tuple[Robot, ...] = (),
) -> DrivePlan:
    """Return the shortest drive that reaches the goals, or the best one of the stops asked for.

    Parameters
    ----------
    robot
        As it probably is.
    target
        The box.
    options, assumptions
        What is wanted, and what noise to expect.
    others
        The robot as it might also be: stops must see the box with all of them, and the one that gets least counts.

    Raises
    ------
    CalibError
        If the box is seen from nowhere on the floor.
    """
    options, assumptions = options or PlanOptions(), assumptions or Assumptions()
    problem = _problem(robot, target, options, assumptions, others)
    tour = _best_of(problem, options, options.stops) if options.stops else _shortest(problem, options)
    return _plan(problem, tour, options, assumptions)


def _problem(
    robot: Robot, target: Target, options: PlanOptions, assumptions: Assumptions, others: tuple[Robot, ...]
) -> Problem:
    first = make_search(
        assumed_model(robot, target, assumptions),
        options.floor,
        options.goal,
        criterion=options.criterion,
        distances=options.distances,
        turning_radius=options.turning_radius,
        count=options.candidates,
        rng=np.random.default_rng(options.seed),
    )
    searches = (first, *(_as_seen_by(first, other, options) for other in others))
    need_faces = int(np.minimum(options.faces, np.count_nonzero(np.any(first.choice.faces > 0, axis=0))))
    return Problem(
        searches=searches,
        priors=tuple(prior_information(s.model, s.choice.problem) for s in searches),
        faces=need_faces,
    )


def _as_seen_by(first: Search, robot: Robot, options: PlanOptions) -> Search:
    """Return the same places and paths for the robot as it might also be."""
    model = replace(first.model, robot=robot)
    poses = first.choice.poses
    seen = tags_seen(robot, model.target, poses, model.assumptions.min_side_px, margin=0.0)
    seen[seen.sum(axis=1) < 1, 0] = True  # a stop that shows nothing still needs a row
    choice = candidates_at(model, poses, seen)
    found = quantities(choice.problem.names, robot, robot.image_size, options.goal)
    return replace(first, model=model, choice=choice, quantities=along_camera(found, robot.T_body_cam[:3, :3]))


def _sure(problem: Problem, options: PlanOptions) -> Cost:
    """Return the cost of a drive whose stops are given: its quantities, and a little its time."""

    def cost(values: Array, seconds: Array) -> Array:
        ratio = values / problem.nominal.quantities.goals
        return np.asarray(score(ratio, options.criterion) * (1 + _A_MINUTE * seconds / 60))

    return cost


def _quick(problem: Problem) -> Cost:
    """Return the cost of a drive that has to reach the goals: its time, once it does."""

    def cost(values: Array, seconds: Array) -> Array:
        ratio = (values / problem.nominal.quantities.goals).max(axis=-1)
        return np.asarray(np.where(ratio <= 1, seconds, 1e4 * ratio))

    return cost


def _best_of(problem: Problem, options: PlanOptions, stops: int) -> Tour:
    tour = greedy(problem, stops, lambda _: False)
    return improved(problem, tour, _sure(problem, options))


def _shortest(problem: Problem, options: PlanOptions) -> Tour:
    """Return the drive of fewest stops that reaches the goals, then of least time; the best found if none does."""
    goals = problem.nominal.quantities.goals

    def ratio(tour: Tour) -> float:
        found = problem.worst(tour)
        return float((found.values / goals).max()) if found.possible else inf

    tour = greedy(problem, _MOST_STOPS, lambda values: bool(np.all(values <= goals)))
    count = max(len(tour.rows), options.least_stops)
    if len(tour.rows) < count:
        tour = greedy(problem, count, lambda _: False)
    best = improved(problem, tour, _quick(problem), sweeps=1)
    while len(best.rows) > options.least_stops:
        shorter = Tour(rows=tour.rows[: len(best.rows) - 1], spins=tour.spins[: len(best.rows) - 1])
        if ratio(shorter) > _NEAR:
            break
        shorter = improved(problem, shorter, _sure(problem, options), sweeps=2)
        if ratio(shorter) > 1:
            break
        best = shorter
    return improved(problem, best, _quick(problem), sweeps=2) if ratio(best) <= 1 else best


def _plan(problem: Problem, tour: Tour, options: PlanOptions, assumptions: Assumptions) -> DrivePlan:
    search, found = problem.nominal, problem.worst(tour)
    paths, choice = paths_of(search, tour), search.choice
    heading = float(choice.poses[tour.rows[0], 2])
    stops = []
    for k, row in enumerate(tour.rows):
        arcs = (paths.distance[k - 1], paths.turn[k - 1]) if k else (np.zeros(0), np.zeros(0))
        moved = (arcs[0] != 0) | (arcs[1] != 0)
        heading += float(arcs[1].sum())
        stops.append(
            PlannedStop(
                pose=np.array([*choice.poses[row, :2], heading]),
                distance=arcs[0][moved],
                turn=arcs[1][moved],
                tags=int(choice.seen[row].sum()),
                faces=tuple(int(f) for f in np.flatnonzero(choice.faces[row])),
            )
        )
    bars = search.quantities.as_bars(found.values)
    return DrivePlan(
        robot=search.model.robot,
        target=search.model.target,
        options=options,
        assumptions=assumptions,
        stops=tuple(stops),
        bars=bars,
        seconds=found.seconds,
        length=found.length,
        reached=all(bar.reached for bar in bars),
    )
