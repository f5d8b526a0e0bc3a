"""The command ``boxcal``: all commands under one name, also as ``python -m boxcal``."""

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Protocol, cast

from boxcal.command_line import CommandParser, did_you_mean

COMMANDS = {
    "make-target": ("boxcal.target.cli", "print files, landmark table and models of a box"),
    "measure-target": ("boxcal.target.measure.cli", "correct the landmark table by what a ruler reads on the box"),
    "detect-tags": ("boxcal.detect.cli", "find the box's tags in pictures"),
    "plan-drive": ("boxcal.calib.plan_drive.cli", "plan where to drive around the box"),
    "check-log": ("boxcal.calib.check_log.cli", "tell what is wrong with a recording, in seconds"),
    "fleet-calibrate": ("boxcal.calib.cli", "calibrate robots from their logs"),
    "check-drive": ("boxcal.calib.check_drive.cli", "tell whether a calibrated robot drives as predicted"),
    "compare-calibrations": ("boxcal.calib.compare.cli", "tell whether two calibrations of a robot differ"),
    "robot-history": ("boxcal.calib.robot_history.cli", "show what a fleet's calibrations say over months and years"),
    "guide": ("boxcal.calib.guide.cli", "guide a robot's drive, stop by stop, until its calibration is good"),
    "simulate-robot": ("boxcal.calib.simulate.serve.cli", "drive a simulated robot by hand, heard like a real one"),
    "simulate-fleet": ("boxcal.calib.simulate.cli", "drive simulated robots around the box and write their logs"),
}
"""Module and summary of each command, by the name under which it is installed."""
ONLY_HERE = {"schemas": ("boxcal.schemas", "write JSON Schemas of the files that boxcal writes")}
"""Commands that have no name of their own."""
SHORT = {
    "calibrate": "fleet-calibrate",
    "plan": "plan-drive",
    "check": "check-drive",
    "compare": "compare-calibrations",
    "simulate": "simulate-fleet",
    "detect": "detect-tags",
    "history": "robot-history",
}
"""Shorter names that ``boxcal`` also takes."""


class _Command(Protocol):
    def main(self, argv: Sequence[str] | None = None) -> int:
        """Run the command; return its exit status."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``boxcal COMMAND ...``; return the command's exit status (2 for no or an unknown command)."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = _parser()
    if not words:
        parser.print_help()
        return 2
    if words[0] == "help":
        words = [*words[1:2], "--help"]
    if words[0].startswith("-"):
        parser.parse_args(words[:1])
    name = SHORT.get(words[0], words[0])
    known = COMMANDS | ONLY_HERE
    if name not in known:
        hint = did_you_mean(words[0], [*known, *SHORT])
        parser.error(f"unknown command {words[0]!r}; {hint or 'boxcal --help lists them'}")
    command = cast("_Command", import_module(known[name][0]))
    return command.main(words[1:])


def _parser() -> CommandParser:
    short = {name: alias for alias, name in SHORT.items()}
    rows = [
        (f"{short[name]}, {name}" if name in short else name, summary)
        for name, (_, summary) in (COMMANDS | ONLY_HERE).items()
    ]
    width = max(len(names) for names, _ in rows)
    return CommandParser(
        "boxcal",
        usage="boxcal COMMAND [arguments]",
        description="Calibrate every robot of a team from one AprilTag box and each robot's log.\n\n"
        "commands:\n" + "\n".join(f"  {names:<{width}}  {summary}" for names, summary in rows),
        epilog="example:\n"
        "  boxcal make-target box\n"
        "  boxcal calibrate robots/*.mcap --target box/target.json\n\n"
        "Each command is also installed under its own name. boxcal COMMAND --help says more about it.",
    )


if __name__ == "__main__":
    sys.exit(main())
