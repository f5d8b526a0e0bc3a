"""All files that one robot's calibration drops into other programs."""

from collections.abc import Mapping

from boxcal.calib.exports.gazebo import gazebo_xacro
from boxcal.calib.exports.kalibr import camchain, camchain_missing
from boxcal.calib.exports.names import Names
from boxcal.calib.exports.opencv import opencv_yaml
from boxcal.calib.exports.ros_amcl import amcl_yaml
from boxcal.calib.exports.ros_camera_info import camera_info
from boxcal.calib.exports.ros_diff_drive import diff_drive_yaml
from boxcal.calib.exports.ros_launch import launch_xml
from boxcal.calib.exports.ros_robot_localization import robot_localization_yaml
from boxcal.calib.exports.ros_static_transform import static_transform
from boxcal.calib.exports.ros_turtlebot3 import turtlebot3_yaml
from boxcal.calib.exports.ros_urdf import urdf, xacro
from boxcal.calib.exports.stereo import stereo_files
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Nominal

STALE_FILES = (
    *("camchain.yaml", "camchain-missing.txt", "nav2_amcl.yaml", "robot_localization.yaml"),
    *("report.html", "FAILED.txt"),
)
"""What an earlier calibration of a robot may have left that this one does not write."""


def exports(
    calibration: Calibration, nominal: Nominal | None = None, names: Names | None = None
) -> Mapping[str, bytes]:
    """Return file name -> content, for one robot's folder.

    Parameters
    ----------
    calibration
        The robot's.
    nominal
        What its data sheet says of the wheels; diff_drive_controller's multipliers are against it.
    names
        Of frames, topic and controller; ROS' usual ones if None.
    """
    files = {
        "camera_info.yaml": camera_info(calibration),
        "camera.urdf": urdf(calibration, names),
        "camera.urdf.xacro": xacro(calibration, names),
        "static_transform.sh": static_transform(calibration, names),
        "diff_drive_controller.yaml": diff_drive_yaml(calibration, nominal, names),
        "calibrated.launch.xml": launch_xml(calibration, names),
        "turtlebot3_node.yaml": turtlebot3_yaml(calibration),
        "nav2_amcl.yaml": amcl_yaml(calibration),
        "robot_localization.yaml": robot_localization_yaml(calibration, names),
        "gazebo_diff_drive.xacro": gazebo_xacro(calibration, names),
        "opencv_camera.yaml": opencv_yaml(calibration),
        "camchain.yaml": camchain(calibration, names),
        "camchain-missing.txt": camchain_missing(calibration),
        **stereo_files(calibration),
    }
    return {name: text.encode() for name, text in files.items() if text is not None}
