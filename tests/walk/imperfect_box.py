"""Robots around a box that is neither as designed nor exactly as measured, from make-target to check-drive.

``python tests/walk/imperfect_box.py FOLDER`` prints how far each robot's calibration is from its truth and exits with 1
if one of them is not "good", is further off than 0.3 %, or does not pass its check drive.
"""

import io
import json
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

import boxcal
from boxcal.target.measure.measured_size import Measured

LIMIT = 0.003
"""Largest relative error of radii and wheel separation."""
TRUE = Measured(sx=0.9971, sy=0.9985, width=0.25042, depth=0.24985, height=0.2003, cov=np.eye(5) * 1e-12)
"""The box as it stands there: printed too small, its faces glued outside of the design."""
READ = ("--tags-x", "237.3", "237.4", "--tags-y", "167.7", "167.8", "--width", "250.2", "--depth", "250.0")
"""What a ruler reads on it, mm: each within its tolerance of the truth, none equal to it."""


def walk(folder: Path) -> dict[str, tuple[str, float, bool]]:
    """Do the whole way in a folder; return verdict, largest relative error and outcome of the check drive by robot."""
    folder.mkdir(parents=True, exist_ok=True)
    _do(folder, "make-target", "box", "--paper", "a4")
    boxcal.save_target(boxcal.make_target(measured=TRUE), folder / "built.json")
    _do(folder, "measure-target", "box/target.json", *READ)
    simulated = ("--seed", "5", "--target", "built.json", "--hand-made", "--jobs", "1")
    _do(folder, "simulate-fleet", "robots", "--robots", "2", "--stops", "10", *simulated)
    logs = sorted(path.name for path in (folder / "robots").glob("*.mcap"))
    found_by = ("--target", "box/target.json", "--no-report", "--jobs", "1")
    _do(folder, "fleet-calibrate", *(f"robots/{log}" for log in logs), *found_by)
    _do(folder, "simulate-fleet", "check", "--robots", "2", "--stops", "4", *simulated)
    found = {}
    for log in logs:
        robot = Path(log).stem
        result = boxcal.load_calibration(folder / "calibration" / robot / "calibration.json")
        truth = json.loads((folder / "robots" / f"{robot}.truth.json").read_text())
        off = max(abs(getattr(result.wheels, name) / truth[name] - 1) for name in ("rR", "rL", "b"))
        checked = [f"check/{log}", "--calibration", f"calibration/{robot}/calibration.json"]
        passed = _do(folder, "check-drive", *checked, "--target", "box/target.json", expect=(0, 1)) == 0
        found[robot] = ("" if result.verdict is None else str(result.verdict.level), off, passed)
    return found


def _do(folder: Path, name: str, *words: str, expect: tuple[int, ...] = (0,)) -> int:
    """Call a command's main function in a folder; what it prints is shown if its status is not as expected."""
    (command,) = entry_points(group="console_scripts", name=name)
    out = io.StringIO()
    with chdir(folder), redirect_stdout(out), redirect_stderr(out):
        status: int = command.load()(list(words))
    if status not in expect:
        raise RuntimeError(f"{name} {' '.join(words)}: {out.getvalue()}")
    return status


def main() -> int:
    """Walk in the folder that was named; returns the exit status."""
    found = walk(Path(sys.argv[1]))
    for robot, (verdict, off, passed) in found.items():
        sys.stdout.write(
            f"{robot}: {verdict}, {off:.3%} from the truth, check drive {'as' if passed else 'not as'} predicted\n"
        )
    return 0 if all(v == "good" and off <= LIMIT and passed for v, off, passed in found.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
