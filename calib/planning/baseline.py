"""Drives that are not planned, for comparison: an even ring, and stops at random around the box."""

from dataclasses import dataclass, replace
from math import atan2

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.planning.assumptions import assumed_model
from boxcal.calib.planning.candidates import candidates_at
from boxcal.calib.planning.plan import DrivePlan
from boxcal.calib.planning.search import Search, make_search, prior_information
from boxcal.calib.planning.tour import Tour, evaluated
from boxcal.calib.planning.views import tags_seen
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.target.arrays import Array

_RINGS = np.arange(0.3, 1.6, 0.1)
_CANDIDATES = 8
"""The search is made for its paths and quantities only."""


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
        Quantities in the order of :class:`boxcal.calib.planning.goal.Goal`.
    """

    name: str
    poses: Array
    values: Array


def baselines(plan: DrivePlan) -> tuple[Baseline, ...]:
    """Return an even ring (the best of several distances) and random stops, of as many stops as a plan has.

    What has no free path on the plan's floor is left out.
    """
    count, robot, target, options = len(plan.stops), plan.robot, plan.target, plan.options
    search = make_search(
        assumed_model(robot, target, plan.assumptions),
        options.floor,
        options.goal,
        turning_radius=options.turning_radius,
        count=_CANDIDATES,
        rng=np.random.default_rng(options.seed),
    )
    rng = np.random.default_rng(options.seed)
    gap = options.floor.clearance + robot.reach
    found = []
    rings = [drive_of(search, f"ring of {count}", ring(robot, count, float(d))) for d in _RINGS]
    seen = [r for r in rings if r is not None]
    goals = np.array([bar.goal for bar in plan.bars])
    if seen:
        found.append(min(seen, key=lambda r: float((r.values / goals).max())))
    try:
        at_random = drive_of(search, f"{count} at random", choose_stops(robot, target, count, gap, rng))
    except CalibError:  # no such places: there is nothing to compare with
        at_random = None
    return (*found, *(() if at_random is None else (at_random,)))


def drive_of(search: Search, name: str, poses: Array) -> Baseline | None:
    """Return a drive of given stops with a search's paths and quantities; None if it is blocked or misses the box."""
    model = search.model
    seen = tags_seen(model.robot, model.target, poses, model.assumptions.min_side_px, margin=0.0)
    if not (np.all(seen.any(axis=1)) and np.all(search.router.space.free(poses[:, :2]))):
        return None
    search = replace(search, choice=candidates_at(model, poses, seen))
    tour = Tour(rows=tuple(range(len(poses))), spins=(0,) * len(poses))
    found = evaluated(search, prior_information(model, search.choice.problem), tour)
    return Baseline(name=name, poses=poses, values=found.values) if found.possible else None


def ring(robot: Robot, stops: int, distance: float) -> Array:
    """Return the stops (P, 3) of an even ring around the box, the camera aimed at its middle, counterclockwise.

    Headings run on.

    Parameters
    ----------
    distance : m
        Of the camera from the box's middle.
    """
    ahead, t = robot.T_body_cam[:2, 2], robot.T_body_cam[:2, 3]
    azimuth = 2 * np.pi * np.arange(stops) / stops
    heading = azimuth + np.pi - atan2(ahead[1], ahead[0])
    c, s = np.cos(heading), np.sin(heading)
    x = distance * np.cos(azimuth) - (c * t[0] - s * t[1])
    y = distance * np.sin(azimuth) - (s * t[0] + c * t[1])
    return np.stack([x, y, heading], axis=1)
