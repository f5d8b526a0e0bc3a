"""Cameras in a robot's description: mount link and optical frame of each, as URDF and as a xacro macro."""

from boxcal.calib.exports.names import Names
from boxcal.calib.exports.rig import named_cameras
from boxcal.calib.exports.text import heading, ros_name, sigma_line, usage, xml_comment
from boxcal.calib.geometry.euler import OPTICAL_RPY, link_pose, roll_pitch_yaw
from boxcal.calib.results.calibration import Calibration
from boxcal.target.arrays import Array


def urdf(calibration: Calibration, names: Names | None = None) -> str:
    """Return a URDF that loads as it is: the base on the floor, and each camera's link and optical frame."""
    names = names or Names()
    return (
        f'<?xml version="1.0"?>\n{_comment(calibration, names)}<robot name="{ros_name(calibration.robot)}">\n'
        f'  <link name="{names.base}"/>\n{_cameras(calibration, names, names.base, "", "  ")}</robot>\n'
    )


def xacro(calibration: Calibration, names: Names | None = None) -> str:
    """Return a xacro file whose macro ``calibrated_camera`` puts the camera on a robot that has a base link."""
    names = names or Names()
    include = 'in the robot\'s xacro: <xacro:include filename="camera.urdf.xacro"/> <xacro:calibrated_camera/>'
    lines = [
        "macro calibrated_camera",
        *usage(calibration, include),
        f"parent: a link on the floor below the middle of the axle ({names.base});",
        "prefix: for several cameras",
    ]
    arguments = "<!-- " + "\n     ".join(lines) + " -->\n"
    return (
        f'<?xml version="1.0"?>\n{_comment(calibration, names)}{arguments}<robot xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
        f'  <xacro:macro name="calibrated_camera" params="parent:={names.base} prefix:=\'\'">\n'
        f"{_cameras(calibration, names, '${parent}', '${prefix}', '    ')}  </xacro:macro>\n</robot>\n"
    )


def _comment(calibration: Calibration, names: Names) -> str:
    lines = [
        *heading(calibration, "where the camera sits"),
        f"m and rad; {names.base}: on the floor below the middle of the axle, x forward, y left, z up",
        f"{names.link}: at the optical centre, x along the view, y left, z up",
        f"{names.optical}: x right, y down, z forward",
        "rpy: R = Rz(yaw) Ry(pitch) Rx(roll); a joint's origin maps points of its child to its parent",
        sigma_line(calibration, ("rx", "ry", "rz", "tx", "ty", "tz")),
    ]
    return xml_comment(lines)


def _cameras(calibration: Calibration, names: Names, parent: str, prefix: str, indent: str) -> str:
    """Return the links and joints of all cameras."""
    return "".join(
        _links(camera.calibration.T_body_cam, parent, prefix, indent, camera.names)
        for camera in named_cameras(calibration, names)
    )


def _links(T_body_cam: Array, parent: str, prefix: str, indent: str, names: Names) -> str:
    T = link_pose(T_body_cam)
    link, optical, joint = (f"{prefix}{name}" for name in (names.link, names.optical, names.joint))
    mount = _joint(f"{joint}_joint", parent, link, T[:3, 3], roll_pitch_yaw(T[:3, :3]))
    turn = _joint(f"{joint}_optical_joint", link, optical, (0.0, 0.0, 0.0), OPTICAL_RPY)
    lines = [f'<link name="{link}"/>', *mount, f'<link name="{optical}"/>', *turn]
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
