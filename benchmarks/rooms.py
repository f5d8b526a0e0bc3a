"""Logs that nobody here rendered, calibrated with the command's defaults and compared with the truth.

    python benchmarks/rooms.py                  all logs of ../shared/data/rooms and ../shared/data/fleet
    python benchmarks/rooms.py --quick          four of them
    python benchmarks/rooms.py --keep FOLDER    correspondences are kept there and read from there the next time

Path-traced robots around the default box, each with its own room, camera, camera extrinsics, wheels and drive; one
violation each, or all that a careful user has (``real*``). Printed for each log: the verdict, the errors of wheels (%),
camera extrinsics (deg, mm) and focal length (%), and the largest error in predicted standard deviations; for the groups
the root mean square of all errors over their sigmas (1 in the ideal). Skips where the data are not beside the project.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.geometry.parameters import CAMERA, MOUNTING, ORDER, WHEELS
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.one_robot.views_by_wheels import views_by_wheels
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.correspondences import load_correspondences
from boxcal.detect.extract import ExtractSettings, extract
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind
from boxcal.target.errors import BoxcalError

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
QUICK = ("real00", "lean_005", "clean00", "clean04")
REAL, CLEAN = ("real", "lean"), ("clean",)
"""How the logs of the two groups begin that have goals of their own."""
GOALS = (
    "goals of real and lean: wheels .6 %, rotation .3 deg, tx ty 3.5 mm, tz .4 mm, fu .06 %, 3.5 sigma, rms 0.8-1.25"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One log: what came out, its errors (14,) in the order of the reported parameters, and those over their sigmas."""

    name: str
    verdict: str
    error: Array
    z: Array
    truth: Array
    seconds: float


def outcome(log: Path, keep: Path | None) -> Outcome:
    """Calibrate one log and compare it with its truth."""
    target = make_target()
    saved = None if keep is None else keep / f"{log.stem}.npz"
    if saved is not None and saved.exists():
        seen = load_correspondences(saved)
    else:
        seen = extract(log, target, settings=ExtractSettings(predictor=views_by_wheels))
        if saved is not None:
            saved.parent.mkdir(parents=True, exist_ok=True)
            seen.save(saved)
    begun = time.process_time()
    found = calibrate(seen)
    seconds = time.process_time() - begun
    error, truth = errors(found, json.loads(log.with_name(f"{log.stem}.truth.json").read_text()))
    detail = found.detail
    if detail is None:
        raise BoxcalError("no covariance", source=log.name)
    level = str(found.verdict.level) if found.verdict else "none"
    z = error / np.sqrt(np.diag(detail.covariance.matrix))
    return Outcome(name=log.stem, verdict=level, error=error, z=z, truth=truth, seconds=seconds)


def errors(found: Calibration, truth: dict[str, object]) -> tuple[Array, Array]:
    """Return the errors and the true values, (14,) each; NaN for a distortion coefficient of another model."""
    camera: dict[str, float] = truth["camera"]  # type: ignore[assignment]
    T = np.array(truth["T_vehicle_camera"], dtype=np.float64)
    fisheye = truth.get("model") == "fisheye"
    kr = np.array(truth["k"], dtype=np.float64)[0] if fisheye else camera["kr"]
    alike = (found.camera.kind is CameraKind.FISHEYE) == fisheye and found.camera.kind is not CameraKind.RATIONAL
    values = np.array([*(camera[n] for n in ("fu", "fv", "cu", "cv")), kr if alike else np.nan])
    wheels = np.array([truth["rR"], truth["rL"], truth["b"]], dtype=np.float64)
    c, w = found.camera, found.wheels
    error = np.concatenate(
        [
            np.array([c.fu, c.fv, c.cu, c.cv, c.kr]) - values,
            np.array([w.rR, w.rL, w.b]) - wheels,
            log_so3(T[:3, :3].T @ found.T_body_cam[:3, :3]),
            found.T_body_cam[:3, 3] - T[:3, 3],
        ]
    )
    return error, np.concatenate([values, wheels, np.zeros(3), T[:3, 3]])


def line(o: Outcome) -> str:
    """Return a log's row."""
    wheels = 100 * o.error[WHEELS] / o.truth[WHEELS]
    turned = float(np.degrees(np.linalg.norm(o.error[8:11])))
    place = 1e3 * o.error[11:]
    focal = 100 * o.error[0] / o.truth[0]
    worst = int(np.nanargmax(np.abs(o.z)))
    cells = [*(f"{v:+.3f}" for v in wheels), f"{turned:.3f}", *(f"{v:+.2f}" for v in place), f"{focal:+.4f}"]
    row = " ".join(f"{cell:>8}" for cell in cells)
    return f"{o.name:12} {o.verdict:7} {row}   {abs(o.z[worst]):5.1f} ({ORDER[worst]})  {o.seconds:5.2f}"


def group(name: str, outcomes: Sequence[Outcome]) -> str:
    """Return the root mean square of a group's errors over their sigmas."""
    z = np.array([o.z for o in outcomes])
    parts = (("camera", CAMERA), ("wheels", WHEELS), ("extrinsics", MOUNTING), ("all", slice(None)))
    figures = ", ".join(f"{part} {np.sqrt(np.nanmean(z[:, at] ** 2)):.2f}" for part, at in parts)
    return f"{name}: rms z {figures}; largest {np.nanmax(np.abs(z)):.1f}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"only {', '.join(QUICK)}")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep correspondences there, and read them again")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="names of logs (all)")
    args = parser.parse_args(argv)
    logs = [path for folder in ("rooms", "fleet") for path in sorted((DATA / folder).glob("*.mcap"))]
    wanted = args.logs or (QUICK if args.quick else [path.stem for path in logs])
    logs = [path for path in logs if path.stem in wanted]
    if not logs:
        print("no shared/data/rooms beside the project: nothing to compare")
        return 0
    units = ("rR %", "rL %", "b %", "turn deg", "tx mm", "ty mm", "tz mm", "fu %")
    print(f"{'log':12} {'verdict':7} {' '.join(f'{u:>8}' for u in units)}   worst sigma     s")
    done = []
    for log in logs:
        try:
            done.append(outcome(log, args.keep))
        except BoxcalError as error:
            print(f"{log.stem:12} refused: {error}", flush=True)
            continue
        print(line(done[-1]), flush=True)
    print()
    for name, starts in (("real and lean", REAL), ("clean", CLEAN), ("all", ("",))):
        members = [o for o in done if o.name.startswith(starts)]
        if members:
            print(group(name, members))
    print(GOALS)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
