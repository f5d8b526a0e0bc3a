"""The command ``simulate-robot``: a robot to drive by hand in a browser, heard like a real one."""

import argparse
import sys
import threading
from collections.abc import Sequence
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.command_line import CommandParser

if TYPE_CHECKING:
    from boxcal.calib.simulate.serve.moving_robot import MovingRobot

_EPILOG = """\
example:
  simulate-robot --serve                then, in another terminal:  guide ws://127.0.0.1:8765

Drive it in the page: arrow keys or the pad, or a click on the floor. Its wheels and its camera are served at the
bridge's port by the Foxglove protocol, so Foxglove itself can look at it, too. Ctrl-C ends it. Needs the extra live:
pip install 'boxcal[live]'

exit status: 0 ended, 1 it could not begin (the reason is printed), 2 wrong usage
"""
_PAGE, _BRIDGE = 8788, 8765
_START = (-0.9, -0.55, 0.4)


def main(argv: Sequence[str] | None = None) -> int:
    """Simulate a robot until interrupted; returns the exit status."""
    args = _parser().parse_args(argv)
    try:
        return _run(args)
    except KeyboardInterrupt:
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        "simulate-robot",
        usage="simulate-robot --serve [options]",
        description="Simulate a robot that is driven by hand around the box, and serve its topics.",
        epilog=_EPILOG,
    )
    parser.add_argument("--serve", action="store_true", required=True, help="serve topics and page until interrupted")
    parser.add_argument("--target", type=Path, metavar="FILE", help="target.json of the box (the default box if none)")
    parser.add_argument(
        "--kind", choices=("turtlebot", "khepera", "random"), default="turtlebot", help="what robot (turtlebot)"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="settles slip, noise and a random robot (1)")
    parser.add_argument(
        "--slip", type=_number, default=0.2, metavar="MM", help="of each wheel after it rolled 1 m (0.2)"
    )
    parser.add_argument("--speed", type=_number, default=1.0, metavar="X", help="seconds that pass in a second (1)")
    parser.add_argument("--rate", type=_number, default=8.0, metavar="HZ", help="pictures a second, at most (8)")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (127.0.0.1: this machine only)")
    parser.add_argument("--port", type=int, default=_PAGE, metavar="N", help=f"of the page that drives it ({_PAGE})")
    parser.add_argument("--bridge-port", type=int, default=_BRIDGE, metavar="N", help=f"of its topics ({_BRIDGE})")
    parser.add_argument("--guide", default="", metavar="URL", help="a guide's page to show beside the pad")
    parser.add_argument("--open", action="store_true", help="open the page in a browser")
    return parser


def _run(args: argparse.Namespace) -> int:
    try:
        import foxglove  # noqa: F401
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ModuleNotFoundError as error:
        return _failed(f"{error.name} is not installed; pip install 'boxcal[live]'")
    import numpy as np

    from boxcal.calib.local_page.board import Board
    from boxcal.calib.local_page.interruption import end_on_sigterm
    from boxcal.calib.simulate.serve.bridge import Bridge
    from boxcal.calib.simulate.serve.camera import LiveCamera, usual_sensor
    from boxcal.calib.simulate.serve.loop import Loop
    from boxcal.calib.simulate.serve.page import DrivePage
    from boxcal.target.errors import BoxcalError

    stopped, board = threading.Event(), Board()
    try:
        moving = _robot(args)
        camera = LiveCamera(moving, usual_sensor(), np.random.default_rng([args.seed, 2]))
        bridge = Bridge(moving, camera, args.host, args.bridge_port)
        url = f"ws://{args.host}:{bridge.port}"
        page = DrivePage(moving, camera, url, args.guide)
        server = page.server(board, stopped, args.host, args.port)
    except BoxcalError as error:
        return _failed(str(error))
    except (OSError, RuntimeError) as error:
        return _failed(f"ports {args.port} and {args.bridge_port} at {args.host} cannot be had ({error}); give others")
    end_on_sigterm()
    server.start()
    loop = Loop(moving, bridge, args.speed, args.rate)
    loop.start()
    print(f"simulate-robot: topics at {url}", flush=True)
    print(f"simulate-robot: drive it at {server.url}", flush=True)
    if args.open:
        import webbrowser

        webbrowser.open(server.url)
    try:
        while True:
            board.put(page.state())
            stopped.wait(0.1)
    finally:
        stopped.set()
        loop.stop()
        bridge.stop()
        server.stop()


def _robot(args: argparse.Namespace) -> "MovingRobot":
    import numpy as np

    from boxcal.calib.simulate.robot import khepera, random_robot, turtlebot
    from boxcal.calib.simulate.serve.moving_robot import MovingRobot
    from boxcal.target.box import make_target
    from boxcal.target.files.target_json import load_target

    rng = np.random.default_rng([args.seed, 1])
    makers = {"turtlebot": turtlebot, "khepera": khepera, "random": lambda: random_robot("random", rng)}
    return MovingRobot(
        makers[args.kind](),
        load_target(args.target) if args.target else make_target(),
        np.array(_START),
        slip=args.slip * 1e-3,
        encoder_step=radians(0.1302),
        max_speed=0.3,
        rng=rng,
    )


def _failed(message: str) -> int:
    print(f"simulate-robot: {message}", file=sys.stderr)
    return 1


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1000:
        raise argparse.ArgumentTypeError(f"{text[:40]!r}: a number from 0 to 1000 is needed")
    return value


if __name__ == "__main__":
    sys.exit(main())
