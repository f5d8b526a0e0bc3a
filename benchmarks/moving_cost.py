"""Cost of frames on the move: processor time of a robot with them over that from its stops alone, at default settings.

    python benchmarks/moving_cost.py                    going00 and going01 of ../shared/data/rooms
    python benchmarks/moving_cost.py robots/*.mcap
    python benchmarks/moving_cost.py --repeats 9

From the log to the calibration, without writing, in one thread; the two take turns after a first run that is not
counted, and of the repeats the median of the ratios counts, since what else runs on a machine slows both. Printed
besides: the standard deviations of tx and ty with frames over those from stops alone.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.likelihood.moving.merge import Moving
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Settings
from boxcal.target.box import make_target

ROOMS = Path(__file__).resolve().parents[2] / "shared" / "data" / "rooms"
GOAL = 1.5
PLAIN = Settings(report=False)


def timed(log: Path, moving: Moving) -> tuple[float, Calibration]:
    """Return the processor time, s, and the calibration of a robot."""
    begun = time.process_time()
    found = calibrate(log, make_target(), settings=replace(PLAIN, moving=moving))
    return time.process_time() - begun, found


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
    print(f"{'log':12}{'stops s':>9}{'with s':>9}{'ratio':>7} (goal {GOAL})   sigma of tx, ty over that of stops")
    for log in logs:
        timed(log, Moving.AUTO)
        pairs = [(timed(log, Moving.OFF), timed(log, Moving.AUTO)) for _ in range(args.repeats)]
        ratio = np.median([on[0] / off[0] for off, on in pairs])
        least = [min(pair[k][0] for pair in pairs) for k in (0, 1)]
        share = np.divide(sigmas(pairs[0][1][1]), sigmas(pairs[0][0][1]))
        print(
            f"{log.stem:12}{least[0]:9.2f}{least[1]:9.2f}{ratio:7.2f}              {share[0]:.2f}, {share[1]:.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
