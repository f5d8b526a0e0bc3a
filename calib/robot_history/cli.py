"""The command ``robot-history``."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.calib.robot_history.options import parser

if TYPE_CHECKING:
    from boxcal.calib.history.fleet_history import FleetHistory
    from boxcal.calib.history.session import Session

_LEAST = {"list": 0, "show": 1, "page": 1, "import": 1, "date": 3, "forget": 1}
_MOST = {"date": 3, "forget": 2}
_NEEDS = {
    "show": "the name of a robot",
    "page": "a folder for the pages",
    "import": "a folder of results",
    "date": "ROBOT DRIVE DATE: the robot, the beginning of the drive's key, a day such as 2026-03-01",
    "forget": "ROBOT, or ROBOT DRIVE",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``robot-history``; returns the exit status."""
    made = parser()
    args = made.parse_args(argv)
    if not _LEAST[args.action] <= len(args.words) <= _MOST.get(args.action, len(args.words)):
        made.error(f"{args.action} needs {_NEEDS[args.action]}")
    from boxcal.calib.errors import CalibError

    try:
        return _run(args)
    except CalibError as error:
        print(f"robot-history: {error}", file=sys.stderr)
    except BrokenPipeError:  # whoever read the output has closed it (| head)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        print(f"robot-history: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
    return 2


def _run(args: argparse.Namespace) -> int:
    from boxcal.calib.errors import CalibError
    from boxcal.calib.history_store.place import VARIABLE, store_url

    url = store_url(args.store)
    if url is None:
        raise CalibError("no store is named", remedy=f"give --store FILE, or its URL by {VARIABLE}")
    if args.action == "import":
        return _import(args, url)
    if args.action == "date":
        return _date(args, url)
    if args.action == "forget":
        return _forget(args, url)
    if url.startswith("sqlite:///") and not Path(url.removeprefix("sqlite:///")).exists():
        raise CalibError(
            "no such file", source=args.store, remedy="fleet-calibrate --store makes it, or robot-history import"
        )
    history = _history(args, url)
    if args.action == "page":
        return _page(args, history)
    return _show(args, history)


def _history(args: argparse.Namespace, url: str) -> "FleetHistory":
    from boxcal.calib.errors import CalibError
    from boxcal.calib.history.fleet_history import fleet_history
    from boxcal.calib.history_store.connection import open_store

    with open_store(url) as connection:
        from boxcal.calib.history_store.sessions import read

        sessions = read(connection)
    if not sessions:
        raise CalibError(
            "nothing is in the store yet", remedy="fleet-calibrate --store, or robot-history import FOLDER"
        )
    return fleet_history(sessions, level=args.false_alarms, far_m=args.far_m)


def _show(args: argparse.Namespace, history: "FleetHistory") -> int:
    from boxcal.calib.console.history import fleet_text, robot_text

    known = {r.robot: r for r in history.robots}
    wanted = _known(args.words, history)
    if args.action == "list":
        print(fleet_text(history))
    else:
        print("\n\n".join(robot_text(history, known[name]) for name in wanted))
    return 0


def _known(wanted: list[str], history: "FleetHistory") -> list[str]:
    """Return names of robots that are in the store (CalibError for the first that is not)."""
    from boxcal.calib.errors import CalibError
    from boxcal.detect.log.safe_text import printable, suggestion

    known = {r.robot for r in history.robots}
    for name in wanted:
        if name not in known:
            raise CalibError(
                f"no robot {printable(name)} in the store",
                remedy=f"robot-history list shows those that are{suggestion(name, known)}",
            )
    return wanted


def _page(args: argparse.Namespace, history: "FleetHistory") -> int:
    from boxcal.calib.report.history import PAGE, history_pages
    from boxcal.target.files.atomic_write import write_atomically

    out = Path(args.words[0])
    wanted = _known(args.words[1:], history)
    count = 0
    for relative, content in history_pages(history, wanted, results=args.results, out=out):
        write_atomically(out / relative, content)
        count += 1
    print(f"written: {out / PAGE} and {count - 1} robots' pages")
    return 0


def _import(args: argparse.Namespace, url: str) -> int:
    from boxcal.calib.errors import CalibError
    from boxcal.calib.history.session import sessions_of
    from boxcal.calib.history_store.connection import open_store
    from boxcal.calib.results.json_format import CALIBRATION, load_calibration

    found: dict[tuple[str, str], Session] = {}
    bad = read = 0
    for folder in args.words:
        paths = sorted(Path(folder).rglob(CALIBRATION)) if Path(folder).is_dir() else [Path(folder)]
        if not paths:
            raise CalibError(f"no {CALIBRATION} in it", source=folder, remedy="name a folder of results")
        for path in paths:
            try:
                found |= {(s.robot, s.key): s for s in sessions_of(load_calibration(path))}
                read += 1
            except CalibError as error:
                bad += 1
                print(f"robot-history: {error}", file=sys.stderr)
    with open_store(url) as connection:
        from boxcal.calib.history_store.sessions import count, put

        before = count(connection)
        lines = put(connection, found.values())
        new = count(connection) - before
    for line in lines:
        print(f"robot-history: {line}", file=sys.stderr)
    print(f"{read} results read: {new} new drives, {len(found) - new} of drives that were there already")
    return 1 if bad else 0


def _date(args: argparse.Namespace, url: str) -> int:
    from datetime import UTC, datetime

    from boxcal.calib.errors import CalibError
    from boxcal.calib.history_store.connection import open_store

    robot, drive, text = args.words
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise CalibError(f"{text[:40]!r} is no date", needed="one such as 2026-03-01 or 2026-03-01T14:30") from error
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    with open_store(url) as connection:
        from boxcal.calib.history_store.sessions import set_time

        set_time(connection, robot, drive, int(moment.timestamp()) * 10**9)
    print(f"{robot}: drive {drive} is dated {moment.isoformat(timespec='minutes')}")
    return 0


def _forget(args: argparse.Namespace, url: str) -> int:
    from boxcal.calib.history_store.connection import open_store

    with open_store(url) as connection:
        from boxcal.calib.history_store.sessions import forget

        gone = forget(connection, args.words[0], *args.words[1:])
    print(f"{args.words[0]}: {gone} drive{'s' if gone != 1 else ''} forgotten")
    return 0


if __name__ == "__main__":
    sys.exit(main())
