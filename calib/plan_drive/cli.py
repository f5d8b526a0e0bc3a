"""The command ``plan-drive``."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.calib.plan_drive.options import parser

if TYPE_CHECKING:
    from boxcal.calib.planning.floor import Floor
    from boxcal.calib.planning.goal import Goal
    from boxcal.calib.simulate.robot import Robot
    from boxcal.target.box import Target

_NEXT = 3
_MAX_URDF_BYTES = 16 << 20


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``plan-drive``; return 0 if the goals are reached, 1 if not, 2 if nothing could be planned."""
    args = parser().parse_args(argv)
    from boxcal.target.errors import BoxcalError

    try:
        return _next(args) if args.after is not None else _plan(args)
    except BoxcalError as error:
        print(f"plan-drive: {error}", file=sys.stderr)
    except OSError as error:
        print(f"plan-drive: {args.out}: cannot be written ({error.strerror or error}); name another", file=sys.stderr)
    return 2


def _plan(args: argparse.Namespace) -> int:
    from math import radians

    from boxcal.calib.plan_drive.drawing import PICTURE, picture_bytes
    from boxcal.calib.plan_drive.floor_plan import FLOOR_PLAN, floor_plan_bytes
    from boxcal.calib.plan_drive.nav2 import WAYPOINTS, nav2_bytes
    from boxcal.calib.plan_drive.plan_json import PLAN, plan_bytes
    from boxcal.calib.plan_drive.text import plan_text
    from boxcal.calib.planning.assumptions import Assumptions
    from boxcal.calib.planning.baseline import baselines
    from boxcal.calib.planning.candidates import Distances
    from boxcal.calib.planning.objective import Criterion
    from boxcal.calib.planning.plan import PlanOptions, plan_drive
    from boxcal.target.files.atomic_write import write_together

    robot, others = _robots(args)
    options = PlanOptions(
        goal=_goal(args),
        stops=args.stops,
        criterion=Criterion(args.criterion),
        floor=_floor(args),
        distances=Distances(nearest=args.nearest, farthest=args.farthest),
        turning_radius=args.turning_radius,
        seed=args.seed,
    )
    assumptions = Assumptions(
        corner_px=args.corner_px, slip=args.slip * 1e-3, encoder_step=radians(args.encoder_step_deg)
    )
    plan = plan_drive(robot, _target(args), options, assumptions, others=others)
    args.out.mkdir(parents=True, exist_ok=True)
    files = {
        PICTURE: picture_bytes(plan),
        FLOOR_PLAN: floor_plan_bytes(plan),
        WAYPOINTS: nav2_bytes(plan),
        PLAN: plan_bytes(plan),
    }
    write_together(args.out, files)
    print(plan_text(plan, baselines(plan)))
    print(f"\nwritten: {args.out}/{{{','.join(files)}}}")
    return 0 if plan.reached else 1


def _next(args: argparse.Namespace) -> int:
    from boxcal.calib.errors import CalibError
    from boxcal.calib.plan_drive.text import next_text
    from boxcal.calib.planning.next_stops import what_next
    from boxcal.calib.results.json_format import CALIBRATION, load_calibration
    from boxcal.detect.correspondences import load_correspondences

    folder = args.after.parent if args.after.name == CALIBRATION else args.after
    calibration = load_calibration(folder / CALIBRATION)
    paths = sorted(folder.glob("correspondences*.npz"), key=_number)
    if not paths:
        raise CalibError("no correspondences.npz", source=str(folder), remedy="calibrate again, into a folder")
    drives = [load_correspondences(path) for path in paths]
    stops = what_next(
        calibration,
        drives,
        _target(args),
        goal=_goal(args),
        floor=_floor(args),
        count=args.stops or _NEXT,
        seed=args.seed,
    )
    if not stops:
        raise CalibError(
            "no free path from the last stop to a place that sees the box",
            source=calibration.robot,
            remedy="give a larger --floor, or begin a new drive",
        )
    print(next_text(stops))
    return 0 if all(bar.reached for bar in stops[0].before) else 1


def _number(path: Path) -> int:
    """Return the number of a drive by the name of its file, correspondences-2.npz, say."""
    tail = path.stem.rpartition("-")[2]
    return int(tail) if tail.isascii() and tail.isdigit() else 0


def _target(args: argparse.Namespace) -> "Target":
    from boxcal.target.box import make_target
    from boxcal.target.files.target_json import load_target

    return make_target() if args.target is None else load_target(args.target)


def _robots(args: argparse.Namespace) -> "tuple[Robot, tuple[Robot, ...]]":
    """Return the robot to plan for, and what it might also be."""
    from math import radians

    from boxcal.calib.plan_drive.robots import (
        ROUGH,
        Dimensions,
        Doubt,
        calibrated_robot,
        fleet_robot,
        might_be,
        typical_robot,
        urdf_robot,
    )
    from boxcal.calib.results.json_format import load_calibration

    others: tuple[Robot, ...] = ()
    doubt = Doubt() if args.sure else ROUGH
    if args.calibration is not None:
        robot, doubt = calibrated_robot(load_calibration(args.calibration)), Doubt()
    elif args.fleet is not None:
        robot, others = fleet_robot(args.fleet)
        doubt = Doubt()
    else:
        robot = typical_robot() if args.urdf is None else urdf_robot(_urdf(args.urdf), args.urdf.name, args.camera_link)

    def of(value: float | None, unit: float) -> float | None:
        return None if value is None else value * unit

    at = args.camera_at_mm
    dimensions = Dimensions(
        wheel_radius=of(args.wheel_radius_mm, 1e-3),
        wheel_separation=of(args.wheel_separation_mm, 1e-3),
        image_size=args.image_size,
        field_of_view=of(args.field_of_view_deg, radians(1)),
        camera_at=None if at is None else (at[0] * 1e-3, at[1] * 1e-3, at[2] * 1e-3),
        yaw=of(args.camera_yaw_deg, radians(1)),
        pitch=of(args.camera_pitch_deg, radians(1)),
    )
    robot = dimensions.applied(robot)
    return robot, (*others, *might_be(robot, doubt))


def _urdf(path: Path) -> bytes:
    """Return the content of a URDF."""
    from boxcal.calib.errors import CalibError

    try:
        with path.open("rb") as file:
            content = file.read(_MAX_URDF_BYTES + 1)
    except OSError as error:
        raise CalibError(
            f"cannot be read ({error.strerror or error})", source=path.name, remedy="check --urdf"
        ) from error
    if len(content) > _MAX_URDF_BYTES:
        raise CalibError(f"more than {_MAX_URDF_BYTES} bytes", source=path.name, remedy="check --urdf")
    return content


def _goal(args: argparse.Namespace) -> "Goal":
    from dataclasses import replace
    from math import radians

    from boxcal.calib.planning.goal import Goal

    given = {
        "straight": (args.straight_cm, 1e-2),
        "turn": (args.turn_deg, radians(1)),
        "camera": (args.camera_deg, radians(1)),
        "place": (args.place_mm, 1e-3),
        "projection": (args.pixel, 1.0),
    }
    return replace(Goal(), **{name: value * unit for name, (value, unit) in given.items() if value is not None})


def _floor(args: argparse.Namespace) -> "Floor":
    from boxcal.calib.planning.floor import Floor

    bounds = Floor().bounds if args.floor is None else tuple(args.floor)
    return Floor(bounds=bounds, obstacles=tuple(tuple(o) for o in args.obstacle), clearance=args.clearance)


if __name__ == "__main__":
    sys.exit(main())
