"""Are the sigmas right where the box was printed in another size? Robots around such boxes, with rendered images.

Sheets of a fit-to-page print are smaller by some per cent, those of a poor printer in one direction, and one that was
printed again on another printer differs from its neighbours; all are glued by their middles. Each log is rendered,
read and calibrated with the box as designed. Printed for each kind of box: verdicts, the root mean square of errors
over their sigmas (1 in the ideal) of the camera, the wheels and the extrinsics, and the largest of them.

    python benchmarks/printed.py --quick
    python benchmarks/printed.py --keep FOLDER      20 robots a box; logs stay there and are not rendered again
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rooms import errors

from boxcal.calib.geometry.parameters import CAMERA, MOUNTING, ORDER, WHEELS
from boxcal.calib.simulate.asked_faults import AskedFaults
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.fleet import Job, simulate_robot
from boxcal.calib.simulate.imperfect_drive import hand_made
from boxcal.calib.simulate.imperfections import BoxFaults, Imperfections
from boxcal.calib.simulate.recorder import RecordOptions
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

BOXES = {
    "as designed": BoxFaults(),
    "made by hand": None,
    "90 %": BoxFaults(scale=(0.9, 0.9)),
    "95 %": BoxFaults(scale=(0.95, 0.95)),
    "97 %": BoxFaults(scale=(0.97, 0.97)),
    "99 %": BoxFaults(scale=(0.99, 0.99)),
    "102 %": BoxFaults(scale=(1.02, 1.02)),
    "105 %": BoxFaults(scale=(1.05, 1.05)),
    "98 % across, 101 % up": BoxFaults(scale=(0.98, 1.01)),
    "face 1 at 97 %": BoxFaults(face_scale=(1.0, 0.97, 1.0, 1.0)),
}
STOPS, FRAMES, MOVING = 12, 2, 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Printed(AskedFaults):
    """A box that was printed in another size, and nothing else that is not exact."""

    box: BoxFaults | None

    def draw(self, robot: Robot, options: DriveOptions, rng: np.random.Generator) -> Imperfections:
        """Return the box as the only imperfection."""
        del robot
        exact = Imperfections(box=hand_made(rng).box if self.box is None else self.box)
        return replace(exact, wheels=replace(exact.wheels, slip=options.slip))


def robot(name: str, keep: Path, number: int) -> tuple[str, Array | None]:
    """Return the verdict and the errors over their sigmas (14,) of one robot; None if it is refused."""
    from boxcal import calibrate  # noqa: PLC0415 - workers take their settings first

    folder = keep / name.replace(" ", "_").replace("%", "")
    job = Job(
        folder=folder,
        number=number,
        seed=97,
        target=make_target(),
        drive=DriveOptions(stops=STOPS),
        record=RecordOptions(frames=FRAMES, moving_frames=MOVING),
        faults=Printed(box=BOXES[name]),
    )
    truth = folder / f"{job.name}.truth.json"
    if not truth.exists():
        folder.mkdir(parents=True, exist_ok=True)
        done = simulate_robot(job)
        if done.error:
            return "no drive", None
    try:
        found = calibrate(folder / f"{job.name}.mcap")
    except BoxcalError as error:
        return f"refused ({error})", None
    error, _ = errors(found, json.loads(truth.read_text(encoding="utf-8")))
    if found.detail is None:
        return "no covariance", None
    level = str(found.verdict.level) if found.verdict else "none"
    return level, error / np.sqrt(np.diag(found.detail.covariance.matrix))


def report(name: str, outcomes: Sequence[tuple[str, Array | None]]) -> str:
    """Return the line of one kind of box."""
    z = np.array([z for _, z in outcomes if z is not None]).reshape(-1, len(ORDER))
    good = np.array([z for level, z in outcomes if z is not None and level == "good"]).reshape(-1, len(ORDER))
    worst = np.abs(z)
    number, which = np.unravel_index(np.nanargmax(worst), z.shape)
    parts = " ".join(f"{np.sqrt(np.nanmean(z[:, at] ** 2)):7.2f}" for at in (CAMERA, WHEELS, MOUNTING))
    levels = ", ".join(f"{level} {n}" for level, n in sorted(Counter(level for level, _ in outcomes).items()))
    largest_good = f"{np.nanmax(np.abs(good)):.1f}" if len(good) else "-"
    return (
        f"{name:22} {parts}   {worst[number, which]:5.1f} ({ORDER[which]}), of the good {largest_good:>4}; "
        f"beyond 3 sigma {int(np.nansum(worst > 3))} of {int(np.isfinite(z).sum())}; {levels}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line a box."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="4 robots a box")
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where logs are kept")
    parser.add_argument("boxes", nargs="*", metavar="BOX", help=f"of {', '.join(BOXES)} (all)")
    args = parser.parse_args(argv)
    robots, begun = 4 if args.quick else args.robots, time.perf_counter()
    print(f"{'box':22} {'camera':>7} {'wheels':>7} {'extr.':>7}   largest error over sigma")
    with tempfile.TemporaryDirectory() as scratch:
        keep = args.keep or Path(scratch)
        with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
            for name in args.boxes or BOXES:
                one = partial(robot, name, keep)
                print(report(name, list(pool.map(one, range(1, robots + 1)))), flush=True)
    print(f"{robots} robots a box, {time.perf_counter() - begun:.0f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
