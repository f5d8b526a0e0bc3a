"""Frames on the move: errors against the Cramer-Rao bound, clock offsets, and what wrong assumptions do.

Simulated robots with 20 stops and up to 55 frames between them, corners with .1 px of noise, no images. Each drive is
solved from its stops alone and with its frames. Printed:

1. at slip .3 and 2 mm/sqrt(m), clock offsets of -80 to 80 ms: errors of tx, ty, rR and b over the bound (root mean
   square), and over those of a solution of the same data that is given the true noise levels, how often 95 % intervals
   hold the truth, errors of the offset over their sigmas, and errors of stops over those with frames;
2. with jitter of 5 ms, exposures of 20 ms, a rolling shutter of 20 ms (also at 2 mm/sqrt(m)), stamps late by 3 s, a
   clock that jumps by 5 or 50 ms half way, one that runs 300 ppm fast: how often frames were used and something was
   said, errors over their sigmas with frames and from stops alone, how many are beyond 3 sigma with frames only, and
   how much larger they are at most, in sigmas of the stops;
3. drives without any stop, from 40 frames, by the whole line: how many are calibrated and how many called good, errors
   over their sigmas (root mean square of tx, ty, rR, b), and why others are refused.

    python benchmarks/moving.py                    40 robots each, some 17 minutes on one core
    python benchmarks/moving.py --quick            4 robots each
    python benchmarks/moving.py --only "2 mm" "no stops, 2 mm"
"""

import argparse
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import one_time
from boxcal.calib.likelihood.moving.merge import with_moving_frames
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import joined, maximised, solved
from boxcal.calib.results.verdict import Level
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.calib.simulate.robot import VGA, Robot, random_robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

STOPS, FRAMES, SIGMA_PX = 20, 55, 0.1
FRAMES_ALONE = 40
"""Of a drive whose stops nobody looked at."""
NAMES = ("tx", "ty", "rR", "b")
INSIDE = 1.959964
"""Standard deviations within which 95 % of a normal variable lie."""
GOAL_RATIO, GOAL_COVER, GOAL_GAIN = 1.2, (0.93, 0.97), 3.0
ROLLING = "rolling 20 ms"
WRONG = {
    "jitter 5 ms": ShutterOptions(late_s=0.02, jitter_s=0.005),
    "exposure 20 ms": ShutterOptions(late_s=0.02, exposure_s=0.02),
    ROLLING: ShutterOptions(late_s=0.02, readout_s=0.02),
    "late by 3 s": ShutterOptions(late_s=3.0),
    "clock jumps 5 ms": ShutterOptions(late_s=0.02, clock_jump_s=0.005),
    "clock jumps 50 ms": ShutterOptions(late_s=0.02, clock_jump_s=0.05),
    "clock at 300 ppm": ShutterOptions(late_s=0.02, clock_rate=3e-4),
}
SAID = (
    "jitter by",
    "shutter rolls",
    "shutter is open",
    "clock jumps",
    "clock runs",
    "disagree among themselves",
    "left out",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alone:
    """One robot without stops: errors of ``NAMES`` over their sigmas, (4,), sigma of tx (m), and verdict."""

    z: Array
    sigma: float
    level: Level


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One robot: errors of ``NAMES`` and sigmas, (4,), with frames and from stops alone, the bound, and the offset.

    ``known`` are errors with frames where the noise levels are given; NaN where the solver does not get there.
    """

    error: Array
    sigma: Array
    alone: Array
    alone_sigma: Array
    bound: Array
    known: Array
    late_z: float
    note: str

    @property
    def used(self) -> bool:
        """Whether frames were used."""
        return "were used" in self.note


def robot(number: int, seed: int, slip: float, shutter: ShutterOptions, moving: Moving) -> Outcome | None:
    """Return what one robot's drive gives; None if it has no place to drive or its stops do not determine it."""
    of_robot, of_drive, of_pixels, of_frames = np.random.default_rng([seed, number]).spawn(4)
    target = make_target()
    who = random_robot(f"r{number:02d}", of_robot, VGA)
    try:
        drive = simulate_drive(who, target, DriveOptions(stops=STOPS, slip=slip), of_drive)
        seen = exact_correspondences(who, target, drive, SIGMA_PX, of_pixels)
        options = EstimateOptions(target=target, systematic_share=0.0)
        found = fit([seen], None, options)
    except BoxcalError:
        return None
    frames = moving_frames(who, target, drive, shutter, of_frames)
    kept = np.sort(of_frames.permutation(len(frames))[:FRAMES])
    seen = replace(seen, moving=tuple(frames[k] for k in kept))
    alone = reported(found, [seen], options)
    try:
        both = with_moving_frames(alone, found, [seen], moving)
    except CalibError as error:
        both = replace(alone, notes=(f"left out: {error}",))
    limit, known = bound(found, seen, slip, shutter.late_s, who)
    late = dict(zip(both.names, both.values.tolist(), strict=True)).get("camera_late")
    return Outcome(
        error=errors(both, who),
        sigma=sigmas(both),
        alone=errors(alone, who),
        alone_sigma=sigmas(alone),
        bound=limit,
        known=known,
        late_z=np.nan if late is None else (late - shutter.late_s) / both.extra_sigma["camera_late"],
        note=both.notes[-1] if both.notes else "",
    )


def errors(found: Estimate, who: Robot) -> Array:
    """Return the errors of ``NAMES``, (4,), m."""
    off = found.T_body_cam[:3, 3] - who.T_body_cam[:3, 3]
    return np.array([off[0], off[1], found.rR - who.rR, found.b - who.b])


def sigmas(found: Estimate) -> Array:
    """Return the standard deviations of ``NAMES``, (4,), m."""
    return np.array([found.sigma[name] for name in NAMES])


def bound(found: Fit, seen: Correspondences, slip: float, late_s: float, who: Robot) -> tuple[Array, Array]:
    """Return the Cramer-Rao bound of ``NAMES`` with all frames for known noise levels, and such a solution's errors."""
    noise = FrameNoise(slip=slip, jitter_s=1e-6, sway=0.03, scale=1.0)
    clocks = one_time(1).plus(np.array([late_s]), np.zeros(1))
    joint = joined(found, [seen], np.arange(len(seen.moving)), clocks, noise)
    cov = solved(found, joint, noise, np.array([slip]), np.array([1e-6])).solution.cov[0]
    R = joint.state.T_body_cam[:3, :3]
    place = R @ cov[11:14, 11:14] @ R.T
    limit = np.sqrt(np.array([place[0, 0], place[1, 1], cov[5, 5], cov[7, 7]]))
    there = maximised(found, [seen], joint, noise)
    if there is None:
        return limit, np.full(len(NAMES), np.nan)
    off = there.state.T_body_cam[:3, 3] - who.T_body_cam[:3, 3]
    return limit, np.array([*off[:2], there.state.wheels[0] - who.rR, there.state.wheels[2] - who.b])


def right_assumptions(outcomes: Iterable[Outcome], title: str) -> None:
    """Print line 1 for robots of one slip."""
    done = [o for o in outcomes if o.used]
    error, alone = np.array([o.error for o in done]), np.array([o.alone for o in done])
    z = error / np.array([o.sigma for o in done])
    late = np.array([o.late_z for o in done])
    print(
        f"{title}: {len(done)} robots with frames (root mean squares are known to {50 * (2 / len(done)) ** 0.5:.0f} %)"
    )
    _row("", NAMES)
    _row("error over the bound, rms", _rms(error / np.array([o.bound for o in done])), f"   goal {GOAL_RATIO}")
    known = np.array([o.known for o in done])
    told = np.isfinite(known).all(axis=1)
    _row("over that of known noise", _rms(error[told]) / _rms(known[told]))
    _row("error over sigma, rms", _rms(z))
    _row("sigma over that of stops", np.median([o.sigma / o.alone_sigma for o in done], axis=0))
    _row("errors of stops over these", _rms(alone) / _rms(error), f"   goal {GOAL_GAIN:g} (tx at 2 mm)")
    print(f"  95 % intervals hold {100 * np.mean(np.abs(z) < INSIDE):.1f} % (goal 93 to 97)")
    print(f"  offset: rms {_rms(late):.2f} sigma, largest {np.max(np.abs(late)):.2f} (goal 3)")


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _row(what: str, values: Iterable[object], goal: str = "") -> None:
    cells = "".join(f"{v:8.2f}" if isinstance(v, float) else f"{v:>8}" for v in values)
    print(f"  {what:26}{cells}{goal}")


def wrong_assumptions(outcomes: Iterable[Outcome], title: str) -> None:
    """Print line 2 for robots of one wrong assumption."""
    done = list(outcomes)
    z = np.abs([o.error / o.sigma for o in done])
    alone = np.abs([o.alone / o.alone_sigma for o in done])
    worse = max(np.max((np.abs(o.error) - np.abs(o.alone)) / o.alone_sigma) for o in done)
    said = sum(any(word in o.note for word in SAID) for o in done)
    print(
        f"{title:20}{sum(o.used for o in done):5} /{len(done):3}{said:6}{z.max():9.1f}{alone.max():7.1f}"
        f"{_rms(z.ravel()):8.2f}{_rms(alone.ravel()):7.2f}{np.sum((z > 3) & (alone <= 3)):6}{worse:8.1f}",
        flush=True,
    )


def without_stops(number: int, seed: int, slip: float, shutter: ShutterOptions) -> Alone | str | None:
    """Return what a robot's drive gives whose stops nobody looked at, or why it is refused; None if there is none."""
    of_robot, of_drive, of_frames = np.random.default_rng([seed, number, 1]).spawn(3)
    target, who = make_target(), random_robot(f"r{number:02d}", of_robot, VGA)
    try:
        drive = simulate_drive(who, target, DriveOptions(stops=STOPS, slip=slip), of_drive)
        seen = exact_correspondences(who, target, drive, SIGMA_PX, of_frames)
    except BoxcalError:
        return None
    frames = moving_frames(who, target, drive, shutter, of_frames)
    kept = np.unique(np.linspace(0, len(frames) - 1, FRAMES_ALONE).round().astype(int))
    try:
        found = calibrate(replace(seen, stops=(), moving=tuple(frames[k] for k in kept)), target)
    except BoxcalError as error:
        return str(error)
    covariance = found.detail.covariance
    sigma = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    off = found.T_body_cam[:3, 3] - who.T_body_cam[:3, 3]
    error = np.array([off[0], off[1], found.wheels.rR - who.rR, found.wheels.b - who.b])
    return Alone(z=error / [sigma[name] for name in NAMES], sigma=sigma["tx"], level=found.verdict.level)


def told_without_stops(outcomes: Iterable[Alone | str], title: str) -> None:
    """Print line 3 for robots of one slip and shutter."""
    done = list(outcomes)
    found = [o for o in done if not isinstance(o, str)]
    text = (
        f"{title:28}{len(found):4} of {len(done)} calibrated, {sum(o.level is Level.GOOD for o in found)} called good"
    )
    if found:
        z = np.array([o.z for o in found])
        text += f"; error over sigma, rms {' '.join(f'{v:.2f}' for v in _rms(z))}, largest {np.abs(z).max():.1f}"
        text += f"; 95 % hold {100 * np.mean(np.abs(z) < INSIDE):.1f} %"
        text += f"; sigma of tx {1e3 * np.median([o.sigma for o in found]):.2f} mm"
    print(text, flush=True)
    for why in sorted({str(o).partition("; let ")[0][:150] for o in done if isinstance(o, str)}):
        print(f"    refused: {why}")


Drives = Callable[..., list[Any]]


def parts(count: int) -> dict[str, Callable[[Drives], None]]:
    """Return the parts of the study by their names."""
    late = [ShutterOptions(late_s=float(s)) for s in np.linspace(-0.08, 0.08, count)]

    def right(slip: float, drives: Drives) -> None:
        found = drives(robot, slip, late, Moving.AUTO)
        right_assumptions(found, f"slip {1e3 * slip:g} mm/sqrt(m)")
        print(f"  left out: {sum(not o.used for o in found)} of {len(found)}", flush=True)

    def wrong(slip: float, shutter: ShutterOptions, title: str, drives: Drives) -> None:
        wrong_assumptions(drives(robot, slip, [shutter] * count, Moving.AUTO), title)

    def alone(slip: float, shutters: list[ShutterOptions], title: str, drives: Drives) -> None:
        told_without_stops(drives(without_stops, slip, shutters), title)

    out: dict[str, Callable[[Drives], None]] = {"0.3 mm": partial(right, 3e-4), "2 mm": partial(right, 2e-3)}
    out |= {title: partial(wrong, 3e-4, shutter, title) for title, shutter in WRONG.items()}
    out[f"{ROLLING}, 2 mm"] = partial(wrong, 2e-3, WRONG[ROLLING], f"{ROLLING}, 2 mm")
    for slip in (3e-4, 2e-3):
        name = f"no stops, {1e3 * slip:g} mm"
        out[name] = partial(alone, slip, late, name)
    for title, shutter in WRONG.items():
        name = f"no stops, {title}"
        out[name] = partial(alone, 3e-4, [shutter] * count, name)
    return out


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--robots", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", nargs="+", metavar="PART", help="of: " + "; ".join(parts(1)))
    args = parser.parse_args()
    count, begun = 4 if args.quick else args.robots, time.perf_counter()
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:

        def drives(study: Callable[..., Any], slip: float, shutters: list[ShutterOptions], *more: Any) -> list[Any]:
            jobs = [pool.submit(study, n, args.seed, slip, s, *more) for n, s in enumerate(shutters, 1)]
            return [found for job in jobs if (found := job.result()) is not None]

        print("wrong assumptions: used, said; largest and rms error over sigma with frames and of stops alone; errors")
        print("beyond 3 sigma with frames only; by how many sigmas of the stops an error is larger at most")
        for name, part in parts(count).items():
            if args.only is None or name in args.only:
                part(drives)
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
