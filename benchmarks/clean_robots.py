"""Are the sigmas right on rendered images? Clean robots are calibrated with the defaults and compared.

Every robot has its own camera, wheels, camera extrinsics, drive and slip; nothing else is wrong. The PSF acts
before the pixel's integral, as in a camera. Printed for camera, wheels and extrinsics: root mean
square of the errors over their predicted sigmas (1 in the ideal) and how often a 95 % interval holds the truth.

    python benchmarks/clean_robots.py             40 robots, some 15 minutes on one core
    python benchmarks/clean_robots.py --quick     4 robots
    python benchmarks/clean_robots.py --keep FOLDER    correspondences are kept there and read from there the next time
"""

import argparse
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.compare.ground_truth import load_truth
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.fleet import Job, simulate_robot
from boxcal.calib.simulate.recorder import RecordOptions
from boxcal.detect.correspondences import load_correspondences
from boxcal.detect.extract import extract
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind
from boxcal.target.errors import BoxcalError

STOPS = 14
GROUPS = {"camera": ORDER[:5], "wheels": ORDER[5:8], "extrinsics": ORDER[8:]}
GOAL_RMS, GOAL_COVER = (0.85, 1.15), (0.93, 0.97)
INSIDE = 1.959964
"""Standard deviations within which 95 % of a normal variable lie."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One robot: errors over sigmas (14,), the verdict, and what went wrong if anything did."""

    name: str
    z: Array | None
    verdict: str
    problem: str


def seen_by(number: int, seed: int, kind: CameraKind, keep: Path) -> tuple[Path, Path]:
    """Return one robot's correspondences and truth in a folder, rendered unless they are there.

    Raises
    ------
    BoxcalError
        If the simulated robot finds no drive, or its log cannot be used.
    """
    seen = keep / f"{kind}-{seed}-{number}.npz"
    truth = seen.with_suffix(".truth.json")
    if seen.exists() and truth.exists():
        return seen, truth
    rng = np.random.default_rng([seed, number])
    with tempfile.TemporaryDirectory() as folder:
        job = Job(
            folder=Path(folder),
            number=number,
            seed=seed,
            target=make_target(),
            drive=DriveOptions(stops=STOPS, slip=float(rng.uniform(2e-4, 8e-4))),
            record=RecordOptions(moving_frames=0),
            kind=kind,
        )
        done = simulate_robot(job)
        if done.error:
            raise BoxcalError(done.error)
        keep.mkdir(parents=True, exist_ok=True)
        extract(done.log, make_target()).save(seen)
        truth.write_bytes(done.log.with_suffix(".truth.json").read_bytes())
    return seen, truth


def robot(number: int, seed: int, kind: CameraKind, keep: Path | None) -> Outcome:
    """Render one robot's drive and calibrate it."""
    name = f"r{number:02d}"
    with tempfile.TemporaryDirectory() as folder:
        try:
            seen, true = seen_by(number, seed, kind, keep or Path(folder))
            result = calibrate(load_correspondences(seen))
        except BoxcalError as error:
            return Outcome(name=name, z=None, verdict="refused", problem=str(error))
        truth = load_truth(true)
    if result.detail is None:
        return Outcome(name=name, z=None, verdict="refused", problem="no covariance")
    camera = [getattr(result.camera, n) - getattr(truth.camera, n) for n in GROUPS["camera"]]
    if CameraKind.FISHEYE in {result.camera.kind, truth.camera.kind} and result.camera.kind is not truth.camera.kind:
        camera[-1] = np.nan  # another model's first coefficient is another quantity
    wheels = [getattr(result.wheels, n) - getattr(truth.wheels, n) for n in GROUPS["wheels"]]
    turned = log_so3(truth.T_body_cam[:3, :3].T @ result.T_body_cam[:3, :3])
    error = np.array([*camera, *wheels, *turned, *(result.T_body_cam[:3, 3] - truth.T_body_cam[:3, 3])])
    z = error / np.sqrt(np.diag(result.detail.covariance.matrix))
    return Outcome(name=name, z=z, verdict=str(result.verdict.level) if result.verdict else "", problem="")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--robots", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--camera", type=CameraKind, default=CameraKind.RADIAL, choices=list(CameraKind))
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep correspondences there, and read them again")
    args = parser.parse_args()
    count = 4 if args.quick else args.robots
    begun = time.perf_counter()
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(robot, k + 1, args.seed, args.camera, args.keep) for k in range(count)]
        outcomes = [job.result() for job in jobs]
    for outcome in outcomes:
        worst = "" if outcome.z is None else f"worst {np.nanmax(np.abs(outcome.z)):.1f} sigma ({_worst(outcome.z)})"
        print(f"{outcome.name}: {outcome.verdict or 'no verdict'} {worst}{outcome.problem}")
    z = np.array([outcome.z for outcome in outcomes if outcome.z is not None])
    print(f"\n{len(z)} of {count} robots calibrated, {sum(o.verdict.endswith('good') for o in outcomes)} good")
    print(f"{'':12}{'rms z':>8}{'95 % holds':>12}    goals {GOAL_RMS[0]}-{GOAL_RMS[1]}, 93-97 %")
    for name, members in GROUPS.items():
        _line(name, z[:, [ORDER.index(m) for m in members]])
    _line("all", z)
    print("\nrms z: " + ", ".join(f"{n} {np.sqrt(np.nanmean(z[:, k] ** 2)):.2f}" for k, n in enumerate(ORDER)))
    print(f"{time.perf_counter() - begun:.0f} s")


def _worst(z: Array) -> str:
    return ORDER[int(np.nanargmax(np.abs(z)))]


def _line(name: str, z: Array) -> None:
    rms, cover = float(np.sqrt(np.nanmean(z**2))), float(np.mean(np.abs(z[np.isfinite(z)]) < INSIDE))
    holds = GOAL_RMS[0] <= rms <= GOAL_RMS[1] and GOAL_COVER[0] <= cover <= GOAL_COVER[1]
    print(f"{name:12}{rms:8.2f}{100 * cover:11.1f}%{'' if holds else '    missed'}")


if __name__ == "__main__":
    main()
