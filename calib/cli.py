"""The command ``fleet-calibrate``."""

import argparse
import os
import re
import shlex
import sys
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.command_line import CommandParser

if TYPE_CHECKING:
    from boxcal.calib.results.calibration import Calibration
    from boxcal.calib.settings import Job, Outcome, Settings
    from boxcal.target.box import Target

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
NOT_GOOD, INTERRUPTED = 3, 130
"""Exit statuses: a verdict that is not good (with ``--strict``); Ctrl-C, as shells have it."""


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate robots from their logs; returns the exit status."""
    parser = _parser()
    args = parser.parse_args(argv)
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        return _run(args, command=shlex.join(["fleet-calibrate", *words]))
    except BrokenPipeError:  # whoever read the output has closed it (| head); all files are written
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        _tell("fleet-calibrate: interrupted")
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        "fleet-calibrate",
        usage="fleet-calibrate LOG [LOG ...] [options]",
        description="Calibrate the camera, the wheels and the camera's mounting of every robot from its log.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help="recording (file or folder), or correspondences saved before (.npz)",
    )
    parser.add_argument(
        "--target",
        type=Path,
        metavar="FILE",
        help="target.json of the box (the one beside or above the logs, there or in box/; else the default box)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("calibration"), metavar="FOLDER", help="where results go (calibration)"
    )
    parser.add_argument(
        "--truth", action="store_true", help="print errors against <log stem>.truth.json beside the log"
    )
    names = parser.add_argument_group("topics, joints and frames, where the log does not tell")
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
        metavar="PERCENT",
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
    parser.add_argument("--strict", action="store_true", help="exit with 3 unless every verdict is good")
    parser.add_argument("--resume", action="store_true", help="skip robots whose result is in the folder already")
    parser.add_argument("--jobs", type=_positive, metavar="N", help="robots worked on at once (as many as cores)")
    parser.add_argument("--quiet", action="store_true", help="no progress, only results and errors")
    return parser


def _frame(text: str) -> str:
    if not re.fullmatch(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*/?", text):
        raise argparse.ArgumentTypeError(f"{text!r} is no name for ROS: letters, digits, _ and / are, a letter first")
    return text


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
        base_frame=args.base_frame,
        camera_frame=args.camera_frame,
        prefix=args.prefix or "",
        controller=args.controller,
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


def _run(args: argparse.Namespace, command: str) -> int:
    if not args.quiet:  # before what takes a second to load
        _tell(f"fleet-calibrate: {len(args.logs)} log{'s' if len(args.logs) > 1 else ''}, starting ...")
    from boxcal.calib.console.progress import make_progress
    from boxcal.calib.fleet.batch import calibrate_fleet
    from boxcal.calib.fleet.plan import finished_before
    from boxcal.target.errors import BoxcalError

    try:
        jobs, box = _jobs(args, command)
    except BoxcalError as error:
        _tell(f"fleet-calibrate: {error}")
        return 2
    if not args.quiet:
        _tell(box)
    outcomes = finished_before(jobs) if args.resume else []
    waiting = [job for job in jobs if all(job is not o.job for o in outcomes)]
    interrupted, start = False, time.time()
    try:
        with (
            make_progress(len(waiting), quiet=args.quiet) as progress,
            closing(calibrate_fleet(waiting, workers=args.jobs, progress=progress.stage)) as running,
        ):
            for outcome in running:
                outcomes.append(outcome)
                progress.done(outcome)
    except KeyboardInterrupt:
        interrupted = True
    status = _conclude(args, jobs, outcomes, command)
    if interrupted:
        return _interrupted(jobs, start)
    return status


def _tell(line: str) -> None:
    """Print a line on stderr; if nobody reads it, the work goes on."""
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)


def _jobs(args: argparse.Namespace, command: str) -> "tuple[list[Job], str]":
    """Return what is to be done, with all that can be said against it said before the work, and which box it is."""
    from boxcal.calib.fleet.find_target import find_target
    from boxcal.calib.fleet.plan import check_options, plan
    from boxcal.calib.fleet.store import check_folder

    check_options(args)
    found = find_target(args.target, args.logs)
    check_folder(args.out, found.target)
    settings = _settings(args, found.target)
    jobs = plan(
        args.logs, target=found.target, settings=settings, out=args.out, command=command, same_robot=args.same_robot
    )
    return jobs, found.said


def _interrupted(jobs: "list[Job]", start: float) -> int:
    from boxcal.calib.fleet.store import written_since

    done = written_since(jobs, start)
    names = f" ({', '.join(done)})" if done else ""
    _tell(
        f"fleet-calibrate: interrupted; {len(done)} of {len(jobs)} robots were finished and are kept{names}; "
        "give the same command with --resume for the rest"
    )
    return INTERRUPTED


def _conclude(args: argparse.Namespace, jobs: "list[Job]", outcomes: "list[Outcome]", command: str) -> int:
    """Write what is about the whole folder, then print results, errors against truth and failures."""
    from boxcal.calib.fleet.store import natural

    outcomes.sort(key=lambda o: natural(o.job.robot))
    whole = _write_fleet(args, jobs[0], outcomes, command)
    good = [o.calibration for o in outcomes if o.calibration is not None]
    failed = [o for o in outcomes if o.calibration is None]
    if good:
        _print_results(args, good, [o.job.robot for o in failed])
    if args.truth:
        whole = _print_errors(outcomes) and whole
    for o in failed:
        _tell(f"fleet-calibrate: {o.error}")
        if o.details:
            _tell(o.details)
    if failed:
        _tell(f"fleet-calibrate: {len(failed)} of {len(outcomes)} robots failed")
    if failed or not whole:
        return 1
    not_good = [c.robot for c in good if c.verdict is None or c.verdict.level != "good"]
    if args.strict and not_good:
        _tell(f"fleet-calibrate: not good: {', '.join(not_good)} (--strict)")
        return NOT_GOOD
    return 0


def _write_fleet(args: argparse.Namespace, job: "Job", outcomes: "list[Outcome]", command: str) -> bool:
    """Write what is about all robots of the folder; tell whether that worked."""
    from boxcal.calib.fleet.store import read_folder
    from boxcal.calib.fleet.write import write_fleet
    from boxcal.target.errors import BoxcalError

    try:
        members = read_folder(args.out, job.target, outcomes)
        write_fleet(args.out, members, job.target, command=command, report=job.settings.report)
    except BoxcalError as error:
        _tell(f"fleet-calibrate: {error}")
        return False
    except OSError as error:
        _tell(f"fleet-calibrate: {args.out}: {error.strerror or error}; give another folder with --out")
        return False
    return True


def _print_results(args: argparse.Namespace, results: "list[Calibration]", failed: list[str]) -> None:
    from boxcal.calib.console.judgement import judgement, own_notes
    from boxcal.calib.console.tables import results_tables, verdict_table

    print(verdict_table(results, failed=failed) + "\n")
    for c in results:
        if c.verdict is not None:
            print(judgement(c.robot, c.verdict))
            for note in own_notes(c):
                print(note)
    print("\n" + results_tables(results))
    print(f"\nwritten: {args.out}/<robot>/calibration.json and files for ROS and Kalibr")
    print(f"fleet:   {args.out}/fleet.csv, {args.out}/fleet.json")
    if (args.out / "fleet.html").exists():
        print(f"reports: {args.out}/fleet.html, {args.out}/<robot>/report.html")


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
                _tell(f"fleet-calibrate: {error}")
    if errors:
        print("\n" + errors_table(errors))
    return whole


if __name__ == "__main__":
    sys.exit(main())
