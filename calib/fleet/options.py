"""Options of the command ``fleet-calibrate``."""

import argparse
import re
from pathlib import Path

from boxcal.command_line import CommandParser, number, whole_number

_EPILOG = """\
example:
  fleet-calibrate robots/*.mcap

Each log is a recording of what the wheels' encoders and one camera say (MCAP, a ROS 2 bag folder, a ROS 1 bag, a
folder of pictures with wheels.csv; docs/recording.md), made while the robot drove around the printed box and stood
still at three or more places (better a dozen, on several sides) with the box in view. The result of robots/r01.mcap
goes to calibration/r01/calibration.json.

exit status: 0 all robots calibrated, 1 some robot failed (its reason is printed), 2 wrong usage, 3 with --strict if
some verdict is not good, 130 interrupted (what was finished is kept)
"""
_SIZE = number(0, 1e3)
"""What reads a size from an option."""


def options() -> argparse.ArgumentParser:
    """Return the parser of the command line; loads nothing heavy, so that ``--help`` is instant."""
    parser = CommandParser(
        "fleet-calibrate",
        usage="fleet-calibrate LOG [LOG ...] [options]",
        description="Calibrate the camera, the wheels and the camera extrinsics of every robot from its log.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help="recording (file, folder or URL), correspondences saved before (.npz), or a manifest (.csv) of robots",
    )
    parser.add_argument(
        "--target",
        type=Path,
        metavar="FILE",
        help="target.json of the box (the one beside or above the logs, there or in box/; else the default box)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("calibration"),
        metavar="FOLDER",
        help="where results go, a folder or URL (calibration)",
    )
    _history(parser)
    parser.add_argument(
        "--truth", action="store_true", help="print errors against <log stem>.truth.json beside the log"
    )
    _names(parser)
    parser.add_argument(
        "--same-robot",
        action="store_true",
        help="all logs are drives of one robot around the same box, solved together and named as the first log",
    )
    parser.add_argument(
        "--joint-box",
        action="store_true",
        help="all robots together find the box's true shape, and are calibrated with it; FOLDER gets it as target.json",
    )
    parser.add_argument("--validate", action="store_true", help="hold every stop out in turn and predict it")
    _files(parser)
    _model(parser)
    parser.add_argument("--strict", action="store_true", help="exit with 3 unless every verdict is good")
    _work(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress, only results and errors")
    return parser


def topic_options(parser: argparse.ArgumentParser, *, several: bool = False) -> argparse._ArgumentGroup:
    """Add the options that say where images and wheels are, and in what unit; return their group.

    With ``several`` the camera's topic may be given several times.
    """
    names = parser.add_argument_group("topics, joints and frames, where the log does not say")
    if several:
        names.add_argument(
            "--camera-topic", action="append", metavar="TOPIC", help="images; given several times: of several cameras"
        )
        names.add_argument(
            "--all-cameras", action="store_true", help="all cameras that show the box, calibrated together"
        )
    else:
        names.add_argument("--camera-topic", metavar="TOPIC", help="images")
    names.add_argument("--joint-topic", metavar="TOPIC", help="joint states, ticks or odometry")
    names.add_argument("--left-joint", metavar="NAME", help="left wheel: a joint, or /topic.field")
    names.add_argument("--right-joint", metavar="NAME", help="right wheel: a joint, or /topic.field")
    names.add_argument(
        "--joint-unit",
        choices=("rad", "deg", "ticks", "turns", "m"),
        default="rad",
        help="unit of the wheels' positions (rad); m is the rim's travel",
    )
    names.add_argument("--ticks-per-turn", type=float, metavar="N", help="of a wheel, with --joint-unit ticks")
    names.add_argument(
        "--reverse-left", action="store_true", help="the left wheel's positions fall as it rolls forward"
    )
    names.add_argument("--reverse-right", action="store_true", help="the right wheel's likewise")
    return names


def _work(parser: argparse.ArgumentParser) -> None:
    work = parser.add_argument_group("where the work is done, and what is done again")
    work.add_argument(
        "--force",
        action="store_true",
        help="do robots again whose log, box, settings and program are unchanged; else their results are kept",
    )
    work.add_argument(
        "--watch",
        action="store_true",
        help="LOG is a folder, or a URL of one or with a pattern: logs are calibrated as they arrive, until Ctrl-C",
    )
    work.add_argument("--resume", action="store_true", help=argparse.SUPPRESS)  # as is done anyway
    work.add_argument(
        "--jobs", type=whole_number(1, 4096), metavar="N", help="robots worked on at once (as many as cores)"
    )
    work.add_argument(
        "--cluster",
        metavar="SCHEDULER",
        help="work on a Dask cluster: its scheduler's address (tcp://host:8786) or file (.json), or 'configured', as "
        "Dask's configuration names it (docs/fleets.md)",
    )
    work.add_argument(
        "--time-limit",
        type=number(1, 1e6),
        default=3600.0,
        metavar="S",
        help="seconds that a robot may take where several are worked on at once; it is tried twice (3600)",
    )


def _names(parser: argparse.ArgumentParser) -> None:
    names = topic_options(parser, several=True)
    names.add_argument("--base-frame", type=_frame, metavar="NAME", help="on the floor below the axle (base_footprint)")
    names.add_argument("--camera-frame", type=_frame, metavar="NAME", help="camera's optical frame (the images' own)")
    names.add_argument("--prefix", type=_frame, metavar="TEXT", help="before frames: robots in one TF tree")
    names.add_argument(
        "--controller",
        type=_frame,
        default="diff_drive_controller",
        metavar="NAME",
        help="node that drives the wheels (diff_drive_controller)",
    )
    names.add_argument(
        "--bits", type=int, choices=(8, 10, 12, 14, 16), help="used bits of 16-bit frames (estimated from the frames)"
    )


def _history(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--store",
        metavar="STORE",
        help="history of the robots, a file (SQLite) or a database's URL ($BOXCAL_STORE); see robot-history",
    )
    parser.add_argument(
        "--hardware", default="", metavar="REVISION", help="the robots' hardware revision: groups on the fleet's page"
    )


def _files(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("what is written besides calibration.json and the files for ROS and Kalibr")
    files.add_argument(
        "--no-report",
        action="store_true",
        help="no report.html, fleet.html and fleet.xlsx; those of earlier runs are removed",
    )
    files.add_argument("--draw", action="store_true", help="each stop's picture with detected and reprojected corners")
    files.add_argument(
        "--nominal", type=Path, metavar="FILE", help="data sheet's wheels (YAML, JSON or URDF), for the multipliers"
    )
    files.add_argument("--rerun", type=Path, metavar="FILE.rrd", help="one robot's drive for the Rerun viewer")
    files.add_argument("--results-mcap", type=Path, metavar="FILE.mcap", help="the same for Foxglove")


def _model(parser: argparse.ArgumentParser) -> None:
    model = parser.add_argument_group("what is solved for")
    model.add_argument(
        "--per-stop",
        action="store_true",
        help="first guess of the camera from every stop alone, as in the paper (from all stops jointly if not given)",
    )
    model.add_argument("--closed-form", action="store_true", help="the paper's four steps alone: no sigmas, no tests")
    model.add_argument(
        "--lens",
        choices=("radial", "brown", "rational", "fisheye", "auto"),
        default="auto",
        help="the paper's one coefficient, OpenCV's 5 or 8, or its equidistant fisheye; auto: what the images ask for "
        "(auto)",
    )
    model.add_argument(
        "--floor",
        choices=("uneven", "rigid"),
        default="uneven",
        help="the robot leans a little from stop to stop, by how much the data say, or stands on one plane exactly, "
        "as in the paper (uneven)",
    )
    model.add_argument("--tilt-prior-deg", type=_SIZE, default=1.0, metavar="DEG", help="floor against box (1)")
    model.add_argument("--ink-prior-mm", type=_SIZE, default=0.1, metavar="MM", help="spread of the print's ink (0.1)")
    model.add_argument(
        "--scale-prior-percent",
        type=_SIZE,
        metavar="PERCENT",
        help="scale of the print in x and y; 0: exact (the data say how well the box was made)",
    )
    model.add_argument(
        "--face-prior-mm",
        type=_SIZE,
        metavar="MM",
        help="places of the faces, and as much over a face's half width in angle; 0: exact (the data say)",
    )
    model.add_argument(
        "--bow-prior-mm", type=_SIZE, metavar="MM", help="outward bow of each face; 0: flat (the data say)"
    )
    model.add_argument(
        "--size-prior-mm",
        type=_SIZE,
        default=0.0,
        metavar="MM",
        help="to what the box' width and depth were measured (not)",
    )
    model.add_argument("--encoder-step-deg", type=_SIZE, metavar="DEG", help="found from the samples if not given")
    model.add_argument(
        "--moving",
        choices=("auto", "on", "off"),
        default="auto",
        help="frames taken between stops: where the data allow it, always (else refuse the drive), never (auto)",
    )
    model.add_argument("--slip-mm", type=_SIZE, metavar="MM", help="of a wheel per root metre; estimated if not given")


def _frame(text: str) -> str:
    if not re.fullmatch(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*/?", text):
        raise argparse.ArgumentTypeError(f"{text!r} is no name for ROS: letters, digits, _ and / are, a letter first")
    return text
