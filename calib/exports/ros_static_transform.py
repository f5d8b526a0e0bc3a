"""``static_transform.sh``: the mounting as the line that publishes it in ROS 2."""

from boxcal.calib.exports.ros_urdf import BODY, OPTICAL
from boxcal.calib.exports.text import comment, heading, sigma_line
from boxcal.calib.geometry.euler import quaternion
from boxcal.calib.results.calibration import Calibration


def static_transform(calibration: Calibration) -> str:
    """Return a shell script of comments and one command; its arguments serve in a launch file as well."""
    T = calibration.T_body_cam
    words = ["ros2 run tf2_ros static_transform_publisher"]
    words += [f"--{axis} {float(v)!r}" for axis, v in zip("xyz", T[:3, 3], strict=True)]
    words += [f"--q{axis} {v!r}" for axis, v in zip("xyzw", quaternion(T[:3, :3]), strict=True)]
    words += [f"--frame-id {BODY}", f"--child-frame-id {OPTICAL}"]
    lines = [
        heading(calibration, "where the camera sits"),
        f"m; maps points of {OPTICAL} (x right, y down, z forward) to {BODY}",
        "(on the floor below the middle of the axle, x forward, y left, z up); quaternion x, y, z, w",
        sigma_line(calibration, ("rx", "ry", "rz", "tx", "ty", "tz")),
        "use this or the URDF, not both",
    ]
    return f"{comment(lines)}{' '.join(words)}\n"
