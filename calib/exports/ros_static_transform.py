"""``static_transform.sh``: the camera extrinsics as the line that publishes them in ROS 2."""

from boxcal.calib.exports.names import Names
from boxcal.calib.exports.text import comment, heading, sigma_line
from boxcal.calib.geometry.euler import quaternion
from boxcal.calib.results.calibration import Calibration


def static_transform(calibration: Calibration, names: Names | None = None) -> str:
    """Return a shell script of comments and one command; its arguments serve in a launch file as well."""
    names = names or Names()
    T = calibration.T_body_cam
    words = ["ros2 run tf2_ros static_transform_publisher"]
    words += [f"--{axis} {float(v)!r}" for axis, v in zip("xyz", T[:3, 3], strict=True)]
    words += [f"--q{axis} {v!r}" for axis, v in zip("xyzw", quaternion(T[:3, :3]), strict=True)]
    words += [f"--frame-id {names.base}", f"--child-frame-id {names.optical}"]
    lines = [
        *heading(calibration, "where the camera sits"),
        f"m; maps points of {names.optical} (x right, y down, z forward) to {names.base}",
        "(on the floor below the middle of the axle, x forward, y left, z up); quaternion x, y, z, w",
        sigma_line(calibration, ("rx", "ry", "rz", "tx", "ty", "tz")),
        "use this or the URDF, not both",
    ]
    return f"#!/bin/sh\n{comment(lines)}exec {' '.join(words)}\n"
