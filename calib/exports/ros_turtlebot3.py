"""``turtlebot3_node.yaml``: the wheels as the driver of TurtleBot3 takes them.

That driver knows one radius for both wheels: what they differ by stays in its odometry, and the file says how much.
"""

from math import degrees

from boxcal.calib.exports.text import comment, heading, number, sigma_line, usage
from boxcal.calib.results.calibration import Calibration


def turtlebot3_yaml(calibration: Calibration) -> str:
    """Return a ROS 2 parameter file for ``turtlebot3_node``, in any namespace."""
    w = calibration.wheels
    drift = degrees((w.rR - w.rL) / ((w.rR + w.rL) / 2) / w.b)
    lines = [
        *heading(calibration, "wheels for turtlebot3_node"),
        "m; separation is between the wheels' contact points; one radius serves both wheels, the mean of theirs,",
        f"which leaves {drift:+.2f} deg a metre ahead in the odometry (diff_drive_controller.yaml leaves nothing)",
        sigma_line(calibration, ("rR", "rL", "b")),
        *usage(calibration, "give this file after the driver's own (burger.yaml, waffle_pi.yaml)"),
    ]
    return comment(lines) + (
        "/**:\n"
        "  turtlebot3_node:\n"
        "    ros__parameters:\n"
        "      wheels:\n"
        f"        separation: {number(w.b)}\n"
        f"        radius: {number((w.rR + w.rL) / 2)}\n"
    )
