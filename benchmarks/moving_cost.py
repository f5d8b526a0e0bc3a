"""Cost of frames on the move: processor time of a robot with them over that from its stops alone, at default settings.

    python benchmarks/moving_cost.py                    going00 and going01 of ../shared/data/rooms
    python benchmarks/moving_cost.py robots/*.mcap
    python benchmarks/moving_cost.py --repeats 9

In one thread, from the log to the calibration, and from the log to written results with report, as fleet-calibrate
has it. The two take turns after a first run that is not counted, and of the repeats the median of the ratios counts,
since what else runs on a machine slows both. Printed besides: the standard deviations of tx and ty with frames over
those from stops alone.
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from boxcal.calib.calibrate import calibrate, calibrate_robot
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Job, Settings
from boxcal.target.box import make_target

ROOMS = Path(__file__).resolve().parents[2] / "shared" / "data" / "rooms"
GOAL = 1.5
PLAIN = Settings(report=False)


def timed(log: Path, moving: Moving) -> tuple[float, Calibration]:
    """Return the processor time, s, and the calibration of a robot."""
    begun = time.process_time()
    found = calibrate(log, make_target(), settings=replace(PLAIN, moving=moving))
    return time.process_time() - begun, found


def written(log: Path, moving: Moving, out: Path) -> float:
    """Return the processor time, s, of a robot whose results and report are written."""
    settings = replace(Settings(), moving=moving)
    job = Job(robot=log.stem, logs=(log,), target=make_target(), settings=settings, out=out)
    begun = time.process_time()
    calibrate_robot(job)
    return time.process_time() - begun


def sigmas(found: Calibration) -> list[float]:
    """Return the standard deviations of tx and ty, m."""
    covariance = found.detail.covariance
    sigma = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    return [sigma["tx"], sigma["ty"]]


def main() -> None:
    """Print a line a log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    args = parser.parse_args()
    logs = args.logs or [path for name in ("going00", "going01") if (path := ROOMS / f"{name}.mcap").exists()]
    print(f"{'':12}{'calibrated':^25}{'with report and files':^25}{'sigma over that of stops':>28}")
    print(
        f"{'log':12}{'stops s':>9}{'with s':>9}{'ratio':>7}" + f"{'stops s':>9}{'with s':>9}{'ratio':>7}{'tx, ty':>24}"
    )
    for log in logs:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder)
            written(log, Moving.AUTO, out)
            pairs = [(timed(log, Moving.OFF), timed(log, Moving.AUTO)) for _ in range(args.repeats)]
            whole = [(written(log, Moving.OFF, out), written(log, Moving.AUTO, out)) for _ in range(args.repeats)]
        share = np.divide(sigmas(pairs[0][1][1]), sigmas(pairs[0][0][1]))
        cells = "".join(_cells(of) for of in ([(off[0], on[0]) for off, on in pairs], whole))
        print(f"{log.stem:12}{cells}{f'{share[0]:.2f}, {share[1]:.2f}':>24}", flush=True)
    print(f"goal of the ratio: {GOAL}")


def _cells(pairs: list[tuple[float, float]]) -> str:
    off, on = (min(pair[k] for pair in pairs) for k in (0, 1))
    return f"{off:9.2f}{on:9.2f}{np.median([b / a for a, b in pairs]):7.2f}"


if __name__ == "__main__":
    main()
