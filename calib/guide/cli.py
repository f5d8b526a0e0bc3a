"""The command ``guide``: at the robot's side while it drives."""

import argparse
import asyncio
import re
import shlex
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.command_line import CommandParser

if TYPE_CHECKING:
    from boxcal.calib.guide.outlook import GuideOptions
    from boxcal.calib.guide.session import Session
    from boxcal.calib.guide.sources.link import Link

_EPILOG = """\
example:
  guide ws://robot:8765                 foxglove_bridge on the robot (rosbridge: its port, usually 9090)
  guide drive.mcap                      a recording that is being written
  guide ws://robot:8765 --host 0.0.0.0  also from a phone beside the robot; the address printed holds a token

Shows on a local page what the camera sees, where to drive next, how long to stand still, and when it is enough; records
what it hears into an MCAP file of its own. Ctrl-C ends it; what was recorded is kept. Needs the extra live:
pip install 'boxcal[live]'

exit status: 0 ended, 1 it could not begin or go on (the reason is printed), 2 wrong usage
"""
_PORT = 8787


def main(argv: Sequence[str] | None = None) -> int:
    """Guide a drive; returns the exit status."""
    args = _parser().parse_args(argv)
    try:
        return _run(args, sys.argv[1:] if argv is None else argv)
    except KeyboardInterrupt:
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        "guide",
        usage="guide SOURCE [options]",
        description="Guide a robot's drive around the box, stop by stop, until its calibration is good.",
        epilog=_EPILOG,
    )
    parser.add_argument("source", metavar="SOURCE", help="the bridge's address (ws://...), or an MCAP that is written")
    parser.add_argument("--target", type=Path, metavar="FILE", help="target.json of the box (the default box if none)")
    parser.add_argument("--robot", type=_name, default="robot", metavar="NAME", help="of recording and results (robot)")
    parser.add_argument(
        "--record", type=Path, default=Path("recordings"), metavar="FOLDER", help="where it records (recordings)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("calibration"), metavar="FOLDER", help="where results go (calibration)"
    )
    page = parser.add_argument_group("the page")
    page.add_argument("--host", default="127.0.0.1", help="address to listen at (127.0.0.1: this machine only)")
    page.add_argument("--port", type=_port, default=_PORT, help=f"port of the page ({_PORT}; 0 takes a free one)")
    page.add_argument("--open", action="store_true", help="open the page in a browser")
    names = parser.add_argument_group("topics and joints, where their names do not say")
    names.add_argument("--camera-topic", metavar="TOPIC", help="images")
    names.add_argument("--joint-topic", metavar="TOPIC", help="joint states, ticks or odometry")
    names.add_argument("--left-joint", metavar="NAME", help="left wheel: a joint, or /topic.field")
    names.add_argument("--right-joint", metavar="NAME", help="right wheel: a joint, or /topic.field")
    names.add_argument("--ticks-per-turn", type=float, metavar="N", help="of a wheel whose positions are ticks")
    return parser


def _run(args: argparse.Namespace, words: Sequence[str]) -> int:
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
        import websockets  # noqa: F401
    except ModuleNotFoundError as error:
        return _failed(f"{error.name} is not installed; pip install 'boxcal[live]'")

    from boxcal.calib.guide.page.app import page_server
    from boxcal.calib.guide.page.state import state_of
    from boxcal.calib.guide.session import Session
    from boxcal.calib.guide.sources.inbox import Inbox
    from boxcal.calib.guide.sources.link import Link, without_credentials
    from boxcal.calib.local_page.board import Board
    from boxcal.calib.local_page.interruption import end_on_sigterm
    from boxcal.target.errors import BoxcalError

    try:
        options = _options(args, shlex.join(["guide", *map(without_credentials, words)]))
        link = Link(address=args.source, topics=options.settings.topics, inbox=Inbox())
        session, board = Session(options, link), Board()
        server = page_server(session, board, args.host, args.port)
    except BoxcalError as error:
        return _failed(str(error))
    except OSError as error:
        return _failed(
            f"port {args.port} at {args.host} cannot be had ({error.strerror or error}); give another --port"
        )
    end_on_sigterm()
    server.start()
    print(f"guide: the page is at {server.url}", flush=True)
    if args.open:
        import webbrowser

        webbrowser.open(server.url)
    threads = [
        threading.Thread(target=session.run, args=(lambda s: board.put(state_of(s)),), name="session"),
        threading.Thread(target=_follow, args=(link,), name="source", daemon=True),
    ]
    for thread in threads:
        thread.start()
    try:
        _watch(session, threads[0])
    finally:
        link.stopped.set()
        session.stopped.set()
        threads[0].join()
        server.stop()
        if session.recorder is not None:
            print(f"guide: recorded {session.recorder.path} ({session.recorder.size / 1e6:.1f} MB)", flush=True)
    return _failed("it ended by a fault of its own; what was recorded is kept")


def _options(args: argparse.Namespace, command: str) -> "GuideOptions":
    from boxcal.calib.guide.outlook import GuideOptions
    from boxcal.calib.settings import Settings
    from boxcal.detect.log.topics import Topics
    from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits
    from boxcal.target.box import make_target
    from boxcal.target.files.target_json import load_target

    ticks = args.ticks_per_turn
    units = WheelUnits() if ticks is None else WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=ticks)
    topics = Topics(
        camera_topic=args.camera_topic,
        joint_topic=args.joint_topic,
        left_joint=args.left_joint,
        right_joint=args.right_joint,
    )
    return GuideOptions(
        robot=args.robot,
        target=load_target(args.target) if args.target else make_target(),
        settings=Settings(topics=topics, wheel_units=units),
        recordings=args.record,
        out=args.out,
        command=command,
    )


def _follow(link: "Link") -> None:
    from boxcal.calib.guide.sources.file import follow_file, is_file
    from boxcal.calib.guide.sources.server import follow_server

    try:
        if is_file(link.address):
            asyncio.run(follow_file(link, Path(link.address)))
        else:
            asyncio.run(follow_server(link))
    except Exception:
        link.lost("listening ended by a fault of its own (the terminal shows it); start the guide again")
        raise


def _watch(session: "Session", thread: threading.Thread) -> None:
    """Print what the session says until it ends or is interrupted."""
    while thread.is_alive():
        while session.said:
            print(f"guide: {session.said.popleft()}", flush=True)
        time.sleep(0.1)


def _failed(message: str) -> int:
    print(f"guide: {message}", file=sys.stderr)
    return 1


def _name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", text):
        raise argparse.ArgumentTypeError(f"{text[:40]!r}: letters, digits, . _ and - are needed")
    return text


def _port(text: str) -> int:
    if not (text.isdecimal() and 0 <= int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{text[:40]!r}: a number from 0 to 65535 is needed")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
