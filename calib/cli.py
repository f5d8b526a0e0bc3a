"""The command ``fleet-calibrate``."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.fleet import Outcome
    from target.box import Target

_EPILOG = """\
example:
  fleet-calibrate robots/*.mcap

Each log is an MCAP file of ROS 2 messages: the wheels' sensor_msgs/msg/JointState and one camera's
sensor_msgs/msg/Image or CompressedImage, recorded while the robot drove around the printed box and stood still at
three or more places (better a dozen, on several sides) with the box in view. The result of robots/r01.mcap goes to
calibration/r01/calibration.json.

exit status: 0 all robots calibrated, 1 some robot failed (its reason is printed), 2 wrong usage
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate robots from their logs; returns the exit status."""
    parser = _parser()
    args = parser.parse_args(argv)
    words = list(sys.argv[1:] if argv is None else argv)
    return _run(args, command=shlex.join(["fleet-calibrate", *words]))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fleet-calibrate",
        usage="fleet-calibrate LOG [LOG ...] [options]",
        description="Calibrate the camera, the wheels and the camera's mounting of every robot from its log.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "logs", nargs="+", type=Path, metavar="LOG", help="recording (.mcap), or correspondences saved before (.npz)"
    )
    parser.add_argument("--target", type=Path, metavar="FILE", help="target.json of the box (the default box if none)")
    parser.add_argument(
        "--out", type=Path, default=Path("calibration"), metavar="FOLDER", help="where results go (calibration)"
    )
    parser.add_argument(
        "--truth", action="store_true", help="print errors against <log stem>.truth.json beside the log"
    )
    names = parser.add_argument_group("topics and joints, where their names do not tell")
    names.add_argument("--camera-topic", metavar="TOPIC", help="images")
    names.add_argument("--joint-topic", metavar="TOPIC", help="joint states of the wheels")
    names.add_argument("--left-joint", metavar="NAME", help="left wheel")
    names.add_argument("--right-joint", metavar="NAME", help="right wheel")
    parser.add_argument(
        "--per-stop",
        action="store_true",
        help="calibrate the camera at every stop alone, as in the paper (all stops jointly if not given)",
    )
    parser.add_argument("--jobs", type=_positive, metavar="N", help="robots worked on at once (as many as cores)")
    parser.add_argument("--quiet", action="store_true", help="no progress, only results and errors")
    parser.add_argument("--version", action=_Version)
    return parser


class _Version(argparse.Action):
    """Prints the version; looked up only when asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="print the version and leave")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        print(f"boxcal {version('boxcal')}")
        parser.exit()


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is not a positive number")
    return value


def _run(args: argparse.Namespace, command: str) -> int:
    from calib.camera import CameraMode
    from calib.errors import CalibError
    from calib.fleet import Job, Settings, calibrate_fleet, robot_name
    from detect.names import Topics
    from target.errors import TargetError

    def say(line: str) -> None:
        if not args.quiet:
            print(line, file=sys.stderr, flush=True)

    try:
        target = _target(args.target)
        names = [robot_name(log) for log in args.logs]
    except (TargetError, CalibError) as error:
        print(f"fleet-calibrate: {error}", file=sys.stderr)
        return 2
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        print(
            f"fleet-calibrate: several logs are named {', '.join(twice)}: a robot is called as its log; rename them",
            file=sys.stderr,
        )
        return 2
    settings = Settings(
        topics=Topics(
            camera_topic=args.camera_topic,
            joint_topic=args.joint_topic,
            left_joint=args.left_joint,
            right_joint=args.right_joint,
        ),
        camera_mode=CameraMode.PER_STOP if args.per_stop else CameraMode.JOINT,
    )
    jobs = [Job(log=log, target=target, settings=settings, out=args.out, command=command) for log in args.logs]
    say(f"calibrating {len(jobs)} robot{'s' if len(jobs) > 1 else ''} ...")
    outcomes = []
    for outcome in calibrate_fleet(jobs, workers=args.jobs, progress=say):
        outcomes.append(outcome)
        verdict = "calibrated" if outcome.calibration else "FAILED"
        say(f"[{len(outcomes)}/{len(jobs)}] {outcome.log.name}: {verdict} in {outcome.seconds:.1f} s")
    outcomes.sort(key=lambda o: args.logs.index(o.log))
    return _report(outcomes, out=args.out, truth=args.truth)


def _target(path: Path | None) -> "Target":
    from target.box import make_target
    from target.landmarks import load_target

    return make_target() if path is None else load_target(path)


def _report(outcomes: "list[Outcome]", *, out: Path, truth: bool) -> int:
    from calib.errors import CalibError
    from calib.table import errors_table, results_table
    from calib.truth import compare, load_truth, truth_path

    failed = False
    results = [o.calibration for o in outcomes if o.calibration is not None]
    if results:
        print(results_table(results))
        for result in results:
            for note in result.notes:
                print(f"{result.robot}: {note}")
        print(f"\nwritten: {out}/<robot>/calibration.json")
    if truth:
        errors = []
        for o in outcomes:
            if o.calibration is not None:
                try:
                    errors.append((o.calibration.robot, compare(o.calibration, load_truth(truth_path(o.log)))))
                except CalibError as error:
                    failed = True
                    print(f"fleet-calibrate: {error}", file=sys.stderr)
        if errors:
            print("\n" + errors_table(errors))
    for o in outcomes:
        if o.calibration is None:
            failed = True
            print(f"fleet-calibrate: {o.error}", file=sys.stderr)
            if o.details:
                print(o.details, file=sys.stderr)
    if len(results) < len(outcomes):
        print(f"fleet-calibrate: {len(outcomes) - len(results)} of {len(outcomes)} robots failed", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
