"""A fleet on two cores: what a robot costs from 10 to 1,000, how busy the cores are, what the coordinator keeps.

    python benchmarks/fleet.py            (1,000 robots by correspondences, 200 by images: about an hour of two cores)
    python benchmarks/fleet.py --quick

The command's own engine calibrates and writes every robot, without reports. The fleets are a few different simulated
drives under many names: each is read, solved and written as if it were another robot's. Every count runs in a process
of its own, whose memory is the coordinator's. Processor time is that of the workers in their calls (what other work on
the machine hardly changes), after a first robot each, which has compiled code read; a worker is busy while it has a
call. The table at the end is computed from the numbers above it.
"""

import argparse
import gc
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from boxcal.calib.fleet.attempt import Attempt, attempt
from boxcal.calib.fleet.engine.calls import Call
from boxcal.calib.fleet.engine.processes import LocalProcesses
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.calib.results.without_drive import without_drive
from boxcal.calib.settings import Job, Outcome, Settings
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.fleet import Job as Simulation
from boxcal.calib.simulate.fleet import simulate_robot
from boxcal.calib.simulate.imperfect_drive import hand_made, imperfect_drive
from boxcal.calib.simulate.recorder import RecordOptions
from boxcal.calib.simulate.robot import random_robot
from boxcal.target.box import make_target

TARGET = make_target()
SETTINGS = Settings(report=False)
STOPS = 12
DRIVES, LOGS = 25, 4
"""Different drives and logs that a fleet is made of."""
LARGE, WORKERS = 10_000, 100
SAMPLED = 50
"""Robots whose messages are weighed."""


@dataclass(frozen=True, kw_only=True)
class Timed:
    """What became of one robot, and what it cost its worker: processor time and time by the clock, s."""

    found: Attempt
    processor: float
    clock: float


def timed(job: Job) -> Timed:
    processor, clock = time.process_time(), time.perf_counter()
    found = attempt(job)
    return Timed(found=found, processor=time.process_time() - processor, clock=time.perf_counter() - clock)


def resident_bytes() -> int:
    """Return the memory that this process holds (of Linux)."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def jobs(inputs: list[Path], count: int, folder: Path) -> Iterator[Job]:
    """Yield the jobs of a number of robots: each finds one of the inputs under a name of its own."""
    for k in range(count):
        source = inputs[k % len(inputs)]
        log = folder / f"r{k:05d}{source.suffix}"
        log.symlink_to(source)
        yield Job(robot=log.stem, logs=(log,), target=TARGET, settings=SETTINGS, out=folder / "out")


def coordinate(inputs: list[Path], count: int, workers: int) -> dict[str, float]:
    """Calibrate robots in processes, keep their outcomes as the command does; return the measurements."""
    with tempfile.TemporaryDirectory(prefix="boxcal-fleet-") as name, LocalProcesses(workers) as engine:
        folder = Path(name)
        started = _started(engine, inputs, folder / "first", workers)
        before = resident_bytes()
        planned = {job.robot: job for job in jobs(inputs, count, folder)}
        kept: list[Outcome] = []
        processor = clock = 0.0
        moved = sent = 0
        own, begun = time.process_time(), time.perf_counter()
        for done in engine.run(Call(key=job.robot, function=timed, arguments=(job,)) for job in planned.values()):
            if done.result is None or done.result.found.calibration is None:
                sys.exit(f"{done.call.key}: {done.lost or (done.result and done.result.found.error)}")
            if len(kept) < SAMPLED:  # these pickles are made for their size only
                aside = time.process_time()
                moved += len(pickle.dumps(done.result.found))
                sent += len(pickle.dumps(done.call))
                own += time.process_time() - aside
            slim = without_drive(done.result.found.calibration)  # what they have in common takes memory once
            kept.append(Outcome(job=planned[done.call.key], calibration=slim))
            processor, clock = processor + done.result.processor, clock + done.result.clock
        seconds, own = time.perf_counter() - begun, time.process_time() - own
        memory = resident_bytes() - before
        written = sum(p.stat().st_size for p in (folder / "out").rglob("*") if p.is_file())
        return {
            "robots": count,
            "started": started,
            "processor": processor / count,
            "busy": clock / (workers * seconds),
            "coordinator": own / count,
            "memory": memory,
            "returned": moved / min(count, SAMPLED),
            "sent": sent / min(count, SAMPLED),
            "written": written / count,
            "read": float(np.mean([p.stat().st_size for p in inputs])),
        }


def _started(engine: LocalProcesses, inputs: list[Path], folder: Path, workers: int) -> float:
    """Give every worker a first robot; return the processor time that one of these takes, s."""
    folder.mkdir()
    calls = [Call(key=job.robot, function=timed, arguments=(job,)) for job in jobs(inputs[:1], workers, folder)]
    return float(np.mean([done.result.processor for done in engine.run(calls) if done.result is not None]))


def in_a_process(inputs: list[Path], count: int, workers: int) -> dict[str, float]:
    words = [sys.executable, __file__, "--coordinate", str(count), "--jobs", str(workers), *map(str, inputs)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def correspondences(folder: Path, count: int) -> list[Path]:
    paths = []
    for k in range(count):
        rng = np.random.default_rng([11, k])
        robot = random_robot(f"d{k}", rng)
        paths.append(folder / f"d{k}.npz")
        imperfect_drive(robot, TARGET, DriveOptions(stops=STOPS), hand_made(rng), rng).seen.save(paths[-1])
    return paths


def recordings(folder: Path, count: int) -> list[Path]:
    paths = []
    for k in range(count):
        job = Simulation(
            folder=folder, number=k + 1, seed=7, target=TARGET, drive=DriveOptions(stops=STOPS), record=RecordOptions()
        )
        done = simulate_robot(job)
        if done.error:
            sys.exit(done.error)
        paths.append(done.log)
    return paths


def table(title: str, rows: list[dict[str, float]]) -> dict[str, float]:
    """Print measurements over the number of robots; return those of the largest, with the memory of a further robot."""
    print(f"\n{title}; a worker's first robot: {rows[0]['started']:.1f} s")
    heads = ("robots", "ms a robot", "busy", "coordinator ms", "memory MB", "kB back", "kB written")
    print("".join(f"{head:>16}" for head in heads))
    for r in rows:
        cells = [
            f"{r['robots']:.0f}",
            f"{1e3 * r['processor']:.0f}",
            f"{r['busy']:.1%}",
            f"{1e3 * r['coordinator']:.2f}",
        ]
        cells += [f"{r['memory'] / 1e6:.2f}", f"{r['returned'] / 1e3:.1f}", f"{r['written'] / 1e3:.1f}"]
        print("".join(f"{cell:>16}" for cell in cells))
    first, last = rows[0], rows[-1]
    further = (last["memory"] - first["memory"]) / max(last["robots"] - first["robots"], 1)
    print(
        f"from {first['robots']:.0f} to {last['robots']:.0f} robots: each costs "
        f"{last['processor'] / first['processor']:.2f} times as much; "
        f"the coordinator keeps {further / 1e3:.1f} kB a further robot (goal 20)"
    )
    return {**last, "further": further}


def extrapolated(figures: dict[str, dict[str, float]]) -> None:
    """Print what a large fleet would take on a cluster."""
    print(f"\n{LARGE:,} robots on {WORKERS} workers, computed from the above")
    heads = ("minutes", "GB read", "GB sent", "GB back", "GB written", "memory MB", "coordinator")
    print(f"{'':16}" + "".join(f"{head:>12}" for head in heads))
    for name, f in figures.items():
        own = LARGE * f["coordinator"]
        seconds = max(f["started"] + LARGE * f["processor"] / WORKERS, own)
        gb = [LARGE * f[what] / 1e9 for what in ("read", "sent", "returned", "written")]
        cells = [
            f"{seconds / 60:.1f}",
            *(f"{x:.2f}" for x in gb),
            f"{LARGE * f['further'] / 1e6:.0f}",
            f"{own / seconds:.0%}",
        ]
        print(f"{name:16}" + "".join(f"{cell:>12}" for cell in cells))
    print("read: whole files; of an indexed MCAP behind a URL only the wheels' and the stops' chunks are")
    print("coordinator: how busy its one process is; at 100 % it, not the workers, sets the time")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="up to 40 robots by correspondences, 8 by images")
    parser.add_argument("--robots", type=int, nargs="+", default=[10, 100, 1000], help="by correspondences")
    parser.add_argument("--images", type=int, nargs="+", default=[10, 200], help="by images; 0 leaves them out")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--coordinate", type=int, help=argparse.SUPPRESS)
    parser.add_argument("inputs", nargs="*", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.coordinate:
        print(json.dumps(coordinate(args.inputs, args.coordinate, args.jobs)))
        return
    counts, images = ([10, 40], [4, 8]) if args.quick else (args.robots, args.images)
    prepare_all(print)
    figures = {}
    with tempfile.TemporaryDirectory(prefix="boxcal-inputs-") as name:
        inputs = correspondences(Path(name), min(DRIVES, max(counts)))
        rows = [in_a_process(inputs, count, args.jobs) for count in counts]
        figures["correspondences"] = table("robots by correspondences (.npz)", rows)
        if any(images):
            inputs = recordings(Path(name), min(LOGS, max(images)))
            rows = [in_a_process(inputs, count, args.jobs) for count in images]
            figures["images"] = table("robots by images (MCAP)", rows)
    extrapolated(figures)


if __name__ == "__main__":
    main()
