"""Memory of a robot whose camera sends 4K frames: how much a calibration takes, and how many frames it keeps decoded.

    python benchmarks/moving_memory.py                 12 and 180 frames between two stops
    python benchmarks/moving_memory.py --a-leg 4 40

A simulated robot drives around the box with 6 stops. Its images are rendered small and enlarged to 3840 x 2160: what
is measured is what is kept, not how well. Each log is calibrated in a process of its own. Printed: frames in the log,
its size, frames decoded, most of them kept at once, and the peak of resident memory over that before the log is opened.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.settings import Settings
from boxcal.calib.simulate import recorder
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.log.frames import FrameSource
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel

SMALL, LARGE = (640, 360), (3840, 2160)
CAMERA = CameraModel(fu=520.0, fv=521.0, cu=318.0, cv=181.0, kr=-0.08)
TURN = np.radians(12)


def write(path: Path, a_leg: int) -> None:
    """Write a log with a number of frames between two stops, and as many a second at stops."""
    poses = np.array(
        [
            (d * np.cos(side), d * np.sin(side), side + np.pi + turn)
            for side in np.radians([20, 110])
            for d, turn in ((1.1, TURN), (1.1, -TURN), (0.85, TURN))
        ]
    )
    poses[:, 2] = np.unwrap(poses[:, 2])
    rng, target = np.random.default_rng(3), make_target()
    robot = replace(turtlebot(), camera=CAMERA, image_size=SMALL)
    drive = simulate_drive(robot, target, DriveOptions(slip=2e-4, encoder_step=1e-3, max_speed=0.15), rng, stops=poses)
    taken = recorder.take_rows
    recorder.take_rows = lambda *a, **more: cv2.resize(taken(*a, **more), LARGE, interpolation=cv2.INTER_CUBIC)
    options = recorder.RecordOptions(
        frames=max(a_leg // 4, 3), moving_frames=a_leg, exposure_s=2e-3, compression="none"
    )
    recorder.write_log(path, robot, target, drive, options, rng=rng)


def measure(path: Path) -> None:
    """Calibrate a log and print what that took."""
    cv2.setNumThreads(1)
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read, decoded, most = FrameSource.decoded, 0, 0
    kept: dict[int, weakref.ref] = {}

    def counted(source: FrameSource, numbers: Iterable[int]) -> Iterator[tuple[int, object]]:
        nonlocal decoded, most
        for number, image in read(source, numbers):
            decoded += 1
            kept[decoded] = weakref.ref(image)
            for at in [at for at, frame in kept.items() if frame() is None]:
                del kept[at]
            most = max(most, len(kept))
            yield number, image

    FrameSource.decoded = counted
    found = calibrate(path, make_target(), settings=Settings(report=False))
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    said = next((note for note in found.notes if "on the move" in note), "no frames on the move")
    print(f"{decoded:9}{most:9}{peak_kb / 1024:12.0f} MB   {said[:60]}", flush=True)


def main() -> None:
    """Print a line a log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--a-leg", nargs="+", type=int, default=[12, 180], help="frames between two stops")
    parser.add_argument("--inner", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.inner:
        measure(args.inner)
        return
    print(f"{'frames':>7}{'log':>9}{'decoded':>12}{'kept':>9}{'peak':>12}")
    with tempfile.TemporaryDirectory() as folder:
        for a_leg in args.a_leg:
            path = Path(folder) / "r.mcap"
            write(path, a_leg)
            count = 5 * a_leg + 6 * max(a_leg // 4, 3)
            print(f"{count:7}{path.stat().st_size / 1e6:6.0f} MB", end="   ", flush=True)
            subprocess.run([sys.executable, __file__, "--inner", str(path)], check=True)


if __name__ == "__main__":
    main()
