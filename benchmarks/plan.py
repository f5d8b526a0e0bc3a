"""Does it pay to plan where to drive? Planned drives and next stops against rings and random stops, in simulation.

Three tables:

1. *Plans*: for robots of different build, a planned drive of 8 and of 20 stops against a ring of 20 (the simulator's:
   two rounds of 10, distances and aims at random, as an even ring leaves the camera open). Both drives are simulated;
   their sigmas are the Cramer-Rao bound, not what the planner says. The *worst sigma* is the largest over its goal. The
   strict line plans for the ring's own six sigmas as goals.
2. *Promises*: planned drives are driven around three boxes made by hand, drawn as the planner assumes them, and
   estimated; errors over promised sigmas.
3. *What next*: partial drives of 3 to 6 stops are estimated, then one more stop is driven: the one proposed, or one at
   random from which the box is seen. How often does the worst sigma halve, and is the promise kept?

    python benchmarks/plan.py                 50 robots, 200 partial drives
    python benchmarks/plan.py --quick         4 robots, 6 partial drives
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.planning.assumptions import Assumptions, assumed_model
from boxcal.calib.planning.candidates import Distances, free_poses
from boxcal.calib.planning.chain import append, first_stop, of_shared
from boxcal.calib.planning.floor import Floor, free_space
from boxcal.calib.planning.goal import LABELS, Goal, bars_of_estimate, quantities, worst
from boxcal.calib.planning.leg_information import leg_information_of
from boxcal.calib.planning.next_stops import what_next
from boxcal.calib.planning.paths import Router
from boxcal.calib.planning.plan import DrivePlan, PlanOptions, plan_drive
from boxcal.calib.planning.promise import Promise
from boxcal.calib.planning.search import prior_information
from boxcal.calib.planning.stop_information import expected_problem, picture_information
from boxcal.calib.planning.views import tags_seen
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.imperfections import Imperfections, WheelFaults
from boxcal.calib.simulate.robot import Robot, random_robot
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.calib.uncertainty.cramer_rao import Truth, cramer_rao, errors
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import project
from boxcal.target.errors import BoxcalError

TARGET = make_target()
GIVEN = Assumptions(height=0.0, growth=0.0)
RING, FEW, PLANNED = 20, 8, 12
REPEATED = 3
"""Drives of each plan: the errors of one robot's wheels hang together."""
INSIDE = 1.959964
"""Standard deviations within which 95 % of a normal variable lie."""


def robot(number: int) -> Robot:
    """Return one of the robots of different build."""
    return random_robot(f"r{number:03d}", np.random.default_rng([77, number]))


def drive(of: Robot, stops: Array | int, rng: np.random.Generator) -> Drive:
    """Return a simulated drive to given stops, or to a number of them on a ring."""
    count, poses = (stops, None) if isinstance(stops, int) else (len(stops), stops)
    faults = Imperfections(wheels=WheelFaults(slip=GIVEN.slip), lean=GIVEN.lean)
    options = DriveOptions(stops=count, encoder_step=GIVEN.encoder_step)
    return simulate_drive(of, TARGET, options, rng, poses, faults=faults)


def truth(of: Robot, driven: Drive) -> Truth:
    """Return what is true of a simulated drive."""
    found = Truth.of(of, driven.stop_poses, slip=GIVEN.slip, encoder_step=GIVEN.encoder_step)
    return replace(found, lean=GIVEN.lean, target=dict(GIVEN.target))


def bound(of: Robot, stops: Array | int, seed: int) -> Array:
    """Return the six quantities that the Cramer-Rao bound gives for a drive."""
    rng = np.random.default_rng(seed)
    driven = drive(of, stops, rng)
    seen = exact_correspondences(of, TARGET, driven, GIVEN.corner_px, rng)
    cov = cramer_rao([seen], truth(of, driven), EstimateOptions(lens=of.camera.kind, target=TARGET))
    return np.array([bar.value for bar in quantities(ORDER, of, of.image_size, Goal()).bars(cov)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planned:
    """One robot: quantities of the ring (6,), of plans for the user's goals and for the ring's, and times."""

    ring: Array
    few: Array
    many: Array
    strict_few: Array
    strict_many: Array
    seconds: float


def planned(number: int) -> Planned:
    """Plan for one robot, and compare with the ring."""
    of = robot(number)
    ring = bound(of, RING, number)
    strict = Goal(**dict(zip(LABELS, ring.tolist(), strict=True)))
    begun = time.process_time()
    plan_drive(of, TARGET, PlanOptions(stops=PLANNED), GIVEN)
    seconds = time.process_time() - begun

    def of_plan(stops: int, goal: Goal) -> Array:
        return bound(of, plan_drive(of, TARGET, PlanOptions(stops=stops, goal=goal), GIVEN).poses, number)

    return Planned(
        ring=ring,
        few=of_plan(FEW, Goal()),
        many=of_plan(RING, Goal()),
        strict_few=of_plan(FEW, strict),
        strict_many=of_plan(RING, strict),
        seconds=seconds,
    )


def hand_made(of: Robot, stops: Array, seed: tuple[int, ...]) -> tuple[Drive, Correspondences]:
    """Return a drive around a box made by hand, drawn as the planner assumes boxes, and what the robot sees.

    With the same seed a drive of more stops begins with the same box, legs and images: it is the same drive continued.
    """
    driven = drive(of, stops, np.random.default_rng([*seed, 0]))
    of_box, of_pictures = np.random.default_rng([*seed, 1]), np.random.default_rng([*seed, 2])
    seen = exact_correspondences(of, TARGET, driven)
    options = EstimateOptions(lens=of.camera.kind, target=TARGET)
    problem = build_problem([seen], [tuple(range(len(seen.stops)))], options, GIVEN.encoder_step)
    sigma = GIVEN.components.prior_sigma(problem)[problem.shapes]
    p_box, _ = problem.target.landmarks(sigma * of_box.standard_normal(len(sigma)))
    ends = np.cumsum([len(stop.landmark_ids) for stop in seen.stops])[:-1]
    views = []
    for stop, p, T in zip(seen.stops, np.split(p_box, ends), driven.T_box_cam, strict=True):
        T_cam_box = inverse(T)
        uv = project(of.camera, p @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        noise = GIVEN.corner_px * of_pictures.standard_normal(uv.shape)
        cov = np.broadcast_to(np.eye(2) * GIVEN.corner_px**2, stop.cov_px2.shape).copy()
        views.append(replace(stop, uv_px=uv + noise, cov_px2=cov))
    return driven, replace(seen, stops=tuple(views))


def solved(of: Robot, seen: Correspondences) -> Estimate:
    """Return the estimate; noise is white here, and the camera is of the robots' kind."""
    return estimate([seen], options=EstimateOptions(lens=of.camera.kind, target=TARGET, systematic_share=0.0))


def promised_sigma(plan: DrivePlan) -> Array:
    """Return the standard deviations (14,) that a plan promises, in the terms of estimates."""
    model = assumed_model(plan.robot, TARGET, GIVEN)
    seen = tags_seen(plan.robot, TARGET, plan.poses, GIVEN.min_side_px)
    problem, state = expected_problem(model, plan.poses, seen)
    pictures, router = (
        picture_information(model, problem, state),
        Router(free_space(Floor(), TARGET.box, plan.robot.reach)),
    )
    chain = first_stop(prior_information(model, problem), pictures[:1])
    turned = np.array([stop.turn.sum() for stop in plan.stops])
    for k in range(1, len(plan.poses)):
        here, there = plan.poses[k - 1 : k], plan.poses[k : k + 1]
        paths = router.paths(here, there)
        whole = np.rint((turned[k : k + 1] - paths.turn.sum(axis=1)) / (2 * np.pi)).astype(np.int64)
        legs = leg_information_of(model, (problem, state), paths.with_whole_turns(whole), start=here, end=there)
        chain = append(chain, legs, pictures[k : k + 1])
    cov = np.linalg.inv(of_shared(chain)[0])[:14, :14]
    turn = np.eye(14)
    turn[11:, 11:] = plan.robot.T_body_cam[:3, :3]
    return np.sqrt(np.diag(turn @ cov @ turn.T))


def promise(number: int) -> list[Array]:
    """Return errors over promised sigmas, (14,), of drives of one plan; of those that could be estimated."""
    of = robot(number)
    plan = plan_drive(of, TARGET, PlanOptions(stops=PLANNED), GIVEN)
    sigma, found = promised_sigma(plan), []
    for k in range(REPEATED):
        driven, seen = hand_made(of, plan.poses, (5, number, k))
        try:
            found.append(errors(solved(of, seen), truth(of, driven)) / sigma)
        except BoxcalError as error:
            print(f"{of.name}: {error}")
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Next:
    """One partial drive: worst sigma over its goal before, as promised, and with the next and with a random stop."""

    before: float
    promised: float
    promise: Promise
    found: float
    at_random: float


def next_stop(number: int) -> Next | None:
    """Drive one more stop after a partial drive, the one proposed and one at random; None if it cannot be solved."""
    rng = np.random.default_rng([9, number])
    of, count = robot(1000 + number), 3 + number % 4
    try:
        begun = choose_stops(of, TARGET, count, DriveOptions().clearance + of.reach, rng)
        _, seen = hand_made(of, begun, (9, number))
        known = solved(of, seen)
        (stop,) = what_next(known, [seen], TARGET, count=1)
        space = free_space(Floor(), TARGET.box, of.reach)
        free, _ = free_poses(of, TARGET, space, Distances(), min_side_px=GIVEN.min_side_px, count=1, rng=rng)
        here = begun[-1]
        turn = Router(space).paths(here[None], free).turn.sum()
        goals = [[stop.x, stop.y, here[2] + stop.turn], [free[0, 0], free[0, 1], here[2] + turn]]
        after = [_after(of, np.array([*begun, goal]), number) for goal in goals]
    except BoxcalError as error:
        print(f"{of.name}: {error}")
        return None
    bars = bars_of_estimate(known)
    return Next(
        before=worst(bars).ratio,
        promised=worst(stop.after).ratio,
        promise=stop.promise,
        found=after[0],
        at_random=after[1],
    )


def _after(of: Robot, stops: Array, number: int) -> float:
    """Return the worst sigma over its goal of a drive that is continued; infinite where it cannot be solved."""
    _, seen = hand_made(of, stops, (9, number))
    try:
        return worst(bars_of_estimate(solved(of, seen))).ratio
    except BoxcalError as error:
        print(f"{of.name}, one stop more: {error}")
        return float("inf")


def show_plans(found: list[Planned]) -> None:
    """Print the first table."""
    goals = np.array([getattr(Goal(), name) for name in LABELS])

    def ratios(name: str) -> Array:
        return np.array([np.max(getattr(p, name) / goals) / np.max(p.ring / goals) for p in found])

    few, many = ratios("few"), ratios("many")
    strict_few, strict_many = (
        np.array([np.max(getattr(p, name) / p.ring) for p in found]) for name in ("strict_few", "strict_many")
    )
    print(f"plans for {len(found)} robots against a ring of {RING} stops; Cramer-Rao bound of the simulated drives")
    print(
        f"  worst sigma, {FEW} planned stops over the ring's: median {np.median(few):.2f}, largest {few.max():.2f}; "
        f"at most the ring's for {np.mean(few <= 1):.0%}"
    )
    print(
        f"  worst sigma, the ring's over {RING} planned stops': median {np.median(1 / many):.2f}, smallest "
        f"{np.min(1 / many):.2f}; at least 1.6 for {np.mean(many <= 1 / 1.6):.0%}"
    )
    print(
        f"  strict (largest of all six sigmas over the ring's own): {FEW} stops median {np.median(strict_few):.2f}, "
        f"{RING} stops median {np.median(strict_many):.2f}, largest {strict_many.max():.2f}"
    )
    seconds = np.array([p.seconds for p in found])
    print(
        f"  planning {PLANNED} stops: median {np.median(seconds):.2f} s of processor time, largest {seconds.max():.2f}"
    )


def show_promises(z: Array) -> None:
    """Print the second table."""
    print(f"promises: {len(z)} planned drives of {PLANNED} stops, driven and estimated; errors over promised sigmas")
    for name, columns in (
        ("camera", slice(0, 5)),
        ("wheels", slice(5, 8)),
        ("extrinsics", slice(8, 14)),
        ("all", slice(0, 14)),
    ):
        part = z[:, columns]
        inside = np.mean(np.abs(part) < INSIDE)
        print(f"  {name:<11} rms {np.sqrt(np.mean(part**2)):.2f}, 95 % intervals hold {inside:.1%}")


def show_next(found: list[Next]) -> None:
    """Print the third table."""
    halved = np.array([n.found <= n.before / 2 for n in found])
    chance = np.array([n.at_random <= n.before / 2 for n in found])
    off = np.array([n.promised / n.found for n in found])
    gain = np.array([(1 - n.promised / n.before) / max(1 - n.found / n.before, 1e-9) for n in found])
    print(f"what next: {len(found)} partial drives of 3 to 6 stops")
    print(
        f"  worst sigma halved: proposed {halved.mean():.1%}, at random {chance.mean():.1%}, "
        f"ratio {halved.mean() / max(chance.mean(), 1e-9):.2f}"
    )
    print(
        f"  worst sigma after, over before: proposed median {np.median([n.found / n.before for n in found]):.2f}, "
        f"at random {np.median([n.at_random / n.before for n in found]):.2f}"
    )
    print(
        f"  promised over found: sigma median {np.median(off):.2f}, within 20 %: {np.mean(np.abs(off - 1) < 0.2):.0%};"
        f" gain median {np.median(gain):.2f}, within 20 %: {np.mean(np.abs(gain - 1) < 0.2):.0%}"
    )
    low, high = (np.array([getattr(n.promise, end) / n.promise.middle for n in found]) for end in ("low", "high"))
    print(
        f"  promised range, median {np.median(low):.2f} to {np.median(high):.2f} of the promise: holds "
        f"{np.mean((low <= 1 / off) & (1 / off <= high)):.0%}, found below it {np.mean(1 / off < low):.0%}, "
        f"above {np.mean(1 / off > high):.0%}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--drives", type=int, default=200, help="partial drives")
    parser.add_argument("--first", type=int, default=0, help="number of the first robot or drive: a study in parts")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", choices=("plans", "promises", "next"))
    args = parser.parse_args()
    counts = (4, 6) if args.quick else (args.robots, args.drives)
    robots, drives = (range(args.first, args.first + count) for count in counts)
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        if args.only in {None, "plans"}:
            show_plans(list(pool.map(planned, robots)))
        if args.only in {None, "promises"}:
            show_promises(np.array([z for of_plan in pool.map(promise, robots) for z in of_plan]))
        if args.only in {None, "next"}:
            show_next([n for n in pool.map(next_stop, drives) if n is not None])


if __name__ == "__main__":
    main()
