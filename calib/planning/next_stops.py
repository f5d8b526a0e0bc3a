"""The most informative next stops, with how much they promise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.problem import PER_STOP
from boxcal.calib.planning.assumptions import assumed_model
from boxcal.calib.planning.chain import of_shared, quantity_values
from boxcal.calib.planning.drive_information import (
    DriveInformation,
    information_of,
    solved_by_calibration,
    solved_by_estimate,
)
from boxcal.calib.planning.floor import Floor
from boxcal.calib.planning.goal import (
    Bar,
    Goal,
    along_camera,
    bars_of_calibration,
    bars_of_estimate,
    quantities,
    worst,
)
from boxcal.calib.planning.objective import Criterion
from boxcal.calib.planning.promise import Promise, promise_of
from boxcal.calib.planning.search import make_search, prior_information
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.simulate.robot import Robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NextStop:
    """A place to stop at, and what that promises.

    Attributes
    ----------
    x, y, heading : m, m, rad
        Of the body, in the box's frame.
    whole_turns
        Whole turns on the spot, to the left, to make there before standing still.
    tags, faces
        How many tags are read there, and of which faces.
    turn : rad
        Net change of heading on the path there.
    way : m
        Length of the path there.
    before, after
        Quantities that the user cares about before and after this stop.
    promise
        Range of what will be found, over the quantities computed with the slip as it is known now; those after this
        stop are the middle of it.
    """

    x: float
    y: float
    heading: float
    whole_turns: int
    turn: float
    tags: int
    faces: tuple[int, ...]
    way: float
    before: tuple[Bar, ...]
    after: tuple[Bar, ...]
    promise: Promise

    def promised(self, bar: Bar) -> str:
        """Return between what values one of the quantities after this stop will lie, nine times in ten."""
        ends = (self.promise.low, self.promise.high)
        low, high = (said(replace(bar, value=bar.value * end / self.promise.middle)) for end in ends)
        return f"{low} to {high}"

    @property
    def text(self) -> str:
        """Sentence that says where to drive and what that promises."""
        spin = ""
        if self.whole_turns:
            spin = f" after a whole turn to the {'left' if self.whole_turns > 0 else 'right'}"
        open_ = worst(self.before)
        then = next(bar for bar in self.after if bar.name == open_.name)
        return (
            f"Stop at x {self.x:+.2f} m, y {self.y:+.2f} m, heading {degrees(self.heading):.0f}\N{DEGREE SIGN}{spin} "
            f"({self.way:.1f} m from here): {open_.label.lower()} {said(open_)} -> {self.promised(then)}."
        )


def said(bar: Bar) -> str:
    """Return a bar's value as people say it."""
    if not np.isfinite(bar.value):
        return "unknown"
    if bar.unit == "rad":
        return f"{degrees(bar.value):.2g}\N{DEGREE SIGN}"
    if bar.unit == "px":
        return f"{bar.value:.2g} px"
    if bar.value >= 1:
        return f"{bar.value:.2g} m"
    return f"{bar.value * 100:.2g} cm" if bar.value >= 0.01 else f"{bar.value * 1000:.2g} mm"


def what_next(
    found: Estimate | Calibration,
    drives: Sequence[Correspondences],
    target: Target,
    *,
    goal: Goal | None = None,
    floor: Floor | None = None,
    count: int = 3,
    seed: int = 0,
) -> tuple[NextStop, ...]:
    """Return the stops that bring the worst quantity down most, each driven to from the one before.

    There may be fewer than were asked for, or none, where no path there is free.

    Parameters
    ----------
    found, drives, target
        What is known so far, what it was made from, and the box.
    goal, floor
        What is wanted, and where the robot may drive.
    count
        How many stops to look ahead.
    seed
        Settles the places that are tried.

    Raises
    ------
    CalibError
        If a calibration is the closed form alone, or the box is seen from nowhere on the floor.
    """
    goal = goal or Goal()
    if isinstance(found, Calibration):
        known = information_of(solved_by_calibration(found, drives), drives, target, found.robot)
        bars = bars_of_calibration(found, goal)
    else:
        known = information_of(solved_by_estimate(found), drives, target)
        bars = bars_of_estimate(found, goal, drives[0].image_size)
    return next_stops(known, bars, goal, floor or Floor(), count=count, seed=seed)


def next_stops(
    known: DriveInformation,
    bars: tuple[Bar, ...],
    goal: Goal,
    floor: Floor,
    *,
    count: int = 3,
    seed: int = 0,
) -> tuple[NextStop, ...]:
    """Return the best stops after a drive, and what each promises of the given quantities: they shrink as computed."""
    model, n = known.model, len(known.names)
    robot = model.robot
    rng = np.random.default_rng([seed, len(known.poses)])
    search = make_search(model, floor, goal, rng=rng)
    rows = _columns(known.names, search.choice.problem.names)
    search = replace(
        search,
        quantities=along_camera(quantities(known.names, robot, robot.image_size, goal), robot.T_body_cam[:3, :3]),
        choice=replace(search.choice, pictures=_in_order(search.choice.pictures, rows, n)),
    )
    values = quantity_values(search.quantities, of_shared(known.chain[None]))[0]
    said_now = np.array([bar.value for bar in bars])
    factor = np.divide(said_now, values, out=np.ones_like(values), where=np.isfinite(said_now) & (values > 0))
    chain, here, before = known.chain, known.poses[-1], bars
    out: list[NextStop] = []
    visited: list[int] = []
    for _ in range(count):
        step = search.next(chain, here, visited)
        if step is None:
            break
        promise = promise_of(known.slip_doubt, len(out) + 1)
        after = search.quantities.as_bars(step.values * factor * promise.middle)
        visited.append(step.row)
        here, chain = search.choice.poses[step.row], step.chain
        out.append(
            NextStop(
                x=float(here[0]),
                y=float(here[1]),
                heading=float(here[2]),
                whole_turns=step.whole_turns,
                turn=step.turn,
                tags=int(search.choice.seen[step.row].sum()),
                faces=tuple(int(f) for f in np.flatnonzero(search.choice.faces[step.row])),
                way=step.length,
                before=before,
                after=after,
                promise=promise,
            )
        )
        before = after
    return tuple(out)


def first_stops(
    robot: Robot, target: Target, *, floor: Floor | None = None, count: int = 3, seed: int = 0, goal: Goal | None = None
) -> Array:
    """Return the stops (count, 3), x, y (m) and heading (rad), to begin a drive with a robot that is roughly known."""
    search = make_search(
        assumed_model(robot, target),
        floor or Floor(),
        goal or Goal(),
        criterion=Criterion.MEAN,
        rng=np.random.default_rng(seed),
    )
    step = search.first(prior_information(search.model, search.choice.problem))
    rows = [step.row]
    while len(rows) < count:
        following = search.next(step.chain, search.choice.poses[step.row], rows)
        if following is None:
            break
        step = following
        rows.append(step.row)
    return np.asarray(search.choice.poses[rows])


def _columns(names: tuple[str, ...], of_pictures: tuple[str, ...]) -> Ids:
    """Return where each unknown of new images stands in a drive's; the floor is that of its last drive."""
    at = {name: k for k, name in enumerate(names)}
    last = max((int(name.rsplit("_", 1)[1]) for name in names if name.startswith("tilt_x_")), default=0)
    wanted = [f"{name}_{last}" if last and name.startswith("tilt_") else name for name in of_pictures]
    return np.array([at[name] for name in wanted], dtype=np.int64)


def _in_order(pictures: Array, rows: Ids, n: int) -> Array:
    """Return images' information with the shared unknowns where a drive has them, (N, n + 3, n + 3)."""
    if len(rows) == n and np.array_equal(rows, np.arange(n)):
        return pictures
    at = np.concatenate([rows, n + np.arange(PER_STOP - 2)])
    out = np.zeros((len(pictures), n + 3, n + 3))
    out[:, at[:, None], at] = pictures
    return out
