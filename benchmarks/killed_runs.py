"""Runs of ``fleet-calibrate`` killed (SIGKILL) at random moments: the next call must finish with the same results.

    python benchmarks/killed_runs.py [--robots 30] [--moments 20] [--seed 1]

Robots are simulated correspondences, solved as in the paper (a tenth of a second each). Prints a line a moment: how
many robots were finished when the command was killed, how many of them the next call kept, and whether all files of all
robots and of the fleet are those of a run that nobody disturbed, but for the times in them.
"""

import argparse
import csv
import io
import json
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.box import make_target

_OPTIONS = ("--lens", "radial", "--floor", "rigid", "--scale-prior-percent", "0", "--face-prior-mm", "0", "--no-report")
_TIMES = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00")
_OF_THE_RUN = {"run.json", "correspondences.npz"}
"""Files about the run itself, or that hold times in a compressed archive."""


def logs(folder: Path, robots: int, seed: int) -> list[Path]:
    """Save correspondences of simulated robots that drove around one box; return their files."""
    target, paths = make_target(), []
    for k in range(robots):
        rng, robot = np.random.default_rng([seed, k]), turtlebot(f"r{k:02d}")
        drive = simulate_drive(robot, target, DriveOptions(stops=8), rng)
        paths.append(folder / f"r{k:02d}.npz")
        exact_correspondences(robot, target, drive, 0.1, rng).save(paths[-1])
    return paths


def command(paths: list[Path], out: Path) -> list[str]:
    """Return the command line for some logs."""
    return [sys.executable, "-m", "boxcal.calib.cli", *map(str, paths), *_OPTIONS, "--out", str(out), "--jobs", "2"]


def contents(out: Path, name: str) -> dict[str, bytes]:
    """Return the files of a folder of results without the times in them, and without that folder's own name."""
    found = {}
    for path in sorted(p for p in out.rglob("*") if p.is_file() and p.name not in _OF_THE_RUN):
        found[path.relative_to(out).as_posix()] = _TIMES.sub(b"TIME", path.read_bytes()).replace(name.encode(), b"OUT")
    return found


def killed(words: list[str], out: Path, finished: int, delay: float) -> tuple[int, bool]:
    """Run a command and kill it after a number of robots and a moment; return how many are finished, and if it ran."""
    with subprocess.Popen(words, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and len(list(out.glob("*/calibration.json"))) < finished:
            time.sleep(0.005)
        time.sleep(delay)
        alive = process.poll() is None
        process.send_signal(signal.SIGKILL)
    time.sleep(0.3)  # its workers notice
    return len(list(out.glob("*/calibration.json"))), alive


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=30)
    parser.add_argument("--moments", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(argv)
    rng, same = np.random.default_rng(args.seed), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = logs(folder / "robots", args.robots, args.seed)
        subprocess.run(command(paths, folder / "undisturbed"), check=True, capture_output=True)
        expected = contents(folder / "undisturbed", "undisturbed")
        for moment in range(args.moments):
            out = folder / f"killed{moment}"
            words = command(paths, out)
            count, alive = killed(words, out, int(rng.integers(0, args.robots)), float(rng.uniform(0, 0.5)))
            again = subprocess.run(words, capture_output=True, text=True, check=False)
            kept = json.loads((out / "run.json").read_text())["counts"]["kept"]
            rows = list(csv.DictReader(io.StringIO((out / "fleet.csv").read_text())))
            whole = again.returncode == 0 and contents(out, out.name) == expected and len(rows) == args.robots
            same += whole and kept == count
            print(
                f"{'killed' if alive else 'had ended'} with {count:3d} of {args.robots} finished: {kept} kept, "
                f"{'the same results' if whole else 'OTHER RESULTS'}",
                flush=True,
            )
            shutil.rmtree(out)
    print(f"{same} of {args.moments} runs ended as an undisturbed one")
    return 0 if same == args.moments else 1


if __name__ == "__main__":
    sys.exit(main())
