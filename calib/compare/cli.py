"""The command ``compare-calibrations``."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from boxcal.command_line import CommandParser, probability

_EPILOG = """\
example:
  compare-calibrations monday/r01/calibration.json friday/r01/calibration.json

Says how calibration B of a robot differs from calibration A: each parameter, in units and in standard deviations; what
that means on the ground and in the image; and whether chance explains it. That last is a chi-square test of all
parameters together, with the sum of both covariances: it takes the two for calibrations from different drives, whose
errors are independent. Of a robot with several cameras each camera and each pair of cameras is tested too, and the
chance is that of all tests together. At a level of 0.05, one pair in twenty of a robot that did not change differs
"beyond chance".

exit status: 0 no difference beyond chance, 1 a difference beyond chance, 2 no verdict (a file cannot be used, a
covariance is missing, wrong usage)
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Compare two calibrations; returns the exit status."""
    parser = CommandParser(
        "compare-calibrations",
        usage="compare-calibrations A.json B.json [options]",
        description="Tell whether two calibrations of a robot differ, and by what.",
        epilog=_EPILOG,
    )
    parser.add_argument("a", type=Path, metavar="A.json", help="the robot's calibration")
    parser.add_argument("b", type=Path, metavar="B.json", help="another of its calibrations")
    parser.add_argument("--level", type=probability, default=0.05, metavar="P", help="chance of a false alarm (0.05)")
    parser.add_argument("--any-robot", action="store_true", help="compare even if the robots' names differ")
    args = parser.parse_args(argv)
    return _run(args)


def _run(args: argparse.Namespace) -> int:
    from boxcal.calib.compare.cameras import chance_of_all, further, same_first
    from boxcal.calib.compare.difference import difference
    from boxcal.calib.compare.text import comparison, verdict
    from boxcal.calib.errors import CalibError
    from boxcal.calib.results.json_format import load_calibration
    from boxcal.detect.log.safe_text import printable

    try:
        a, b = load_calibration(args.a), load_calibration(args.b)
        if a.robot != b.robot and not args.any_robot:
            raise CalibError(
                f"{args.a} is of robot {printable(a.robot)}, {args.b} of {printable(b.robot)}: two calibrations of one "
                "robot are needed",
                remedy="give --any-robot if they are one",
            )
        others = further(a, b)
        a, b = same_first(a, b)
        found = difference(a, b)
    except CalibError as error:
        print(f"compare-calibrations: {error}", file=sys.stderr)
        return 2
    print(comparison(a, b, found, others))
    p_value = chance_of_all(found.p_value, others)
    if p_value is None:
        print(f"compare-calibrations: {verdict(found, args.level)}", file=sys.stderr)
        return 2
    print(f"\n{verdict(found, args.level, others)}")
    return 1 if p_value < args.level else 0


if __name__ == "__main__":
    sys.exit(main())
