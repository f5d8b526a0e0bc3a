"""Two cameras from rendered images, by the whole line from log to result: the table of ``cameras.py --pictures``."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from camera_robots import of_one, rms, whitened

from boxcal import calibrate_cameras
from boxcal.calib.geometry.camera_pair import between
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.fleet import Job, simulate_robot
from boxcal.calib.simulate.more_cameras import OwnSettings
from boxcal.calib.simulate.recorder import RecordOptions
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

STOPS, MOVING = 16, 8
LATE_S, SIZES, FRAMES = (0.03, -0.02), ((640, 480), (1280, 720)), (2, 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pictured:
    """One robot: errors (6,) of the pair's transform and (3,) of the wheels, over sigmas and whitened.

    ``late`` are the errors of the clocks' offsets, s, NaN where too few frames on the move show the box to determine
    one; ``verdicts`` those of the cameras.
    """

    pair: Array
    pair_whitened: Array
    wheels: Array
    late: Array
    verdicts: tuple[str, ...]
    seconds: float


def pictured(rig: str, number: int, seed: int) -> Pictured | str:
    """Return what one robot's log gives, or why it gives no pair: no place to drive, or what the refusal says."""
    with TemporaryDirectory() as folder:
        job = Job(
            folder=Path(folder),
            number=number,
            seed=seed,
            target=make_target(),
            drive=DriveOptions(stops=STOPS, slip=3e-4),
            record=RecordOptions(moving_frames=MOVING),
            cameras=2,
            rig=rig,
            own=OwnSettings(late_s=LATE_S, image_sizes=SIZES, frames=FRAMES),
        )
        simulated = simulate_robot(job)
        if simulated.error:
            return simulated.error
        truth = json.loads((Path(folder) / f"{job.name}.truth.json").read_text(encoding="utf-8"))
        begun = time.process_time()
        try:
            found = calibrate_cameras(Path(folder) / f"{job.name}.mcap")
        except BoxcalError as error:
            return str(error)
        return _compared(found, truth, rig, time.process_time() - begun)


def _compared(found: dict[str, Calibration], truth: dict, rig: str, seconds: float) -> Pictured | str:
    first = found.get("front")
    if first is None or first.rig is None or first.detail is None or len(found) < 2:
        return f"only of {', '.join(found)} a result"
    pair = first.rig.pair("front", rig)
    true = between(*(np.array(t["T_vehicle_camera"]) for t in (truth, truth["cameras"][0])))
    error = np.concatenate([log_so3(true[:3, :3].T @ pair.T_a_b[:3, :3]), pair.T_a_b[:3, 3] - true[:3, 3]])
    wheels = np.array([first.wheels.rR - truth["rR"], first.wheels.rL - truth["rL"], first.wheels.b - truth["b"]])
    sigma = np.array([first.detail.covariance.sigma[name] for name in ("rR", "rL", "b")])
    return Pictured(
        pair=error / np.sqrt(np.diag(pair.covariance)),
        pair_whitened=whitened(error, pair.covariance),
        wheels=wheels / sigma,
        late=np.array([c.clock_offset or np.nan for c in first.rig.cameras]) - LATE_S,
        verdicts=tuple(str(c.verdict.level) if c.verdict is not None else "" for c in found.values()),
        seconds=seconds,
    )


def report_pictured(rig: str, outcomes: list[Pictured | str]) -> None:
    """Print the lines of one kind of robots."""
    done = [o for o in outcomes if isinstance(o, Pictured)]
    for number, why in enumerate(outcomes, 1):
        if isinstance(why, str):
            print(f"{rig}, robot {number} gave no pair: {why}")
    if not done:
        return
    pair, wheels = np.array([o.pair for o in done]), np.array([o.wheels for o in done])
    seconds = float(np.median([o.seconds for o in done]))
    print(f"{rig}, from pictures: {len(done)} of {len(outcomes)} robots, {seconds:.1f} s each")
    print(
        f"  pair's transform: largest error {np.abs(pair).max():.2f} sigma, rms {rms(pair):.2f} sigma; in units of its "
        f"covariance {of_one([o.pair_whitened for o in done])}"
    )
    late = 1e3 * np.abs([o.late for o in done])
    late = late[np.isfinite(late)]
    print(
        f"  wheels: largest error {np.abs(wheels).max():.2f} sigma, rms {rms(wheels):.2f}; {len(late)} clocks "
        f"told, to {np.median(late):.2f} ms (median), {late.max():.2f} ms at most"
    )
    said = [" and ".join(o.verdicts) for o in done]
    print(f"  verdicts: {', '.join(f'{v} {said.count(v)}' for v in sorted(set(said)))}", flush=True)
