"""The command ``fleet-calibrate``."""

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.command_line import CommandParser

if TYPE_CHECKING:
    from boxcal.calib.settings import Outcome, Settings
    from boxcal.target.box import Target

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
    try:
        return _run(args, command=shlex.join(["fleet-calibrate", *words]))
    except BrokenPipeError:  # whoever read the output has closed it (| head); what was written is whole
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        "fleet-calibrate",
        usage="fleet-calibrate LOG [LOG ...] [options]",
        description="Calibrate the camera, the wheels and the camera's mounting of every robot from its log.",
        epilog=_EPILOG,
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
    names = parser.add_argument_group("topics, joints and frames, where the log does not tell")
    names.add_argument("--camera-topic", metavar="TOPIC", help="images")
    names.add_argument("--joint-topic", metavar="TOPIC", help="joint states of the wheels")
    names.add_argument("--left-joint", metavar="NAME", help="left wheel")
    names.add_argument("--right-joint", metavar="NAME", help="right wheel")
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
    names.add_argument(
        "--bits", type=int, choices=(8, 10, 12, 14, 16), help="used bits of 16-bit frames (told from the frames)"
    )
    parser.add_argument(
        "--same-robot",
        action="store_true",
        help="all logs are drives of one robot around the same box, solved together and named as the first log",
    )
    parser.add_argument("--validate", action="store_true", help="hold every stop out in turn and predict it")
    files = parser.add_argument_group("what is written besides calibration.json and the files for ROS and Kalibr")
    files.add_argument("--no-report", action="store_true", help="no report.html of every robot and fleet.html")
    files.add_argument("--draw", action="store_true", help="each stop's picture with detected and reprojected corners")
    files.add_argument(
        "--nominal", type=Path, metavar="FILE", help="data sheet's wheels (YAML, JSON or URDF), for the multipliers"
    )
    files.add_argument("--rerun", type=Path, metavar="FILE.rrd", help="one robot's drive for the Rerun viewer")
    files.add_argument("--results-mcap", type=Path, metavar="FILE.mcap", help="the same for Foxglove")
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
    model.add_argument("--tilt-prior-deg", type=_size, default=1.0, metavar="DEG", help="floor against box (1)")
    model.add_argument("--ink-prior-mm", type=_size, default=0.1, metavar="MM", help="spread of the print's ink (0.1)")
    model.add_argument(
        "--scale-prior-percent",
        type=_size,
        metavar="%%",
        help="scale of the print in x and y; 0: exact (the data say how well the box was made)",
    )
    model.add_argument(
        "--face-prior-mm",
        type=_size,
        metavar="MM",
        help="places of the faces, and as much over a face's half width in angle; 0: exact (the data say)",
    )
    model.add_argument(
        "--bow-prior-mm", type=_size, metavar="MM", help="outward bow of each face; 0: flat (the data say)"
    )
    model.add_argument(
        "--size-prior-mm",
        type=_size,
        default=0.0,
        metavar="MM",
        help="to what the box' width and depth were measured (not)",
    )
    model.add_argument("--encoder-step-deg", type=_size, metavar="DEG", help="found from the samples if not given")
    model.add_argument("--slip-mm", type=_size, metavar="MM", help="of a wheel per root metre; estimated if not given")
    parser.add_argument("--jobs", type=_positive, metavar="N", help="robots worked on at once (as many as cores)")
    parser.add_argument("--quiet", action="store_true", help="no progress, only results and errors")
    return parser


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is not a positive number")
    return value


def _size(text: str) -> float:
    value = float(text)
    if not 0 <= value < 1e3:
        raise argparse.ArgumentTypeError(f"{value} is not a number from 0 on")
    return value


def _run(args: argparse.Namespace, command: str) -> int:
    from boxcal.calib.errors import CalibError
    from boxcal.calib.fleet.batch import calibrate_fleet
    from boxcal.calib.fleet.store import FLEET, check_folder, fleet_record
    from boxcal.calib.settings import Job, listed, robot_name
    from boxcal.detect.errors import DetectError
    from boxcal.target.errors import TargetError
    from boxcal.target.files.atomic_write import write_atomically

    def say(line: str) -> None:
        if not args.quiet:
            print(line, file=sys.stderr, flush=True)

    try:
        target = _target(args.target)
        robots = [(robot_name(log), (log,)) for log in args.logs]
    except (TargetError, CalibError) as error:
        print(f"fleet-calibrate: {error}", file=sys.stderr)
        return 2
    if args.same_robot:
        robots = [(robots[0][0], tuple(args.logs))]
    names = [name for name, _ in robots]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        print(
            f"fleet-calibrate: several logs are named {', '.join(twice)}: a robot is called as its log; rename them, "
            "or give --same-robot if they are drives of one robot",
            file=sys.stderr,
        )
        return 2
    if len(robots) > 1 and (args.rerun or args.results_mcap):
        print("fleet-calibrate: --rerun and --results-mcap show one robot; give one robot's logs", file=sys.stderr)
        return 2
    try:
        check_folder(args.out, target)
        settings = _settings(args, target)
    except (CalibError, DetectError) as error:
        print(f"fleet-calibrate: {error}", file=sys.stderr)
        return 2
    jobs = [
        Job(robot=name, logs=logs, target=target, settings=settings, out=args.out, command=command)
        for name, logs in robots
    ]
    say(f"calibrating {len(jobs)} robot{'s' if len(jobs) > 1 else ''} ...")
    outcomes = []
    for outcome in calibrate_fleet(jobs, workers=args.jobs, progress=say):
        outcomes.append(outcome)
        verdict = "calibrated" if outcome.calibration else "FAILED"
        say(f"[{len(outcomes)}/{len(jobs)}] {listed(outcome.job.logs)}: {verdict} in {outcome.seconds:.1f} s")
    outcomes.sort(key=lambda o: names.index(o.job.robot))
    status = _report(outcomes, out=args.out, truth=args.truth, report=settings.report)
    try:
        write_atomically(args.out / FLEET, fleet_record(outcomes, target, command))
    except OSError as error:
        print(f"fleet-calibrate: {args.out / FLEET}: {error.strerror or error}", file=sys.stderr)
        return 1
    return status


def _settings(args: argparse.Namespace, target: "Target") -> "Settings":
    from math import radians

    from boxcal.calib.exports.nominal import load_nominal
    from boxcal.calib.four_steps.step1_camera import CameraMode
    from boxcal.calib.likelihood import CameraKind
    from boxcal.calib.settings import Settings
    from boxcal.detect.log.topics import Topics
    from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits

    half_face = max(target.box.width, target.box.depth) / 2
    face = None if args.face_prior_mm is None else args.face_prior_mm * 1e-3
    return Settings(
        topics=Topics(
            camera_topic=args.camera_topic,
            joint_topic=args.joint_topic,
            left_joint=args.left_joint,
            right_joint=args.right_joint,
        ),
        wheel_units=WheelUnits(
            unit=JointUnit(args.joint_unit),
            ticks_per_turn=args.ticks_per_turn,
            reverse_left=args.reverse_left,
            reverse_right=args.reverse_right,
        ),
        bits=args.bits,
        camera_mode=CameraMode.PER_STOP if args.per_stop else CameraMode.JOINT,
        closed_form=args.closed_form,
        validate=args.validate,
        lens=None if args.lens == "auto" else CameraKind(args.lens),
        tilt_prior=radians(args.tilt_prior_deg),
        ink_prior=args.ink_prior_mm * 1e-3,
        rigid_floor=args.floor == "rigid",
        scale_prior=None if args.scale_prior_percent is None else args.scale_prior_percent * 1e-2,
        size_prior=args.size_prior_mm * 1e-3,
        face_prior=None if face is None else (face / half_face, face),
        bow_prior=None if args.bow_prior_mm is None else args.bow_prior_mm * 1e-3,
        encoder_step=None if args.encoder_step_deg is None else radians(args.encoder_step_deg),
        slip=None if args.slip_mm is None else args.slip_mm * 1e-3,
        report=not args.no_report and _has_report(),
        draw=args.draw,
        nominal=load_nominal(args.nominal) if args.nominal else None,
        rerun=args.rerun,
        results_mcap=args.results_mcap,
    )


def _has_report() -> bool:
    """Tell whether the extra ``report`` is installed; say so on stderr if not."""
    from importlib.util import find_spec

    if find_spec("jinja2") is None:
        print("fleet-calibrate: no reports without the extra: pip install 'boxcal[report]'", file=sys.stderr)
        return False
    return True


def _target(path: Path | None) -> "Target":
    from boxcal.target.box import make_target
    from boxcal.target.files.target_json import load_target

    return make_target() if path is None else load_target(path)


def _write_fleet(outcomes: "list[Outcome]", out: Path, report: bool) -> bool:
    """Write what is about all robots; tell whether that worked."""
    from boxcal.calib.exports.fleet_csv import fleet_csv
    from boxcal.calib.report.fleet import fleet_report
    from boxcal.target.files.atomic_write import write_atomically

    good = [o for o in outcomes if o.calibration is not None]
    results = [o.calibration for o in good if o.calibration is not None]
    try:
        write_atomically(out / "fleet.csv", fleet_csv(results))
        if report:
            failures = [o.error for o in outcomes if o.error is not None]
            write_atomically(out / "fleet.html", fleet_report(results, failures))
    except OSError as error:
        print(f"fleet-calibrate: {out}: {error.strerror or error}", file=sys.stderr)
        return False
    print(f"\nwritten: {out}/<robot>/calibration.json and files for ROS and Kalibr, {out}/fleet.csv")
    if report:
        print(f"reports: {out}/fleet.html, {out}/<robot>/report.html")
    return True


def _report(outcomes: "list[Outcome]", *, out: Path, truth: bool, report: bool) -> int:
    """Print results, errors against truth and failures; write what is about all robots; return the exit status."""
    whole = True
    if any(o.calibration is not None for o in outcomes):
        _print_results(outcomes)
        whole = _write_fleet(outcomes, out, report)
    if truth:
        whole = _print_errors(outcomes) and whole
    failed = [o for o in outcomes if o.calibration is None]
    for o in failed:
        print(f"fleet-calibrate: {o.error}", file=sys.stderr)
        if o.details:
            print(o.details, file=sys.stderr)
    if failed:
        print(f"fleet-calibrate: {len(failed)} of {len(outcomes)} robots failed", file=sys.stderr)
    return 0 if whole and not failed else 1


def _print_results(outcomes: "list[Outcome]") -> None:
    from boxcal.calib.console.tables import results_table

    print(results_table([o.calibration for o in outcomes if o.calibration is not None]) + "\n")
    for o in outcomes:
        if o.calibration is not None and o.calibration.verdict is not None:
            print(f"{o.calibration.robot}: {o.calibration.verdict.level} - {o.calibration.verdict.headline}")
            for note in o.calibration.notes:
                print(f"  {note}")


def _print_errors(outcomes: "list[Outcome]") -> bool:
    """Print how far every calibration is from its truth; tell whether there was a truth for each."""
    from boxcal.calib.compare.ground_truth import compare, load_truth, truth_path
    from boxcal.calib.compare.text import errors_table
    from boxcal.calib.errors import CalibError

    errors, whole = [], True
    for o in outcomes:
        if o.calibration is not None:
            try:
                errors.append((o.calibration.robot, compare(o.calibration, load_truth(truth_path(o.job.logs[0])))))
            except CalibError as error:
                whole = False
                print(f"fleet-calibrate: {error}", file=sys.stderr)
    if errors:
        print("\n" + errors_table(errors))
    return whole


if __name__ == "__main__":
    sys.exit(main())
