"""More cameras on a simulated robot: the same drive as another of its cameras sees it."""

from dataclasses import replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.drive import Drive
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel


def with_camera_at(
    robot: Robot, T_body_cam: Array, camera: CameraModel | None = None, image_size: tuple[int, int] | None = None
) -> Robot:
    """Return the robot with another of its cameras, mounted at ``T_body_cam`` (4, 4), m.

    Lens and images are the same unless others are given.

    Examples
    --------
    >>> import numpy as np
    >>> from boxcal.calib.simulate.robot import turtlebot
    >>> left = turtlebot()
    >>> T_left_right = np.eye(4)
    >>> T_left_right[0, 3] = 0.06  # 60 mm to the right
    >>> with_camera_at(left, left.T_body_cam @ T_left_right).rR == left.rR
    True
    """
    return replace(
        robot, T_body_cam=T_body_cam, camera=camera or robot.camera, image_size=image_size or robot.image_size
    )


def seen_by(drive: Drive, robot: Robot, other: Robot) -> Drive:
    """Return a drive as another camera of its robot sees it.

    Parameters
    ----------
    drive
        The drive of ``robot``.
    robot, other
        The robot with the one camera, and with the other. What happens to the camera in the drive (a knock, another
        focus) happened to the first alone.
    """
    T_cam_other = inverse(robot.T_body_cam) @ other.T_body_cam
    stops = len(drive.stop_poses)
    scene = replace(drive.scene, T_body_cam=np.tile(other.T_body_cam, (stops, 1, 1)), cameras=(other.camera,) * stops)
    unmoved = all(np.array_equal(T, robot.T_body_cam) for T in drive.scene.T_body_cam)
    at_stops = [scene.T_box_cam(j, pose) for j, pose in enumerate(drive.stop_poses)]
    return replace(drive, scene=scene, T_box_cam=drive.T_box_cam @ T_cam_other if unmoved else np.stack(at_stops))
