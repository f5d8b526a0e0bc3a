"""The command ``check-log``."""

import sys
from collections.abc import Sequence
from pathlib import Path

from boxcal.calib.fleet.options import topic_options
from boxcal.command_line import CommandParser

_EPILOG = """\
example:
  check-log run.mcap --target box/target.json
  check-log run.mcap --timeline run.svg

Look at a recording while the robot is still on the floor: topics, rates, gaps, clocks, stops, the box at each,
sharpness, light, what the drive determines already, what is missing and where to stop next. One finding a line:
ok, look or wrong, what it is about, and what was found.

exit status: 0 nothing is wrong, 1 something is worth a look, 2 wrong usage, 3 something is wrong: as it is, the
recording gives no calibration to rely on (each finding says what to do; not all need another drive)
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``check-log``; return the exit status."""
    parser = CommandParser(
        "check-log",
        usage="check-log LOG [options]",
        description="Tell in seconds whether a recording will do, and what is missing.",
        epilog=_EPILOG,
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="recording (file or folder), or correspondences (.npz)")
    parser.add_argument("--target", type=Path, metavar="FILE", help="target.json of the box (the one beside the log)")
    parser.add_argument("--timeline", type=Path, metavar="FILE.svg", help="write a picture of the recording's timeline")
    topic_options(parser)
    args = parser.parse_args(argv)
    from boxcal.calib.check_log.check import check_log
    from boxcal.calib.check_log.timeline import timeline_bytes
    from boxcal.calib.fleet.chosen_settings import chosen_topics, chosen_units
    from boxcal.calib.fleet.find_target import find_target
    from boxcal.calib.results.verdict import Level
    from boxcal.target.errors import BoxcalError
    from boxcal.target.files.atomic_write import write_atomically

    try:
        box = find_target(args.target, [args.log])
        found = check_log(args.log, box.target, topics=chosen_topics(args), units=chosen_units(args))
        if args.timeline is not None:
            write_atomically(args.timeline, timeline_bytes(found))
    except BoxcalError as error:
        print(f"check-log: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"check-log: {args.timeline}: cannot be written ({error.strerror or error})", file=sys.stderr)
        return 2
    print(box.said, file=sys.stderr)
    for finding in found.findings:
        print(finding.line)
    return {Level.GOOD: 0, Level.USABLE: 1, Level.REDO: 3}[found.worst]


if __name__ == "__main__":
    sys.exit(main())
