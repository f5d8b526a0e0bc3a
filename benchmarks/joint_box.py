"""One box, solved by all: how sharp its shape becomes, what that does to every robot, and what it costs.

    python benchmarks/joint_box.py            (about ten minutes on two cores)
    python benchmarks/joint_box.py --quick

Robots drive around one box made by hand (sheets off by 0.3 mm, faces by 0.5 mm and 0.3 deg, print 100.1 x 99.9 %);
what they see is simulated as correspondences. Each is calibrated by itself, with the box that the others found, and
with the true box.
The size of the box as a whole is common to all robots and seen by none: errors of wheels stand with it and without it.
That the solution is that of one large solve is held by tests/calib/joint_box/test_one_large_solve.py.
"""

import argparse
import os
import pickle
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from math import radians
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.geometry.so3_se3 import exp_se3, log_so3
from boxcal.calib.joint_box.one_of_many import Member, calibrate_with
from boxcal.calib.joint_box.sharpness import landmark_jacobian, similarity_free
from boxcal.calib.joint_box.together import JointBox, solve_box
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Job, Settings
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfect_drive import imperfect_drive
from boxcal.calib.simulate.imperfections import BoxFaults, CameraFaults, Imperfections, WheelFaults
from boxcal.calib.simulate.robot import Robot, random_robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target, make_target
from boxcal.target.camera.camera_model import CameraKind
from boxcal.target.measure.refined_shape import SHAPE, RefinedShape

TARGET = make_target()
CAMERA = ("fu", "fv", "cu", "cv", "kr")
NOISE_PX, SLIP, LEAN, STOPS = 0.05, 3e-4, radians(0.03), 12
DRIVES = 50
"""Different drives of the large fleet; each is seen again with fresh noise by several of its robots."""
SETTINGS = Settings(report=False)


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """A robot as it is, and what it saw."""

    robot: Robot
    seen: Correspondences


def hand_made(seed: int) -> BoxFaults:
    rng = np.random.default_rng([seed, 1])
    place, pose = np.zeros((FACES, 3)), np.zeros((FACES, 6))
    place[:, :2] = 3e-4 * rng.standard_normal((FACES, 2))
    pose[:, :3], pose[:, 3:] = radians(0.3) * rng.standard_normal((FACES, 3)), 5e-4 * rng.standard_normal((FACES, 3))
    return BoxFaults(scale=(1.001, 0.999), place=place, pose=pose)


def drive(number: int, box: BoxFaults, seed: int) -> Simulated:
    faults = Imperfections(wheels=WheelFaults(slip=SLIP), camera=CameraFaults(noise=NOISE_PX), box=box, lean=LEAN)
    robot = random_robot(f"r{number:04d}", np.random.default_rng([seed, 2, number]))
    rng = np.random.default_rng([seed, 3, number])
    return Simulated(robot=robot, seen=imperfect_drive(robot, TARGET, DriveOptions(stops=STOPS), faults, rng).seen)


def true_target(box: BoxFaults) -> Target:
    """Return the box as it was built, exactly known."""
    true = dict.fromkeys(SHAPE, 0.0) | {"scale_x": box.scale[0] - 1, "scale_y": box.scale[1] - 1}
    assert box.place is not None
    assert box.pose is not None
    for f in range(FACES):
        sheet = np.eye(4)
        sheet[:2, 3] = box.place[f, :2]
        T = exp_se3(box.pose[f]) @ sheet
        for k, axis in enumerate("xyz"):
            true[f"face{f}_t{axis}"], true[f"face{f}_r{axis}"] = T[k, 3], log_so3(T[:3, :3])[k]
    values = np.array([true[name] for name in SHAPE])
    return make_target(TARGET.box, None, RefinedShape(values=values, cov=np.zeros((len(SHAPE),) * 2), robots=1))


def member(simulated: Simulated) -> Member:
    name = simulated.robot.name
    job = Job(robot=name, logs=(Path(name),), target=TARGET, settings=SETTINGS, out=None)
    return Member(job=job, drives=(simulated.seen,))


def alone(seen: Correspondences, target: Target) -> Calibration:
    return calibrate(seen, target, settings=SETTINGS)


def timed(work: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, float]:
    """Return what some work gives, and the processor time that it took, s."""
    begun = time.process_time()
    return work(*arguments), time.process_time() - begun


class Clocked:
    """Work on the processes of a pool, with the processor time that it took and the bytes that went to and fro."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self.pool, self.seconds, self.results = pool, 0.0, 0

    def __call__(self, work: Callable[..., Any], *each: Iterable[Any]) -> Iterable[Any]:
        """Yield what the work gives for each, in order."""
        for result, seconds in self.pool.map(partial(timed, work), zip(*each, strict=True), chunksize=4):
            self.seconds += seconds
            self.results += len(pickle.dumps(result))
            yield result


def errors(found: Sequence[Calibration], robots: Sequence[Robot], growth: float = 0.0) -> tuple[Array, Array]:
    """Return errors of cameras (R, 5), px and 1, and of wheels (R, 3), relative, for a box too large by a growth."""
    camera = [[getattr(c.camera, n) - getattr(r.camera, n) for n in CAMERA] for c, r in zip(found, robots, strict=True)]
    for row, c in zip(camera, found, strict=True):
        if c.camera.kind is CameraKind.FISHEYE:
            row[-1] = np.nan  # another model's coefficient is another quantity
    wheels = [
        [getattr(c.wheels, n) / getattr(r, n) / (1 + growth) - 1 for n in ("rR", "rL", "b")]
        for c, r in zip(found, robots, strict=True)
    ]
    return np.array(camera), np.array(wheels)


def sigmas(found: Sequence[Calibration], robots: Sequence[Robot]) -> Array:
    """Return the standard deviations of cameras and wheels in the units of :func:`errors`, (R, 8)."""
    unit = np.array([[1.0] * 5 + [r.rR, r.rL, r.b] for r in robots])
    cov = [np.full((14, 14), np.nan) if c.detail is None else c.detail.covariance.matrix for c in found]
    return np.array([np.sqrt(np.diag(C))[:8] for C in cov]) / unit


def rms(values: Array) -> Array:
    return np.sqrt(np.nanmean(np.square(values), axis=0))


@dataclass(frozen=True, kw_only=True)
class Study:
    """One fleet: errors and sigmas of cameras and wheels, (R, 8), with the box of the others and with the true one."""

    joint: Array
    true: Array
    joint_sigma: Array
    true_sigma: Array


def shape_study(count: int, seed: int, pool: ProcessPoolExecutor) -> Study:
    box = hand_made(seed)
    fleet = list(pool.map(drive, range(count), [box] * count, [seed] * count))
    members, run = [member(s) for s in fleet], Clocked(pool)
    joint = solve_box(members, run)
    true = true_target(box)
    names = joint.prior.names
    growth = print_shape(joint, true, names)
    taking = [k for k, block in enumerate(joint.blocks) if block is not None]
    print(f"robots left out: {', '.join(joint.left_out) or 'none'}")
    boxes = [joint.without(k) for k in taking]
    found = list(run(calibrate_with, [members[k] for k in taking], boxes, [joint.target] * len(taking)))
    seen, robots = [fleet[k].seen for k in taking], [fleet[k].robot for k in taking]
    by_itself = list(run(alone, seen, [TARGET] * len(seen)))
    with_true = list(run(alone, seen, [true] * len(seen)))
    print(f"\nroot mean square errors of {len(taking)} robots")
    print(f"{'':36}" + "".join(f"{n:>10}" for n in ("fu px", "fv px", "cu px", "cv px", "kr", "rR %", "rL %", "b %")))
    table = {
        "by itself": errors(by_itself, robots),
        "with the box of the others": errors(found, robots),
        "  the common size taken out": errors(found, robots, growth),
        "with the true box": errors(with_true, robots),
    }
    for name, (camera, wheels) in table.items():
        figures = [*rms(camera), *(100 * rms(wheels))]
        print(f"{name:36}" + "".join(f"{x:10.4f}" for x in figures))
    for name in ("by itself", "with the box of the others", "  the common size taken out"):
        ratios = [rms(a) / rms(b) for a, b in zip(table[name], table["with the true box"], strict=True)]
        print(f"{name + ' / true':36}" + "".join(f"{x:10.3f}" for x in np.concatenate(ratios)))
    study = Study(
        joint=np.concatenate(table["with the box of the others"], axis=1),
        true=np.concatenate(table["with the true box"], axis=1),
        joint_sigma=sigmas(found, robots),
        true_sigma=sigmas(with_true, robots),
    )
    print_bound(study)
    another(fleet, joint, seed, pool, count)
    return study


def print_bound(study: Study) -> None:
    """Print what the box's own uncertainty must cost: variances with it less those without, the Cramer-Rao bound's."""
    known = ~np.isnan(study.joint) & ~np.isnan(study.true)
    off = np.where(known, study.true, np.nan)
    more = np.nanmean(np.where(known, study.joint_sigma**2 - study.true_sigma**2, np.nan), axis=0)
    rows = {
        "sigmas / those with the true box": rms(study.joint_sigma) / rms(study.true_sigma),
        "errors / true, expected at the bound": np.sqrt(1 + np.maximum(more, 0.0) / np.square(rms(off))),
        "errors / sigmas (rms)": rms(study.joint / study.joint_sigma),
        "  with the true box": rms(study.true / study.true_sigma),
    }
    for name, row in rows.items():
        print(f"{name:36}" + "".join(f"{x:10.3f}" for x in row))


def print_shape(joint: JointBox, true: Target, names: Sequence[str]) -> float:
    """Print how far the shape is from the true one; return by how much, relative, the box came out too large."""
    assert true.refined is not None
    assert joint.target.refined is not None
    at = [SHAPE.index(name) for name in names]
    d = joint.target.refined.values[at] - true.refined.values[at]
    cov = joint.target.refined.cov[np.ix_(at, at)]
    J = landmark_jacobian(joint.target, names)
    free, scale = similarity_free(joint.target)
    left = free(J)
    sigma = np.sqrt(np.einsum("im,mk,ik->i", left, cov, left))
    off = left @ d
    z = off / sigma
    growth = float(scale @ J @ d)
    print(f"{joint.robots} robots, {joint.joined.rounds} rounds, spread {joint.joined.agreement.posterior.spread:.2f}")
    print(
        f"shape: sigma of one robot {1e3 * joint.before.shape:.4f} mm, of all {1e3 * joint.after.shape:.4f} mm: "
        f"{joint.before.shape / joint.after.shape:.1f} times sharper"
    )
    print(
        f"  error {1e3 * np.sqrt(3 * np.mean(off**2)):.4f} mm; landmarks' errors over sigmas: rms {rms(z):.2f}, "
        f"largest {np.abs(z).max():.2f}; all unknowns together chi-square {d @ np.linalg.solve(cov, d):.1f} of {len(d)}"
    )
    ratio = np.array([float(name == "scale_y") - float(name == "scale_x") for name in names])
    print(f"ratio of the print's scales: off by {ratio @ d / np.sqrt(ratio @ cov @ ratio):+.2f} sigma")
    print(f"size of the whole box: off by {growth:+.3%}, sigma {joint.after.scale:.3%}")
    return growth


def another(fleet: list[Simulated], joint: JointBox, seed: int, pool: ProcessPoolExecutor, count: int) -> None:
    """Print what one more robot, of another box, does to the others."""
    stranger = drive(count, hand_made(seed + 1), seed)
    with_it = solve_box([member(s) for s in [*fleet, stranger]], Clocked(pool))
    assert joint.target.refined is not None
    assert with_it.target.refined is not None
    sigma = np.sqrt(np.maximum(np.diag(joint.target.refined.cov), 1e-30))
    moved = np.abs(with_it.target.refined.values - joint.target.refined.values) / sigma
    print(f"\na robot of another box: {next(iter(with_it.left_out.items()), ('not', 'found'))}")
    print(f"  the shape moves by {moved.max():.1e} sigma at most")


def again(number: int, first: Simulated, seed: int) -> Member:
    """Return a robot of the large fleet: a drive seen once more, with fresh noise."""
    rng = np.random.default_rng([seed, 4, number])
    stops = tuple(replace(s, uv_px=s.uv_px + NOISE_PX * rng.standard_normal(s.uv_px.shape)) for s in first.seen.stops)
    wheels = replace(first.seen.wheels, t_ns=first.seen.wheels.t_ns + number)  # no drive counts twice
    again = replace(first.seen, stops=stops, wheels=wheels, robot=f"r{number:04d}")
    return member(Simulated(robot=replace(first.robot, name=f"r{number:04d}"), seen=again))


def speed_study(count: int, seed: int, pool: ProcessPoolExecutor, workers: int) -> None:
    box = hand_made(seed)
    kinds = min(DRIVES, count)
    drives = list(pool.map(drive, range(kinds), [box] * kinds, [seed + 7] * kinds))
    members = [again(k, drives[k % kinds], seed) for k in range(count)]
    run, here, begun = Clocked(pool), time.process_time(), time.perf_counter()
    joint = solve_box(members, run)
    clock, here, solved = time.perf_counter() - begun, time.process_time() - here, run.seconds
    per_robot = run.results / count / (joint.joined.rounds + 1)
    print(f"\n{count} robots: {joint.joined.rounds} rounds, {len(joint.left_out)} left out")
    print(
        f"  joint solution: {solved:.0f} s of processor time in {workers} workers "
        f"({1e3 * solved / count:.0f} ms a robot), "
        f"{here:.0f} s in the coordinator (pickling among it); by the clock {clock:.0f} s"
    )
    print(f"  on {workers} cores: {solved / workers + here:.0f} s; goal 180 s")
    print(f"  {per_robot / 1e3:.1f} kB come back from a robot a round")
    print(f"  shape: {joint.before.shape / joint.after.shape:.1f} times sharper than one robot's")
    some = [k for k in range(0, count, max(1, count // 20)) if joint.blocks[k] is not None]
    run = Clocked(pool)
    boxes = [joint.without(k) for k in some]
    made = list(run(calibrate_with, [members[k] for k in some], boxes, [joint.target] * len(some)))
    print(
        f"  calibrating each anew with it: {1e3 * run.seconds / len(made):.0f} ms a robot (of {len(made)}), "
        f"{run.seconds / len(made) * count / workers:.0f} s for all on {workers} cores"
    )


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--fleet", type=int, default=1000, help="robots of the study of speed; 0 leaves it out")
    parser.add_argument("--seed", type=int, nargs="+", default=[2026], help="a fleet each")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    args = parser.parse_args()
    count, many = (6, 24) if args.quick else (args.robots, args.fleet)
    prepare_all(print)
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        studies = [shape_study(count, seed, pool) for seed in args.seed] if count else []
        if len(studies) > 1:
            whole = Study(**{f.name: np.concatenate([getattr(s, f.name) for s in studies]) for f in fields(Study)})
            print(f"\nall {len(studies)} fleets")
            print(
                f"{'with the box of the others / true':36}"
                + "".join(f"{x:10.3f}" for x in rms(whole.joint) / rms(whole.true))
            )
            print_bound(whole)
        if many:
            speed_study(many, args.seed[0], pool, args.jobs)


if __name__ == "__main__":
    main()
