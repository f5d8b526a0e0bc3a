"""Rotations as others write them: quaternions and roll, pitch, yaw."""

import numpy as np
from scipy.spatial.transform import Rotation

from boxcal.calib.geometry.so3_se3 import inverse, nearest_rotation, rigid
from boxcal.target.arrays import Array

OPTICAL_RPY = (-np.pi / 2, 0.0, -np.pi / 2)
"""Roll, pitch, yaw (rad) of an optical frame in its camera's link: ROS' REP 103."""
_R_LINK_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def quaternion(R: Array) -> tuple[float, float, float, float]:
    """Return (x, y, z, w), w >= 0, of a rotation."""
    x, y, z, w = Rotation.from_matrix(nearest_rotation(R)).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Return (roll, pitch, yaw), rad, with ``R = Rz(yaw) Ry(pitch) Rx(roll)``, as URDF has it.

    Roll is taken after yaw is undone, so that the three stay exact together where x points straight up or down and
    yaw and roll are not told apart.
    """
    yaw = float(np.arctan2(R[1, 0], R[0, 0]))
    c, s = np.cos(yaw), np.sin(yaw)
    M = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ R
    return float(np.arctan2(-M[1, 2], M[1, 1])), float(np.arctan2(-M[2, 0], M[0, 0])), yaw


def link_pose(T_body_cam: Array) -> Array:
    """Return ``T_body_link``, (4, 4): the camera's link (x along the view, y left, z up) at the optical centre."""
    R = nearest_rotation(T_body_cam[:3, :3])
    return rigid(R, T_body_cam[:3, 3]) @ inverse(rigid(_R_LINK_OPTICAL, np.zeros(3)))
