"""What the diagnosis makes of drives on which something is not as the model has it.

Every violation of the catalogue (:mod:`boxcal.calib.simulate.violations`) is drawn at random, beside what a careful
user has anyway: a hand-made box, a robot that leans, a real lens, corner noise common to a stop. No images are made.
Printed: by how many of its sigmas each violation moves a parameter where nothing is diagnosed (the same drive with and
without it, paired), what was named for what was injected, the sizes found, errors in their own sigmas, and how many
results are called good or usable that are wrong by more than 5 sigma.

    python benchmarks/explanations.py --quick
    python benchmarks/explanations.py --runs 10 --keep runs.jsonl    # then --runs 20 adds ten to them
"""

import argparse
import re
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kept_runs import KeptRuns

from boxcal.calib.calibrate import calibrate
from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import exp_se3, log_so3
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfect_drive import ImperfectDrive, hand_made, imperfect_drive
from boxcal.calib.simulate.robot import khepera, turtlebot
from boxcal.calib.simulate.violation import STOPS, Violation
from boxcal.calib.simulate.violations import HARMLESS, VIOLATIONS
from boxcal.target.arrays import Array
from boxcal.target.box import make_target

TARGET = make_target()
WRONG = 5.0
"""An error of more than this many sigmas is a wrong result."""
MOVES = 3.0
"""A violation that moves a parameter by this many sigmas has to be named."""
OF_TARGET = ("sheet-", "print-", "bow")
"""Causes that a hand-made box may well have: naming them on an otherwise clean drive is no false alarm."""
REFUSALS = (
    ("wheels-swapped", "joints are swapped"),
    ("wheel-reversed", "readings fall while"),
    ("box-upside-down", "or the box stands upside down"),
    ("box-on-side", "lies on its side"),
    ("other-box", "another box"),
    ("unit", "--joint-unit|whole numbers"),
    ("clock", "stamps|clocks"),
    ("encoder-restart", "readings jump"),
    ("few-stops", "usable stops|fewer than|can be used|too few to tell why"),
)
"""What a refusal names, by its words; where two causes look alike it names both."""
FAMILIES = re.compile(r"-(right|left|both|\d+).*$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One drive: what was named, the size found in sigmas off, the verdict, the largest error over its sigma.

    ``moves`` is the largest change of a parameter by the violation, over its sigma, where nothing is diagnosed.
    """

    causes: tuple[str, ...]
    size: float
    level: str
    worst: float
    errors: Array
    moves: float = 0.0


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=40, help="drives of each violation and size (40)")
    parser.add_argument("--clean", type=int, default=500, help="drives without a violation (500)")
    parser.add_argument("--quick", action="store_true", help="3 drives of each violation, 20 clean ones")
    parser.add_argument("--only", default="", help="violations whose name holds this word; 'clean' for drives without")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep every drive's outcome there, and go on with it")
    arguments = parser.parse_args(argv)
    kept = KeptRuns(arguments.keep)
    runs, clean = (3, 20) if arguments.quick else (arguments.runs, arguments.clean)
    confusion: dict[str, Counter[str]] = {}
    everything: list[Run] = []
    print("moves: a parameter by so many sigmas undiagnosed, median; of 3: named where it moves one by 3 or more;")
    print("named: right cause / another one beside or instead; size: rms of (found - true) / sigma;")
    print("errors: rms and largest of all parameters over their sigmas; wrong: beyond 5 sigma and called good, usable")
    print(
        f"{'violation':24}{'size':>12}{'moves':>7}{'of 3':>9}{'named':>12}{'size z':>8}{'rms':>7}{'worst':>8}"
        f"{'refused':>9}{'wrong':>9}{'s':>7}"
    )
    for k, violation in enumerate((*VIOLATIONS, *HARMLESS)):
        if arguments.only not in violation.name:
            continue
        for size in violation.sizes:
            begun = time.process_time()
            found = [one(violation, size, (arguments.seed, k, run), kept) for run in range(runs)]
            everything += found
            confusion.setdefault(violation.name, Counter()).update(
                cause for run in found for cause in (families(run) or ["nothing"])
            )
            print(line(violation, size, found, time.process_time() - begun), flush=True)
    if arguments.only in {"", "clean"}:
        everything += show_clean(clean, arguments.seed, kept)
    if confusion:
        table(confusion)
    calibrated = [run for run in everything if run.level != "refused"]
    for level in ("good", "usable"):
        wrong = sum(run.level == level and run.worst > WRONG for run in calibrated)
        print(f"{level} with an error beyond {WRONG:g} sigma: {wrong} of {sum(r.level == level for r in calibrated)}")
    return 0


def one(violation: Violation, size: float, draw: tuple[int, int, int], kept: KeptRuns) -> Run:
    """Return the outcome of one drive with a violation; ``draw`` is the seed, which violation, and which drive."""
    return _kept(kept, (*draw, violation.name, size), partial(_one, violation, size, draw))


def _kept(kept: KeptRuns, key: tuple[int | str | float, ...], make: Callable[[], Run]) -> Run:
    def made() -> dict[str, Any]:
        run = make()
        return {**asdict(run), "errors": run.errors.tolist()}

    run = kept.outcome(key, made)
    return Run(**{**run, "causes": tuple(run["causes"]), "errors": np.array(run["errors"])})


def _one(violation: Violation, size: float, draw: tuple[int, int, int]) -> Run:
    rng, robot = np.random.default_rng(draw), (turtlebot, khepera)[draw[-1] % 2]()
    usual = hand_made(rng)
    faults = violation.draw(usual, size, robot, rng)
    seed = int(rng.integers(2**62))
    drives = [
        imperfect_drive(robot, TARGET, DriveOptions(stops=STOPS, steps_per_sample=4), f, np.random.default_rng([seed]))
        for f in (faults, usual)
    ]
    run_ = judged(drives[0], violation, size)
    return replace(run_, moves=moved(*drives))


def moved(faulty: ImperfectDrive, usual: ImperfectDrive) -> float:
    """Return the largest change of a parameter by a violation, over its sigma without it; infinite if none is found.

    Camera models are chosen by the drive without it. Nothing is left out and no cause is looked for.
    """
    options = EstimateOptions(lens=None, target=TARGET, find_faults=False)
    without = estimate([usual.seen], None, options)
    try:
        found = estimate([faulty.seen], None, replace(options, lens=without.camera.kind))
    except CalibError:
        return np.inf
    (here, _), (there, sigma) = (_errors(e, e.sigma, d) for e, d in ((found, faulty), (without, usual)))
    return max(abs(here[name] - there[name]) / sigma[name] for name in here)


def judged(drive: ImperfectDrive, violation: Violation | None, size: float) -> Run:
    try:
        found = calibrate(drive.seen, TARGET)
    except CalibError as error:
        causes = tuple(cause for cause, words in REFUSALS if re.search(words, str(error)))
        causes = causes if len(causes) < 2 else tuple(cause for cause in causes if cause != "few-stops")
        return Run(causes=causes, size=np.nan, level="refused", worst=0.0, errors=np.zeros(0))
    detail = found.detail
    assert detail is not None
    off = [
        abs(abs(finding.size) - size * violation.scale) / np.hypot(finding.sigma, violation.usual)
        for finding in found.findings
        if violation is not None and violation.scale and finding.cause.startswith(violation.causes)
    ]
    z = errors_in_sigmas(found, drive)
    level = str(found.verdict.level) if found.verdict is not None else "none"
    return Run(
        causes=tuple(finding.cause for finding in found.findings),
        size=min(off, default=np.nan),
        level=level,
        worst=float(np.max(np.abs(z))),
        errors=z,
    )


def errors_in_sigmas(found: Calibration, drive: ImperfectDrive) -> Array:
    """Errors of camera (fu, fv, cu, cv), wheels and extrinsics over their sigmas; what cannot be seen is left out."""
    assert found.detail is not None
    off, sigma = _errors(found, found.detail.covariance.sigma, drive)
    return np.array([value / sigma[name] for name, value in off.items()])


def _errors(
    found: Calibration | Estimate, sigma: Mapping[str, float], drive: ImperfectDrive
) -> tuple[dict[str, float], Mapping[str, float]]:
    """Errors (px, m, rad) by parameter, and all sigmas."""
    robot, faults = drive.robot, drive.faults
    camera = np.array([robot.camera.fu, robot.camera.fv, robot.camera.cu, robot.camera.cv])
    T = robot.T_body_cam
    if faults.camera.knocked is not None:
        T = T @ exp_se3(np.array(faults.camera.knocked[1]))
    if faults.camera.focus is not None:
        _, scale, right, down = faults.camera.focus
        centre = (np.array(robot.image_size) - 1) / 2
        camera = np.concatenate([scale * camera[:2], centre + scale * (camera[2:] - centre) + (right, down)])
    c, w = found.camera, found if isinstance(found, Estimate) else found.wheels
    off = dict(zip(("fu", "fv", "cu", "cv"), np.array([c.fu, c.fv, c.cu, c.cv]) - camera, strict=True))
    off |= {"rR": w.rR - robot.rR, "rL": w.rL - robot.rL, "b": w.b - robot.b}
    off |= dict(zip(("rx", "ry", "rz"), log_so3(T[:3, :3].T @ found.T_body_cam[:3, :3]), strict=True))
    off |= dict(zip(("tx", "ty", "tz"), found.T_body_cam[:3, 3] - T[:3, 3], strict=True))
    standing = faults.box.standing
    if standing is not None and standing[2, 2] > 0:  # a box on a table shows nothing of how high it stands
        del off["tz"]
    return {name: float(value) for name, value in off.items()}, sigma


def families(run: Run) -> list[str]:
    """Return what was named, one entry a family; what a hand-made box has anyway is one."""
    return sorted({"target" if cause.startswith(OF_TARGET) else FAMILIES.sub("", cause) for cause in run.causes})


def line(violation: Violation, size: float, found: list[Run], seconds: float) -> str:
    right = sum(any(cause.startswith(violation.causes) for cause in run.causes) for run in found)
    other = sum(any(not cause.startswith((*violation.causes, *OF_TARGET)) for cause in run.causes) for run in found)
    named = f"{right if violation.causes else '-'}/{other} of {len(found)}"
    solved = [run for run in found if run.level != "refused"]
    z = np.concatenate([run.errors for run in solved]) if solved else np.zeros(0)
    sizes = np.array([run.size for run in solved if np.isfinite(run.size)])
    wrong = [sum(run.level == level and run.worst > WRONG for run in solved) for level in ("good", "usable")]
    moving = [run for run in found if run.moves >= MOVES]
    of_moving = sum(any(cause.startswith(violation.causes) for cause in run.causes) for run in moving)
    asked = f"{of_moving if violation.causes else '-'}/{len(moving)}"
    return (
        f"{violation.name:24}{f'{size:g} {violation.unit}':>12}"
        f"{min(float(np.median([run.moves for run in found])), 9999.0):7.1f}{asked:>9}{named:>12}"
        f"{np.sqrt(np.mean(sizes**2)) if len(sizes) else np.nan:8.1f}"
        f"{np.sqrt(np.mean(z**2)) if len(z) else np.nan:7.2f}{np.max(np.abs(z), initial=0):8.1f}"
        f"{len(found) - len(solved):9d}{f'{wrong[0]}, {wrong[1]}':>9}{seconds / len(found):7.1f}"
    )


def show_clean(count: int, seed: int, kept: KeptRuns) -> list[Run]:
    """Print and return what is found where nothing is wrong: hand-made boxes and leaning robots, nothing else."""
    found = [_kept(kept, (seed, 999, run, "clean", 0.0), partial(clean_run, seed, run)) for run in range(count)]
    named = Counter(cause for run in found for cause in families(run))
    false = sum(any(cause != "target" for cause in families(run)) for run in found)
    z = np.concatenate([run.errors for run in found])
    levels = Counter(run.level for run in found)
    print(
        f"{count} clean drives: {false} with a false alarm ({100 * false / count:.1f} %; {dict(named)}), errors rms "
        f"{np.sqrt(np.mean(z**2)):.2f}, worst {np.max(np.abs(z)):.1f}, 95 % intervals hold "
        f"{100 * np.mean(np.abs(z) < 1.96):.1f} %, verdicts {dict(levels)}"
    )
    return found


def clean_run(seed: int, run: int) -> Run:
    """Return the outcome of a drive without a violation."""
    rng = np.random.default_rng([seed, 999, run])
    robot = (turtlebot, khepera)[run % 2]()
    options = DriveOptions(stops=STOPS, steps_per_sample=4)
    return judged(imperfect_drive(robot, TARGET, options, hand_made(rng), rng), None, 0.0)


def table(confusion: dict[str, Counter[str]]) -> None:
    """Print what was named (across) for what was injected (down)."""
    columns = sorted({cause for counts in confusion.values() for cause in counts})
    print("\nnamed (across) for what was injected (down):")
    print(" " * 24 + " ".join(f"{k:>3d}" for k in range(len(columns))))
    for name, counts in confusion.items():
        print(f"{name:24}" + " ".join(f"{counts[c] or '.':>3}" for c in columns))
    print("\n".join(f"{k:3d} {cause}" for k, cause in enumerate(columns)) + "\n")


if __name__ == "__main__":
    raise SystemExit(main())
