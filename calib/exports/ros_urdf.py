"""The camera in a robot's description: its mount link and its optical frame, as URDF and as a xacro macro."""

from boxcal.calib.exports.text import heading, in_xml_comment, ros_name, sigma_line
from boxcal.calib.geometry.euler import OPTICAL_RPY, link_pose, roll_pitch_yaw
from boxcal.calib.results.calibration import Calibration
from boxcal.target.arrays import Array

BODY = "base_footprint"
LINK = "camera_link"
OPTICAL = "camera_optical_frame"


def urdf(calibration: Calibration) -> str:
    """Return a URDF of three links that loads as it is: ``base_footprint``, ``camera_link``, the optical frame."""
    return (
        f'<?xml version="1.0"?>\n{_comment(calibration)}<robot name="{ros_name(calibration.robot)}">\n'
        f'  <link name="{BODY}"/>\n{_links(calibration.T_body_cam, BODY, "", "  ")}</robot>\n'
    )


def xacro(calibration: Calibration) -> str:
    """Return a xacro file whose macro ``calibrated_camera`` puts the camera on a robot that has a base link."""
    usage = (
        f'<!-- in the robot\'s xacro: <xacro:include filename="camera.urdf.xacro"/> <xacro:calibrated_camera/>\n'
        f"     parent: a link on the floor below the middle of the axle ({BODY}); prefix: for several cameras -->\n"
    )
    return (
        f'<?xml version="1.0"?>\n{_comment(calibration)}{usage}<robot xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
        f'  <xacro:macro name="calibrated_camera" params="parent:={BODY} prefix:=\'\'">\n'
        f"{_links(calibration.T_body_cam, '${parent}', '${prefix}', '    ')}  </xacro:macro>\n</robot>\n"
    )


def _comment(calibration: Calibration) -> str:
    lines = [
        heading(calibration, "where the camera sits"),
        f"m and rad; {BODY}: on the floor below the middle of the axle, x forward, y left, z up",
        f"{LINK}: at the optical centre, x along the view, y left, z up; {OPTICAL}: x right, y down, z forward",
        "rpy: R = Rz(yaw) Ry(pitch) Rx(roll); a joint's origin maps points of its child to its parent",
        sigma_line(calibration, ("rx", "ry", "rz", "tx", "ty", "tz")),
    ]
    return "<!-- " + "\n     ".join(in_xml_comment(line) for line in lines) + " -->\n"


def _links(T_body_cam: Array, parent: str, prefix: str, indent: str) -> str:
    T = link_pose(T_body_cam)
    mount = _joint(f"{prefix}camera_joint", parent, f"{prefix}{LINK}", T[:3, 3], roll_pitch_yaw(T[:3, :3]))
    optical = _joint(
        f"{prefix}camera_optical_joint", f"{prefix}{LINK}", f"{prefix}{OPTICAL}", (0.0, 0.0, 0.0), OPTICAL_RPY
    )
    lines = [f'<link name="{prefix}{LINK}"/>', *mount, f'<link name="{prefix}{OPTICAL}"/>', *optical]
    return "".join(f"{indent}{line}\n" for line in lines)


def _joint(
    name: str, parent: str, child: str, xyz: Array | tuple[float, ...], rpy: tuple[float, float, float]
) -> list[str]:
    return [
        f'<joint name="{name}" type="fixed">',
        f'  <parent link="{parent}"/>',
        f'  <child link="{child}"/>',
        f'  <origin xyz="{_triple(xyz)}" rpy="{_triple(rpy)}"/>',
        "</joint>",
    ]


def _triple(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)
