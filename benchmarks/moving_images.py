"""Frames on the move in rendered images: the whole line from the log, a check of what `moving.py` does without any.

Simulated robots with 20 stops and 8 images between any two, noise and JPEG; clock offsets of -80 to 80 ms. Each log
is calibrated as by default. Printed, for each robot and as root mean squares: errors of tx, ty, rR and b over their
sigmas with frames and from stops alone, those sigmas over each other, and the error of the clock's offset over its own.

    python benchmarks/moving_images.py                10 robots, some 5 minutes on one core
    python benchmarks/moving_images.py --robots 20
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.calib.simulate.robot import VGA, Robot, random_robot
from boxcal.detect.extract import extract
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

NAMES = ("tx", "ty", "rR", "b")
STOPS, A_LEG = 20, 8


def errors(found: Calibration, who: Robot) -> tuple[Array, Array]:
    """Return the errors of ``NAMES`` and their standard deviations, (4,) each, m."""
    covariance = found.detail.covariance
    sigma = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    off = found.T_body_cam[:3, 3] - who.T_body_cam[:3, 3]
    error = np.array([off[0], off[1], found.wheels.rR - who.rR, found.wheels.b - who.b])
    return error, np.array([sigma[name] for name in NAMES])


def robot(number: int, seed: int, slip: float, late_s: float, folder: Path) -> tuple[Array, Array, Array, float] | None:
    """Return errors over sigmas with frames and without, the sigmas' ratios, (4,) each, and the offset's error so.

    None if the robot has no place to drive; the offset's is NaN where no frames were used.
    """
    of_robot, of_drive, of_log = np.random.default_rng([seed, number, 2]).spawn(3)
    target, who = make_target(), random_robot(f"r{number:02d}", of_robot, VGA)
    try:
        drive = simulate_drive(who, target, DriveOptions(stops=STOPS, slip=slip), of_drive)
    except BoxcalError:
        return None
    log = folder / "r.mcap"
    write_log(log, who, target, drive, RecordOptions(moving_frames=A_LEG, late_s=late_s), rng=of_log)
    seen = extract(log, target)
    plain = Settings(report=False)
    with_frames, without = (
        calibrate(seen, target, settings=replace(plain, moving=moving)) for moving in (Moving.AUTO, Moving.OFF)
    )
    (error, sigma), (alone, alone_sigma) = errors(with_frames, who), errors(without, who)
    detail, late_z = with_frames.detail, np.nan
    if "camera_late" not in detail.extra:
        print(*[note for note in with_frames.notes if "on the move" in note])
    else:
        late_z = (detail.extra["camera_late"] - late_s) / detail.extra_sigma["camera_late"]
    return error / sigma, alone / alone_sigma, sigma / alone_sigma, late_z


def main() -> None:
    """Print a line a robot, and root mean squares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--slip", type=float, default=0.3, help="mm/sqrt(m)")
    args = parser.parse_args()
    begun, done = time.perf_counter(), []
    print(f"{'error over sigma':20}{'of stops alone':>28}{'sigma over that of stops':>32}   offset")
    with tempfile.TemporaryDirectory() as folder:
        for number, late_s in enumerate(np.linspace(-0.08, 0.08, args.robots).tolist(), 1):
            found = robot(number, args.seed, 1e-3 * args.slip, late_s, Path(folder))
            if found is not None:
                done.append(np.concatenate([*found[:3], [found[3]]]))
                print("".join(f"{v:7.2f}" for v in done[-1]), flush=True)
    every = np.array(done)
    rms = np.sqrt(np.nanmean(every**2, axis=0))
    print("root mean squares and, of sigmas, medians:")
    print("".join(f"{v:7.2f}" for v in [*rms[:8], *np.median(every[:, 8:12], axis=0), rms[12]]))
    used = int(np.sum(np.isfinite(every[:, 12])))
    inside = 100 * np.mean(np.abs(every[:, :4]) < 1.959964)
    print(f"{len(every)} robots, frames used of {used}; 95 % intervals hold {inside:.1f} %; largest error over sigma "
          f"{np.abs(every[:, :4]).max():.1f}, of the offset {np.nanmax(np.abs(every[:, 12])):.1f}")  # fmt: skip
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
