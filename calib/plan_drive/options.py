"""Options of ``plan-drive``, a group at a time."""

from pathlib import Path

from boxcal.command_line import CommandParser, image_size, number, whole_number

EPILOG = """\
example:
  plan-drive plan --stops 12                                     for a robot of usual size
  plan-drive plan --calibration calibration/r01/calibration.json    for a robot that was calibrated before
  plan-drive plan --urdf robot.urdf --field-of-view-deg 60 --floor -1 -2 3 2
  plan-drive next --after calibration/r01                        the stops that help this calibration most

OUT gets plan.svg (a picture), floor-plan.pdf (to tape the stops to the floor), waypoints.yaml (for Nav2) and plan.json.
x and y are in the box's frame: origin at the middle of its base, x out of face 0, y out of face 1.

exit status: 0 the goals are reached, 1 they are not (the best drive is written), 2 nothing could be planned
"""


def parser() -> CommandParser:
    """Return the parser of ``plan-drive``."""
    made = CommandParser(
        "plan-drive",
        usage="plan-drive OUT [options]",
        description="Plan where to drive: the fewest stops around the box that calibrate a robot well enough.",
        epilog=EPILOG,
    )
    made.add_argument("out", type=Path, metavar="OUT", help="folder for the plan")
    made.add_argument("--target", type=Path, metavar="FILE", help="target.json of the box (the default box if none)")
    made.add_argument("--stops", type=whole_number(1, 40), metavar="N", help="so many stops; as few as do if not given")
    made.add_argument("--seed", type=whole_number(0, 2**31), default=0, metavar="N", help="settles what is tried (0)")
    _robot(made)
    _goals(made)
    _floor(made)
    _noise(made)
    return made


def _robot(made: CommandParser) -> None:
    robot = made.add_argument_group("the robot", "A robot of usual size if nothing is given.")
    source = robot.add_mutually_exclusive_group()
    source.add_argument("--calibration", type=Path, metavar="FILE", help="its calibration.json of before")
    source.add_argument("--fleet", type=Path, metavar="FOLDER", help="calibrated robots: plan for the typical one")
    source.add_argument("--urdf", type=Path, metavar="FILE", help="its URDF: wheels and camera link")
    source.add_argument(
        "--after", type=Path, metavar="FOLDER", help="its calibration in progress: the next stops (N: --stops, 3)"
    )
    robot.add_argument("--camera-link", metavar="NAME", help="optical link of the camera in the URDF")
    robot.add_argument("--wheel-radius-mm", type=number(1, 5000), metavar="MM")
    robot.add_argument("--wheel-separation-mm", type=number(10, 10000), metavar="MM")
    robot.add_argument("--image-size", type=image_size, metavar="WxH", help="px")
    robot.add_argument("--field-of-view-deg", type=number(10, 150), metavar="DEG", help="across the image")
    robot.add_argument(
        "--camera-at-mm",
        type=number(-10000, 10000),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="forward, left and up of the floor below the axle's middle",
    )
    robot.add_argument("--camera-yaw-deg", type=number(-180, 180), metavar="DEG", help="to the left of ahead")
    robot.add_argument("--camera-pitch-deg", type=number(-90, 90), metavar="DEG", help="down from level")
    robot.add_argument(
        "--sure",
        action="store_true",
        help="take these dimensions as right; else the drive also does where focal length, direction and place of the "
        "camera are off by 8 %%, 3 deg and 15 mm",
    )


def _goals(made: CommandParser) -> None:
    goals = made.add_argument_group("goals", "Standard deviations; the defaults are what the verdict calls good.")
    goals.add_argument("--straight-cm", type=number(0.01, 1000), metavar="CM", help="position after 10 m (20)")
    goals.add_argument("--turn-deg", type=number(0.001, 90), metavar="DEG", help="heading after a whole turn (1)")
    goals.add_argument("--camera-deg", type=number(0.0001, 10), metavar="DEG", help="direction of the camera (0.2)")
    goals.add_argument("--place-mm", type=number(0.001, 1000), metavar="MM", help="place of the camera (5)")
    goals.add_argument("--pixel", type=number(0.001, 100), metavar="PX", help="image of a point 1 m away (2)")
    goals.add_argument(
        "--criterion",
        choices=("worst", "A", "D"),
        default="worst",
        help="what of the quantities over their goals is small: the worst, their mean square, their product (worst)",
    )


def _floor(made: CommandParser) -> None:
    floor = made.add_argument_group("the floor", "In the box's frame, m.")
    floor.add_argument("--floor", type=number(-100, 100), nargs=4, metavar=("X0", "Y0", "X1", "Y1"))
    floor.add_argument(
        "--obstacle",
        type=number(-100, 100),
        nargs=4,
        action="append",
        default=[],
        metavar=("X0", "Y0", "X1", "Y1"),
        help="what stands there; may be given several times",
    )
    floor.add_argument("--clearance", type=number(0, 5), default=0.15, metavar="M", help="to all that stands (0.15)")
    floor.add_argument("--nearest", type=number(0.05, 50), metavar="M", help="of the camera to the box's middle")
    floor.add_argument("--farthest", type=number(0.05, 50), metavar="M")
    floor.add_argument(
        "--turning-radius", type=number(0, 20), default=0.0, metavar="M", help="0 for robots that turn on the spot (0)"
    )


def _noise(made: CommandParser) -> None:
    noise = made.add_argument_group("what to expect")
    noise.add_argument("--slip", type=number(0, 50), default=0.5, metavar="MM", help="of a wheel after 1 m (0.5)")
    noise.add_argument("--corner-px", type=number(0.001, 5), default=0.05, metavar="PX", help="of a corner (0.05)")
    noise.add_argument("--encoder-step-deg", type=number(0, 30), default=0.1302, metavar="DEG", help="(0.1302)")
