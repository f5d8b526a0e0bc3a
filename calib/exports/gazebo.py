"""``gazebo_diff_drive.xacro``: the wheels as Gazebo's DiffDrive takes them."""

from boxcal.calib.exports.names import Names
from boxcal.calib.exports.text import heading, ros_name, sigma_line, usage, xml_comment
from boxcal.calib.results.calibration import Calibration


def gazebo_xacro(calibration: Calibration, names: Names | None = None) -> str:
    """Return a xacro file whose macro ``calibrated_diff_drive`` gives a simulated robot the calibrated wheels.

    The plugin knows one radius; the properties ``calibrated_wheel_radius_left`` and ``calibrated_wheel_radius_right``
    are for the wheels' own links, so that the simulated robot drives as the real one does.
    """
    names, w = names or Names(), calibration.wheels
    lines = [
        *heading(calibration, "wheels for Gazebo's DiffDrive (gz-sim)"),
        "m; wheel_separation is between the wheels' contact points; the plugin takes one radius, the mean",
        sigma_line(calibration, ("rR", "rL", "b")),
        *usage(
            calibration,
            "include this file in the robot's xacro and call the macro calibrated_diff_drive; the properties are for",
            "the robot's own links: with them the simulated robot drives as the real one does",
        ),
    ]
    values = {"separation": w.b, "radius_left": w.rL, "radius_right": w.rR}
    properties = "".join(
        f'  <xacro:property name="calibrated_wheel_{name}" value="{value!r}"/>\n' for name, value in values.items()
    )
    return (
        f'<?xml version="1.0"?>\n{xml_comment(lines)}'
        f'<robot name="{ros_name(calibration.robot)}" xmlns:xacro="http://www.ros.org/wiki/xacro">\n{properties}'
        f'  <xacro:macro name="calibrated_diff_drive" params="left_joint:={names.left_joint} '
        f"right_joint:={names.right_joint} topic:=cmd_vel odom_topic:=odom frame_id:=odom "
        f'child_frame_id:={names.base}">\n'
        "    <gazebo>\n"
        '      <plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">\n'
        "        <left_joint>${left_joint}</left_joint>\n"
        "        <right_joint>${right_joint}</right_joint>\n"
        f"        <wheel_separation>{w.b!r}</wheel_separation>\n"
        f"        <wheel_radius>{(w.rR + w.rL) / 2!r}</wheel_radius>\n"
        "        <topic>${topic}</topic>\n"
        "        <odom_topic>${odom_topic}</odom_topic>\n"
        "        <frame_id>${frame_id}</frame_id>\n"
        "        <child_frame_id>${child_frame_id}</child_frame_id>\n"
        "      </plugin>\n"
        "    </gazebo>\n"
        "  </xacro:macro>\n"
        "</robot>\n"
    )
