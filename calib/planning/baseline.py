"""Drives that are not planned, for comparison: an even ring, and stops at random around the box."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.planning.assumptions import assumed_model
from boxcal.calib.planning.candidates import candidates_at
from boxcal.calib.planning.floor import free_space
from boxcal.calib.planning.plan import DrivePlan, ring
from boxcal.calib.planning.search import make_search, prior_information
from boxcal.calib.planning.tour import Tour, worth
from boxcal.calib.planning.views import tags_seen
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.target.arrays import Array

_RINGS = np.arange(0.3, 1.6, 0.1)
_CANDIDATES = 8
"""The search is made for its ways and figures only."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Baseline:
    """A drive that was not planned, and what it gives.

    Attributes
    ----------
    name
        Kind of drive.
    poses : (P, 3), m and rad
        Its stops.
    values : (6,)
        Figures in the order of :class:`boxcal.calib.planning.goal.Goal`.
    """

    name: str
    poses: Array
    values: Array


def baselines(plan: DrivePlan) -> tuple[Baseline, ...]:
    """Return an even ring (the best of several distances) and random stops, of as many stops as a plan has.

    What has no free way on the plan's floor is left out.
    """
    count, robot, target = len(plan.stops), plan.robot, plan.target
    rng = np.random.default_rng(plan.options.seed)
    gap = plan.options.floor.clearance + robot.reach
    found = []
    rings = [drive_of(plan, f"ring of {count}", ring(robot, count, float(d))) for d in _RINGS]
    seen = [r for r in rings if r is not None]
    goals = np.array([bar.goal for bar in plan.bars])
    if seen:
        found.append(min(seen, key=lambda r: float((r.values / goals).max())))
    try:
        at_random = drive_of(plan, f"{count} at random", choose_stops(robot, target, count, gap, rng))
    except CalibError:  # no such places: there is nothing to compare with
        at_random = None
    return (*found, *(() if at_random is None else (at_random,)))


def drive_of(plan: DrivePlan, name: str, poses: Array) -> Baseline | None:
    """Return a drive of given stops under a plan's assumptions; None where it is blocked or does not see the box."""
    model = assumed_model(plan.robot, plan.target, plan.assumptions)
    seen = tags_seen(plan.robot, plan.target, poses, plan.assumptions.min_side_px, margin=0.0)
    space = free_space(plan.options.floor, plan.target.box, plan.robot.reach)
    if not (np.all(seen.any(axis=1)) and np.all(space.free(poses[:, :2]))):
        return None
    search = make_search(
        model, plan.options.floor, plan.options.goal, count=_CANDIDATES, rng=np.random.default_rng(plan.options.seed)
    )
    search = replace(search, choice=candidates_at(model, poses, seen))
    tour = Tour(rows=tuple(range(len(poses))), spins=(0,) * len(poses))
    found = worth(search, prior_information(model, search.choice.problem), tour)
    return Baseline(name=name, poses=poses, values=found.values) if found.possible else None
