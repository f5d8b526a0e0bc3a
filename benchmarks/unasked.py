"""Faults of real robots that the catalogue of explanations does not hold: no result ought to be good and wrong.

A camera that is loose, images that are stabilised, focus or mounting that drift with warmth, floors with a step or a
ramp, a box pushed twice, tyres that wear or warm up, wheels that spin at each start or lose ticks at speed. Each is put
on simulated drives around a box made by hand, without images. Printed for each: verdicts, errors over sigmas (root
mean square and largest) of results called good, how many of these are off by more than 5 sigma, and what was named.
Of what changes during a drive any value that it had is right.

    python benchmarks/unasked.py --quick
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import radians
from multiprocessing import get_context

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_se3, exp_so3, inverse, log_so3, planar, rigid
from boxcal.calib.simulate.drive import Drive, DriveOptions, simulate_drive
from boxcal.calib.simulate.imperfect_drive import hand_made, seen_from
from boxcal.calib.simulate.robot import Robot, random_robot
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

STOPS, WRONG = 14, 5.0
Fault = Callable[[Drive, float, np.random.Generator], Drive]


def _mounted(drive: Drive, by_stop: Array) -> Drive:
    """Return a drive whose camera is turned and moved at each stop, (P, 6) rad and m in its own axes."""
    places = np.array([T @ exp_se3(w) for T, w in zip(drive.scene.T_body_cam, by_stop, strict=True)])
    return replace(drive, scene=replace(drive.scene, T_body_cam=places))


def loose_camera(drive: Drive, size: float, rng: np.random.Generator) -> Drive:
    """Turn the camera anew at each stop, by ``size`` deg about each axis."""
    turns = radians(size) * rng.standard_normal((len(drive.stop_poses), 3))
    return _mounted(drive, np.concatenate([turns, np.zeros_like(turns)], axis=1))


def sagging_camera(drive: Drive, size: float, _: np.random.Generator) -> Drive:
    """Let the camera sag evenly from the first stop to the last, by ``size`` deg in all."""
    share = np.linspace(0, 1, len(drive.stop_poses))[:, None]
    return _mounted(drive, share * np.array([radians(size), 0, 0, 0, 0, 0]))


def stabilised(drive: Drive, size: float, rng: np.random.Generator) -> Drive:
    """Shift the image at each stop, by ``size`` px both ways."""
    shift = size * rng.standard_normal((len(drive.stop_poses), 2))
    cameras = [replace(c, cu=c.cu + u, cv=c.cv + v) for c, (u, v) in zip(drive.scene.cameras, shift, strict=True)]
    return replace(drive, scene=replace(drive.scene, cameras=tuple(cameras)))


def warming_lens(drive: Drive, size: float, _: np.random.Generator) -> Drive:
    """Let the focal length grow evenly from the first stop to the last, by ``size`` % in all."""
    grown = 1 + size / 100 * np.linspace(0, 1, len(drive.stop_poses))
    cameras = [replace(c, fu=c.fu * s, fv=c.fv * s) for c, s in zip(drive.scene.cameras, grown.tolist(), strict=True)]
    return replace(drive, scene=replace(drive.scene, cameras=tuple(cameras)))


def _floor(drive: Drive, there: Array, T: Array) -> Drive:
    """Return a drive whose floor lies elsewhere at some stops, (P,)."""
    floors = np.array(
        [T @ floor if here else floor for floor, here in zip(drive.scene.T_box_floor, there, strict=True)]
    )
    return replace(drive, scene=replace(drive.scene, T_box_floor=floors))


def step_in_floor(drive: Drive, size: float, _: np.random.Generator) -> Drive:
    """Raise the floor on one side of the box by ``size`` mm."""
    return _floor(drive, drive.stop_poses[:, 0] > 0, rigid(np.eye(3), np.array([0, 0, 1e-3 * size])))


def ramp(drive: Drive, size: float, _: np.random.Generator) -> Drive:
    """Tilt the floor on one side of the box by ``size`` deg."""
    return _floor(drive, drive.stop_poses[:, 0] > 0, rigid(exp_so3(np.array([0, -radians(size), 0])), np.zeros(3)))


def pushed_twice(drive: Drive, size: float, rng: np.random.Generator) -> Drive:
    """Push the box by ``size`` mm before two stops."""
    for stop in rng.choice(np.arange(3, len(drive.stop_poses) - 2), 2, replace=False).tolist():
        a = rng.uniform(0, 2 * np.pi)
        moved = planar(1e-3 * size * np.cos(a), 1e-3 * size * np.sin(a), radians(rng.uniform(-1, 1)))
        drive = _floor(drive, np.arange(len(drive.stop_poses)) >= stop, inverse(moved))
    return drive


def _read(drive: Drive, more: Array) -> Drive:
    """Return a drive whose wheels read what they did and so much more, (S, 2) rad from sample to sample."""
    added = np.cumsum(more, axis=0)
    return replace(drive, phi_R=drive.phi_R + added[:, 0], phi_L=drive.phi_L + added[:, 1])


def _rolled(drive: Drive) -> Array:
    return np.diff(np.stack([drive.phi_R, drive.phi_L], axis=1), axis=0, prepend=[[drive.phi_R[0], drive.phi_L[0]]])


def worn_tyre(drive: Drive, size: float, _: np.random.Generator) -> Drive:
    """Let the right wheel shrink evenly over the drive, by ``size`` % in all."""
    share = np.linspace(0, 1, len(drive.t_ns))[:, None]
    return _read(drive, _rolled(drive) * share * (size / 100, 0.0))


def lost_ticks(drive: Drive, size: float, _: np.random.Generator) -> Drive:
    """Lose ``size`` % of the right wheel's ticks where it turns faster than half of its fastest."""
    rolled = _rolled(drive)
    smooth = np.abs(np.convolve(rolled[:, 0], np.ones(9) / 9, mode="same"))
    return _read(drive, -rolled * (smooth > 0.5 * smooth.max())[:, None] * (size / 100, 0.0))


def _starts(drive: Drive) -> Array:
    """Return where each leg's wheels begin to turn, (P - 1,) samples, and in which direction, (P - 1, 2)."""
    begin = np.searchsorted(drive.t_ns, drive.stop_t_ns[:-1, 1]) + 10
    end = np.searchsorted(drive.t_ns, drive.stop_t_ns[1:, 0])
    phi = np.stack([drive.phi_R, drive.phi_L], axis=1)
    way = np.sign(phi[np.minimum(begin + 40, end)] - phi[begin])
    return np.column_stack([begin, way])


def spinning_starts(drive: Drive, size: float, rng: np.random.Generator) -> Drive:
    """Let both wheels spin at each start, by ``size`` mm and a quarter of that up or down."""
    more = np.zeros((len(drive.t_ns), 2))
    for row, right, left in _starts(drive).tolist():
        more[int(row)] = np.array([right, left]) * 1e-3 * size * (1 + 0.25 * rng.standard_normal(2)) / RADIUS
    return _read(drive, more)


def one_spins(drive: Drive, size: float, rng: np.random.Generator) -> Drive:
    """Let the right wheel alone spin at each start, by ``size`` mm and a quarter of that up or down."""
    more = np.zeros((len(drive.t_ns), 2))
    for row, right, _ in _starts(drive).tolist():
        more[int(row), 0] = right * 1e-3 * size * (1 + 0.25 * rng.standard_normal()) / RADIUS
    return _read(drive, more)


RADIUS = 0.03
"""Of a wheel that spins, m."""
FAULTS: dict[str, tuple[Fault | None, tuple[float, ...], str]] = {
    "nothing": (None, (0.0,), ""),
    "loose camera": (loose_camera, (0.02, 0.1, 0.5), "deg"),
    "sagging camera": (sagging_camera, (0.05, 0.2), "deg"),
    "stabilised pictures": (stabilised, (0.1, 0.5, 3.0), "px"),
    "lens warms": (warming_lens, (0.05, 0.2, 0.5), "%"),
    "step in the floor": (step_in_floor, (1.0, 5.0), "mm"),
    "ramp": (ramp, (0.2, 1.0), "deg"),
    "box pushed twice": (pushed_twice, (2.0, 6.0), "mm"),
    "tyre wears": (worn_tyre, (0.2, 1.0), "%"),
    "ticks lost at speed": (lost_ticks, (0.3, 1.0), "%"),
    "wheels spin at starts": (spinning_starts, (1.0, 3.0), "mm"),
    "one wheel spins": (one_spins, (1.0, 3.0), "mm"),
}


def at_the_end(name: str, size: float, robot: Robot) -> Robot:
    """Return the robot as it was at the end of a drive during which it changes, or as its wheels then read."""
    share, camera = size / 100, robot.camera
    if name == "lens warms":
        return replace(robot, camera=replace(camera, fu=camera.fu * (1 + share), fv=camera.fv * (1 + share)))
    if name == "sagging camera":
        turned = robot.T_body_cam @ exp_se3(np.array([radians(size), 0, 0, 0, 0, 0]))
        return replace(robot, T_body_cam=turned)
    grown = {"tyre wears": -share, "ticks lost at speed": share}.get(name, 0.0)
    return replace(robot, rR=robot.rR * (1 + grown))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One drive: the verdict, errors over sigmas (14,) without kr, and the causes that were named."""

    level: str
    z: Array | None
    named: tuple[str, ...]


def outcome(name: str, size: float, number: int) -> Outcome:
    """Calibrate one drive with a fault and compare with the truth."""
    fault = FAULTS[name][0]
    of_robot, of_drive, of_box, of_fault = np.random.default_rng([71, number]).spawn(4)
    target, robot = make_target(), random_robot("r", of_robot)
    faults = hand_made(of_box, lean=radians(0.01))
    faults = replace(faults, camera=replace(faults.camera, lens=(0.0, 0.0, 0.0, 0.0)))
    try:
        drive = simulate_drive(robot, target, DriveOptions(stops=STOPS), of_drive, faults=faults)
        if fault is not None:
            drive = fault(drive, size, of_fault)
        found = calibrate(seen_from(robot, target, drive, of_drive), target)
    except BoxcalError as error:
        return Outcome(level="refused", z=None, named=(error.found[:60],))
    level = str(found.verdict.level) if found.verdict else "none"
    named = tuple(f.cause for f in found.findings)
    first, last = (_errors(found, who) for who in (robot, at_the_end(name, size, robot)))
    if first is None or last is None:
        return Outcome(level=level, z=None, named=named)
    z = np.where(first * last < 0, 0.0, np.where(np.abs(first) < np.abs(last), first, last))
    return Outcome(level=level, z=z, named=named)


def _errors(found: object, robot: Robot) -> Array | None:
    if found.detail is None:  # type: ignore[attr-defined]
        return None
    c, w, T = found.camera, found.wheels, found.T_body_cam  # type: ignore[attr-defined]
    error = np.concatenate(
        [
            np.array([c.fu - robot.camera.fu, c.fv - robot.camera.fv, c.cu - robot.camera.cu, c.cv - robot.camera.cv]),
            np.array([w.rR - robot.rR, w.rL - robot.rL, w.b - robot.b]),
            log_so3(robot.T_body_cam[:3, :3].T @ T[:3, :3]),
            T[:3, 3] - robot.T_body_cam[:3, 3],
        ]
    )
    sigma = np.sqrt(np.diag(found.detail.covariance.matrix))  # type: ignore[attr-defined]
    return error / np.delete(sigma, 4)


def report(name: str, size: float, outcomes: Sequence[Outcome]) -> str:
    """Return the line of one fault and size."""
    names = np.delete(np.array(ORDER), 4)
    good = np.array([o.z for o in outcomes if o.level == "good" and o.z is not None]).reshape(-1, len(names))
    levels = Counter(o.level for o in outcomes)
    named = Counter(cause for o in outcomes for cause in set(o.named))
    text = f"{name:22} {size:5g} {FAULTS[name][2]:4} " + " ".join(
        f"{levels.get(level, 0):4}" for level in ("good", "usable", "redo", "refused")
    )
    if len(good):
        worst = np.abs(good)
        k = np.unravel_index(int(np.argmax(worst)), worst.shape)
        wrong = int(np.sum(worst.max(axis=1) > WRONG))
        text += f"   {np.sqrt(np.mean(good**2)):5.2f} {worst[k]:6.1f} ({names[k[1]]}) {wrong:4}"
    else:
        text += f"{'':24}"
    return text + "   " + ", ".join(f"{cause} {n}" for cause, n in named.most_common(4))


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line a fault and size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="4 drives each")
    parser.add_argument("--drives", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("faults", nargs="*", metavar="FAULT", help=f"of {', '.join(FAULTS)} (all)")
    args = parser.parse_args(argv)
    drives = 4 if args.quick else args.drives
    print(f"{'fault':22} {'size':>10} good usab redo refu   of good: rms, largest, beyond {WRONG:g} sigma;   named")
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for name in args.faults or FAULTS:
            for size in FAULTS[name][1]:
                print(
                    report(name, size, list(pool.map(partial(outcome, name, size), range(1, drives + 1)))), flush=True
                )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
