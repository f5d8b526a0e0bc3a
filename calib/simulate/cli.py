"""The command ``simulate-fleet``: made-up robots drive around the box; their logs and the truth come out."""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.command_line import CommandParser, image_size, number, whole_number

if TYPE_CHECKING:
    from boxcal.calib.simulate.fleet import Job
    from boxcal.calib.simulate.more_cameras import OwnSettings

_DESCRIPTION = """\
example:
  simulate-fleet robots --robots 3 --stops 10      robots/r01.mcap, robots/r01.truth.json, robots/r02.mcap, ...
  fleet-calibrate robots/*.mcap --truth            calibrate them and compare with the truth

Drive made-up robots around the box. Each has its own wheels, camera and mounting. Its log is an ordinary ROS 2 MCAP
file (sensor_msgs: JointState, and CompressedImage or Image); beside it lies the truth, as JSON. Existing files of
the same name are replaced. The same options give the same files, to the byte, with the same versions of the libraries.
"""
_EPILOG = "exit status: 0 all robots simulated, 1 some robot failed (its reason is printed), 2 wrong usage"


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``simulate-fleet``; return 0 if all logs were written, 1 if some could not be (argparse exits with 2)."""
    parser = _parser()
    args = parser.parse_args(argv)
    for name in ("camera_clock_offsets_ms", "camera_image_sizes", "camera_frames"):
        count = len(getattr(args, name))
        if count not in {0, args.cameras}:
            option = f"--{name.replace('_', '-')}"
            wanted = "one value" if args.cameras == 1 else f"one value for each of {args.cameras} cameras"
            parser.error(f"{option}: {wanted} is needed, and {count} {'is' if count == 1 else 'are'} given")

    # What is heavy comes after --help has answered.
    from boxcal.calib.simulate.fleet import simulate_fleet
    from boxcal.target.errors import BoxcalError

    try:
        jobs = _jobs(args)
        args.folder.mkdir(parents=True, exist_ok=True)
    except BoxcalError as error:
        return _failed(str(error))
    except OSError as error:
        return _failed(f"{args.folder}: cannot be made ({error.strerror or error}); name another FOLDER")
    failed = 0
    for k, done in enumerate(simulate_fleet(jobs, args.jobs)):
        failed += bool(done.error)
        if done.error:
            _failed(done.error)
        else:
            print(f"{done.log}: {done.stops} stops, {done.frames} pictures, {done.duration_s:.0f} s", flush=True)
        print(f"simulate-fleet: {k + 1} of {len(jobs)} robots done", file=sys.stderr)
    return 1 if failed else 0


def _jobs(args: argparse.Namespace) -> "list[Job]":
    """Return what each robot is to do."""
    from boxcal.calib.simulate.asked_faults import AskedFaults, named_violation
    from boxcal.calib.simulate.drive import DriveOptions
    from boxcal.calib.simulate.fleet import Job
    from boxcal.calib.simulate.recorder import RecordOptions
    from boxcal.target.box import make_target
    from boxcal.target.camera.camera_model import CameraKind
    from boxcal.target.files.target_json import load_target

    target = load_target(args.target) if args.target else make_target()
    for name, _ in args.violation:
        named_violation(name)
    drive = DriveOptions(
        stops=args.stops,
        encoder_step=radians(args.encoder_step_deg),
        joint_period_s=1 / args.joint_rate_hz,
        slip=args.slip * 1e-3,
    )
    record = RecordOptions(
        frames=args.frames,
        moving_frames=args.moving_frames,
        image=args.image,
        quality=args.quality,
        compression=args.compression,
        exposure_s=args.exposure_ms * 1e-3,
        late_s=args.clock_offset_ms * 1e-3,
        clock_rate=args.clock_rate_ppm * 1e-6,
        clock_jump_s=args.clock_jump_ms * 1e-3,
        wheels_jump_s=args.wheels_clock_jump_ms * 1e-3,
        jitter_s=args.jitter_ms * 1e-3,
        readout_s=args.rolling_shutter_ms * 1e-3,
        sensor=replace(RecordOptions().sensor, noise=args.noise, psf_px=args.blur),
    )
    faults = AskedFaults(
        hand_made=args.hand_made,
        lean=None if args.lean_deg is None else radians(args.lean_deg),
        tilt=None if args.tilt_deg is None else radians(args.tilt_deg),
        violations=tuple(args.violation),
    )
    own = _own_settings(args)
    return [
        Job(
            folder=args.folder,
            number=k + 1,
            seed=args.seed,
            target=target,
            drive=drive,
            record=record,
            image_size=args.image_size,
            kind=CameraKind(args.camera),
            faults=faults,
            cameras=args.cameras,
            rig=args.rig,
            own=own,
        )
        for k in range(args.robots)
    ]


def _own_settings(args: argparse.Namespace) -> "OwnSettings":
    """Return what each camera has of its own."""
    from boxcal.calib.simulate.more_cameras import OwnSettings

    return OwnSettings(
        late_s=tuple(1e-3 * late for late in args.camera_clock_offsets_ms),
        image_sizes=tuple(args.camera_image_sizes),
        frames=tuple(args.camera_frames),
    )


def _failed(message: str) -> int:
    print(f"simulate-fleet: {message}", file=sys.stderr)
    return 1


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        "simulate-fleet",
        usage="simulate-fleet FOLDER [options]",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )

    def add(name: str, kind: Callable[[str], object], default: object, meaning: str, metavar: str = "N") -> None:
        shown = "x".join(map(str, default)) if isinstance(default, tuple) else default
        parser.add_argument(name, type=kind, default=default, metavar=metavar, help=f"{meaning} (default: {shown})")

    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where logs and truths go")
    parser.add_argument("--target", type=Path, metavar="FILE", help="target.json of the box (the default box if none)")
    add("--robots", whole_number(1, 999), 3, "how many")
    add("--stops", whole_number(3, 1000), 10, "stops of each")
    add("--seed", whole_number(0, 2**63 - 1), 0, "settles all that is drawn at random")
    add("--jobs", whole_number(1, 256), min(os.cpu_count() or 1, 8), "robots simulated side by side")
    add("--encoder-step-deg", number(0, 30), 0.1302, "encoders round down to a multiple of it; 0 is exact", "DEG")
    add("--joint-rate-hz", number(1, 1000), 50.0, "wheel samples a second", "HZ")
    add(
        "--slip",
        number(0, 50),
        0.2,
        "error of each wheel after 1 m; grows with the root of the distance",
        "MM",
    )
    add("--frames", whole_number(1, 1000), 3, "pictures at each stop")
    add("--moving-frames", whole_number(0, 1000), 2, "pictures between two stops, blurred by the motion")
    add("--image-size", image_size, (640, 480), "of the pictures, px", "WxH")
    add("--noise", number(0, 100), 1.5, "standard deviation of the pictures' noise, grey levels", "GREY")
    add("--blur", number(0, 50), 0.6, "standard deviation of the lens's blur, px", "PX")
    parser.add_argument("--image", choices=("jpeg", "png", "raw"), default="jpeg", help="pictures (default: jpeg)")
    _cameras(parser)
    _clock(parser)
    add("--quality", whole_number(1, 100), 90, "of JPEG")
    parser.add_argument(
        "--camera",
        choices=("radial", "brown", "rational", "fisheye"),
        default="radial",
        help="camera model of the robots (default: radial, the paper's)",
    )
    _wrong(parser)
    parser.add_argument(
        "--compression", choices=("none", "lz4", "zstd"), default="zstd", help="of the log (default: zstd)"
    )
    return parser


def _cameras(parser: argparse.ArgumentParser) -> None:
    several = parser.add_argument_group(
        "several cameras",
        "What has a value for each camera is in the order of the cameras; else each has a clock 4 ms later and one "
        "picture a stop more than the one before, and images of one size.",
    )
    several.add_argument(
        "--cameras",
        type=whole_number(1, 4),
        default=1,
        metavar="N",
        help="cameras of each robot: /front/image_raw, /rear/image_raw ... (default: 1)",
    )
    several.add_argument(
        "--rig",
        choices=("rear", "stereo", "wide"),
        default="rear",
        help="the second camera: behind, 60 mm beside the first, or a fisheye beside it (default: rear)",
    )
    for name, kind, metavar, meaning in (
        ("--camera-clock-offsets-ms", number(-10_000, 10_000), "MS", "each camera's, instead of --clock-offset-ms"),
        ("--camera-image-sizes", image_size, "WxH", "each camera's, instead of --image-size"),
        ("--camera-frames", whole_number(1, 1000), "N", "each camera's pictures at each stop, instead of --frames"),
    ):
        several.add_argument(name, type=kind, nargs="+", default=(), metavar=metavar, help=meaning)


def _clock(parser: argparse.ArgumentParser) -> None:
    clock = parser.add_argument_group("clock and shutter of the camera")
    for name, kind, default, meaning in (
        ("--clock-offset-ms", number(-10_000, 10_000), 0.0, "stamps less the middle of the exposure, half way"),
        ("--clock-rate-ppm", number(-10_000, 10_000), 0.0, "how fast its clock runs against the wheels'"),
        ("--clock-jump-ms", number(-10_000, 10_000), 0.0, "how much later stamps are from half way on"),
        ("--wheels-clock-jump-ms", number(-10_000, 10_000), 0.0, "how much later wheels are stamped from half way on"),
        ("--jitter-ms", number(0, 1000), 0.0, "standard deviation of each stamp's own error"),
        ("--exposure-ms", number(0.01, 1000), 8.0, "how long the shutter is open"),
        ("--rolling-shutter-ms", number(0, 1000), 0.0, "from the first row to the last; 0 sees all rows at once"),
    ):
        unit = name.rpartition("-")[2].upper()
        clock.add_argument(name, type=kind, default=default, metavar=unit, help=f"{meaning} (default: {default:g})")


def _wrong(parser: argparse.ArgumentParser) -> None:
    wrong = parser.add_argument_group("what is not exact", "By default all is, but for slip and noise.")
    wrong.add_argument(
        "--hand-made",
        action="store_true",
        help="box, print, floor and lens as a careful user has them: sheets and faces off by 0.3 mm and 0.15 deg, "
        "print by 0.07 %%, bow 0.3 mm, floor tilted by 0.3 deg, lean 0.05 deg a stop, a lens of four coefficients",
    )
    wrong.add_argument(
        "--lean-deg", type=number(0, 10), metavar="DEG", help="roll and pitch from stop to stop, standard deviation"
    )
    wrong.add_argument(
        "--tilt-deg", type=number(0, 10), metavar="DEG", help="floor against the box's base, standard deviation"
    )
    wrong.add_argument(
        "--violation",
        type=_violation,
        action="append",
        default=[],
        metavar="NAME[=SIZE]",
        help="one of the catalogue of --list-violations, such as 'box moved=6'; may be given several times",
    )
    wrong.add_argument("--list-violations", action=_ListViolations, help="names, sizes and units; then exit")


class _ListViolations(argparse.Action):
    """Print the catalogue and exit."""

    def __init__(self, option_strings: list[str], dest: str, help: str | None = None) -> None:  # noqa: A002
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from boxcal.calib.simulate.violations import HARMLESS, VIOLATIONS

        for violation in (*VIOLATIONS, *HARMLESS):
            sizes = ", ".join(f"{size:g}" for size in violation.sizes if size)
            print(f"{violation.name:<28}{sizes:>16} {violation.unit}".rstrip())
        parser.exit()


def _violation(text: str) -> tuple[str, float | None]:
    name, given, size = text.partition("=")
    return name.strip(), number(0, 1e6)(size) if given else None


if __name__ == "__main__":
    sys.exit(main())
