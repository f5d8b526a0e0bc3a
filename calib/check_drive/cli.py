"""The command ``check-drive``."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.command_line import CommandParser, probability

if TYPE_CHECKING:
    from boxcal.calib.results.calibration import Calibration
    from boxcal.calib.settings import Settings
    from boxcal.detect.log.wheel_samples import WheelSamples

_EPILOG = """\
example:
  check-drive check/r01.mcap --calibration calibration/r01/calibration.json --target box/target.json
  check-drive straight.mcap --calibration calibration/r01/calibration.json --tape 5.004
  check-drive turns.mcap --calibration calibration/r01/calibration.json --turns 10

Record another drive with the calibrated robot, and see whether it goes as the calibration predicts. By the box: stand
still where the box is in view, drive some metres and turns, stand still where it is in view again, three times or
more; the path by the wheels is compared with what the camera sees, leg by leg. By a tape (--tape): stand, drive 5 m,
stand; measure between the two places. By a mark (--turns): stand on a mark, turn ten times, line up again. With --tape
or --turns the box need not be seen. Topics, joints and units are those that the calibration was made with.

exit status: 0 as predicted, 1 not as predicted, 2 no verdict (a file cannot be used, wrong usage)
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``check-drive``; returns the exit status."""
    parser = CommandParser(
        "check-drive",
        usage="check-drive LOG --calibration FILE [options]",
        description="Tell whether a calibrated robot drives as its calibration predicts.",
        epilog=_EPILOG,
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="recording (.mcap), or correspondences (.npz)")
    parser.add_argument("--calibration", type=Path, required=True, metavar="FILE", help="the robot's calibration.json")
    parser.add_argument("--target", type=Path, metavar="FILE", help="target.json of the box (the default box if none)")
    parser.add_argument("--tape", type=_positive, metavar="M", help="distance between first and last stand, by a tape")
    parser.add_argument("--tape-sigma-mm", type=_positive, default=3.0, metavar="MM", help="how well, one sigma (3)")
    parser.add_argument("--turns", type=float, metavar="N", help="turns to the left between first and last stand")
    parser.add_argument(
        "--mark-sigma-deg", type=_positive, default=0.5, metavar="DEG", help="how well, one sigma (0.5)"
    )
    parser.add_argument("--level", type=probability, default=0.01, metavar="P", help="significance level (0.01)")
    return _run(parser.parse_args(argv))


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{value:g} is not a positive number")
    return value


def _run(args: argparse.Namespace) -> int:
    from boxcal.calib.results.json_format import load_calibration
    from boxcal.target.errors import BoxcalError

    try:
        calibration = load_calibration(args.calibration)
        if args.tape is None and args.turns is None:
            text, agrees = _by_box(calibration, args)
        else:
            text, agrees = _by_hand(calibration, args)
    except BoxcalError as error:
        print(f"check-drive: {error}", file=sys.stderr)
        return 2
    print(text)
    return 0 if agrees else 1


def _by_box(calibration: "Calibration", args: argparse.Namespace) -> tuple[str, bool]:
    from boxcal.calib.check_drive.by_box import check_drive
    from boxcal.calib.check_drive.text import by_box
    from boxcal.calib.one_robot.reading import read
    from boxcal.calib.settings import Job
    from boxcal.target.box import make_target
    from boxcal.target.files.target_json import load_target

    target = make_target() if args.target is None else load_target(args.target)
    settings = _as_recorded(calibration)
    job = Job(robot=calibration.robot, logs=(args.log,), target=target, settings=settings, out=None)
    return by_box(check_drive(calibration, read(args.log, job)), args.level)


def _by_hand(calibration: "Calibration", args: argparse.Namespace) -> tuple[str, bool]:
    from math import radians

    from boxcal.calib.check_drive.by_hand import check_distance, check_turns
    from boxcal.calib.check_drive.text import by_hand

    wheels = _wheels(calibration, args.log)
    found = []
    if args.tape is not None:
        found.append(("distance", check_distance(calibration, wheels, args.tape, args.tape_sigma_mm * 1e-3)))
    if args.turns is not None:
        found.append(("turn", check_turns(calibration, wheels, args.turns, radians(args.mark_sigma_deg))))
    return by_hand(found, args.level)


def _wheels(calibration: "Calibration", log: Path) -> "WheelSamples":
    from boxcal.detect.correspondences import load_correspondences
    from boxcal.detect.log.open_recording import read_wheels

    if log.suffix == ".npz":
        return load_correspondences(log).wheels
    settings = _as_recorded(calibration)
    return read_wheels(log, settings.topics, settings.wheel_units)


def _as_recorded(calibration: "Calibration") -> "Settings":
    """Return the settings that say how the robot's logs are read: topics, joints, units and bits."""
    from boxcal.calib.settings import Settings
    from boxcal.detect.log.topics import Topics
    from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits

    saved = calibration.provenance.settings
    units = dict(saved.get("wheel_units", {}))
    if "unit" in units:
        units["unit"] = JointUnit(units["unit"])
    return Settings(topics=Topics(**saved.get("topics", {})), wheel_units=WheelUnits(**units), bits=saved.get("bits"))


if __name__ == "__main__":
    sys.exit(main())
