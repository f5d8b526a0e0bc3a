"""``calibrated.launch.xml``: one ROS 2 launch file that puts a calibration on its robot."""

from boxcal.calib.exports.names import Names
from boxcal.calib.exports.text import heading, sigma_line, usage, xml_comment
from boxcal.calib.geometry.euler import quaternion
from boxcal.calib.results.calibration import Calibration


def launch_xml(calibration: Calibration, names: Names | None = None) -> str:
    """Return a launch file: the camera's frame in TF, and the wheels' controller with the calibrated parameters.

    ``prefix`` goes before both frames, ``namespace`` is the nodes', so that two robots' files can run side by side. The
    controller is started only where ``start_controller`` asks for it, with the robot's own file before ours.
    """
    names = names or Names()
    T = calibration.T_body_cam
    place = [f"--{axis} {float(v)!r}" for axis, v in zip("xyz", T[:3, 3], strict=True)]
    place += [f"--q{axis} {v!r}" for axis, v in zip("xyzw", quaternion(T[:3, :3]), strict=True)]
    frames = f"--frame-id $(var prefix){names.bare_base} --child-frame-id $(var prefix){names.bare_optical}"
    lines = [
        *heading(calibration, "its calibration, launched"),
        *usage(
            calibration,
            "ros2 launch calibrated.launch.xml prefix:=r01_ namespace:=r01",
            "start_controller:=true parameters:=/path/to/own.yaml also starts the wheels' controller (Jazzy and later)",
        ),
        "m; maps points of the camera (x right, y down, z forward) to the base (x forward, y left, z up)",
        sigma_line(calibration, ("rx", "ry", "rz", "tx", "ty", "tz")),
        "leave it out where the robot's description holds the camera (camera.urdf.xacro)",
    ]
    return (
        f'<?xml version="1.0"?>\n{xml_comment(lines)}<launch>\n'
        f'  <arg name="prefix" default="{names.prefix}" description="before the names of frames"/>\n'
        '  <arg name="namespace" default="" description="of the nodes"/>\n'
        f'  <arg name="controller" default="{names.controller}" description="node that drives the wheels"/>\n'
        '  <arg name="start_controller" default="false" description="whether it is started here"/>\n'
        '  <arg name="parameters" default="" description="its own parameter file, given before ours"/>\n'
        '  <node pkg="tf2_ros" exec="static_transform_publisher" name="calibrated_camera"\n'
        '        namespace="$(var namespace)"\n'
        f'        args="{" ".join(place)} {frames}"/>\n'
        '  <node pkg="controller_manager" exec="spawner" name="calibrated_wheels" namespace="$(var namespace)"\n'
        '        args="$(var controller) --param-file $(var parameters) --param-file '
        '$(dirname)/diff_drive_controller.yaml"\n'
        '        if="$(var start_controller)"/>\n'
        "</launch>\n"
    )
