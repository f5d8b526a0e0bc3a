"""Options of ``robot-history``."""

import argparse
from pathlib import Path

from boxcal.command_line import CommandParser, number, probability

_EPILOG = """\
example:
  fleet-calibrate robots/*.mcap --store fleet.sqlite        puts every result into the store
  robot-history list --store fleet.sqlite
  robot-history show r07 --store fleet.sqlite
  robot-history page history --store fleet.sqlite           pages to look at: history/history.html
  robot-history import calibration --store fleet.sqlite     results that were made without the store
  robot-history date r07 3f2a91c0 2026-03-01 --store ...    a drive whose log had a wrong clock
  robot-history forget r07 3f2a91c0 --store ...             a drive that was not its own; without the key all of r07

STORE is a file (SQLite) or a database's URL, such as postgresql+psycopg://user@host/fleet; without --store it is the
environment's BOXCAL_STORE. The same drive calibrated again takes the place of the first result.

exit status: 0 done, 1 something in it could not be used (the rest was), 2 wrong usage or no store
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line; loads nothing heavy."""
    made = CommandParser(
        "robot-history",
        usage="robot-history {list,show,page,import,date,forget} [arguments] [--store STORE]",
        description="Show what calibrations say of robots over months and years: wear, knocks, scatter, and when to "
        "calibrate again.",
        epilog=_EPILOG,
    )
    made.add_argument("action", choices=("list", "show", "page", "import", "date", "forget"), help="see the examples")
    made.add_argument("words", nargs="*", metavar="ARGUMENT", help="robots; a folder; ROBOT DRIVE DATE; ROBOT [DRIVE]")
    made.add_argument("--store", metavar="STORE", help="file or URL ($BOXCAL_STORE)")
    made.add_argument(
        "--false-alarms",
        type=probability,
        default=0.02,
        metavar="N",
        help="false alarms a year, all robots together, at most (0.02)",
    )
    made.add_argument(
        "--far-m",
        type=number(1e-3, 10),
        default=0.2,
        metavar="M",
        help="position error after 10 m that calls for a calibration (0.2)",
    )
    made.add_argument("--results", type=Path, metavar="FOLDER", help="results that pages link to")
    return made
