"""Processor time of what the guide does after each stop, as the drive grows.

    python benchmarks/guide.py --stops 30

prints the median over the last stops: growing the estimate by a stop, what is reported of it, the bars, the next stops,
and for comparison a full solution. With ``--recording run.mcap`` also what its full calibration costs in a process that
is loaded: the verdict alone, and all results with the report.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np

from boxcal.calib.guide.estimate.advice import bars, next_places
from boxcal.calib.guide.estimate.solver import solved
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.grown_fit import grown_fit
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.planning.goal import Goal
from boxcal.calib.settings import Job, Settings
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.extract import ExtractSettings, extract
from boxcal.one_thread import one_thread
from boxcal.target.box import make_target

T = TypeVar("T")


def timed(times: dict[str, list[float]], name: str, task: Callable[[], T]) -> T:
    begun = time.process_time()
    out = task()
    times.setdefault(name, []).append(1e3 * (time.process_time() - begun))
    return out


def run(stops: int, last: int) -> dict[str, list[float]]:
    target, rng, times = make_target(), np.random.default_rng(1), {}  # type: ignore[var-annotated]
    robot = turtlebot()
    drive = exact_correspondences(
        robot, target, simulate_drive(robot, target, DriveOptions(stops=stops), rng), 0.05, rng
    )
    drive = replace(drive, stops=tuple(replace(s, faces=target.faces(s.landmark_ids)) for s in drive.stops))
    options = EstimateOptions(lens=None, target=target)
    known = fit([replace(drive, stops=drive.stops[: stops - last])], None, options)
    for n in range(stops - last + 1, stops + 1):
        so_far = replace(drive, stops=drive.stops[:n])
        known = timed(times, "growing by a stop", lambda d=so_far, k=known: grown_fit(k, d))  # type: ignore[misc]
        found = timed(times, "what is reported of it", lambda d=so_far, k=known: reported(k, [d], options))  # type: ignore[misc]
        timed(times, "bars", lambda f=found: bars(f, Goal(), drive.image_size))  # type: ignore[misc]
        timed(times, "next stops", lambda f=found, d=so_far: next_places(f, d, target, Goal()))  # type: ignore[misc]
        timed(times, "(a full solution)", lambda d=so_far: fit([d], None, options))  # type: ignore[misc]
    return times


def full(recording: Path) -> dict[str, list[float]]:
    target, times = make_target(), {}  # type: ignore[var-annotated]
    drive = extract(recording, target, settings=ExtractSettings(moving=False))
    with TemporaryDirectory() as folder:
        for out in (None, Path(folder)):
            settings = Settings(report=out is not None)
            job = Job(robot="r01", logs=(recording,), target=target, settings=settings, out=out, command="guide")
            solved(job, drive, recorded=out is not None)
            for _ in range(5):
                name = "verdict" if out is None else "results and report"
                timed(times, name, lambda j=job, r=out is not None: solved(j, drive, recorded=r))  # type: ignore[misc]
    return times


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=30, help="of the drive (30)")
    parser.add_argument("--last", type=int, default=5, help="stops over which the median is taken (5)")
    parser.add_argument("--recording", type=Path, help="to calibrate in full")
    args = parser.parse_args(argv)
    with one_thread():
        times = run(args.stops, args.last)
        times |= full(args.recording) if args.recording else {}
    print(f"processor time at {args.stops} stops, median of {args.last}, ms")
    for name, values in times.items():
        print(f"{name:<24}{np.median(values):8.0f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
