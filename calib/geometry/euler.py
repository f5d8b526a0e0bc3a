"""Rotations as others write them: quaternions, roll, pitch and yaw, and a camera's viewing direction."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, nearest_rotation, rigid
from boxcal.target.arrays import Array

OPTICAL_RPY = (-np.pi / 2, 0.0, -np.pi / 2)
"""Roll, pitch, yaw (rad) of an optical frame in its camera's link: ROS' REP 103."""
_R_LINK_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Optical axes (x right, y down, z forward) in a camera's link (x forward, y left, z up)."""
_DIFFERENCE = 1e-6
"""Step of the numeric derivative of the angles, rad: half the digits of a double."""


def quaternion(R: Array) -> tuple[float, float, float, float]:
    """Return (x, y, z, w), w >= 0, of a rotation.

    It is the eigenvector of the largest eigenvalue of a matrix that is linear in R (Bar-Itzhack 2000, DOI
    10.2514/2.4654), which is as exact near half turns as elsewhere. scipy's takes .2 s to import.
    """
    M = nearest_rotation(R)
    K = np.zeros((4, 4))
    K[:3, :3] = M + M.T - np.trace(M) * np.eye(3)
    K[3, :3] = K[:3, 3] = M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]
    K[3, 3] = np.trace(M)
    q = np.linalg.eigh(K)[1][:, -1]
    x, y, z, w = q * (-1.0 if q[3] < 0 else 1.0)
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


def yaw_pitch_roll(R_body_cam: Array) -> tuple[float, float, float]:
    """Return where a camera looks: yaw (left), pitch (down) and roll, rad, of ``Rz(yaw) Ry(pitch) Rx(roll)``.

    The rotation is that of the camera's link (x along the view, y left, z up), not of its optical frame, so a camera
    that looks straight ahead has zeros.
    """
    roll, pitch, yaw = roll_pitch_yaw(R_body_cam @ _R_LINK_OPTICAL.T)
    return yaw, pitch, roll


def yaw_pitch_roll_sigma(R_body_cam: Array, cov_rotation: Array) -> Array:
    """Return the standard deviations of yaw, pitch and roll, (3,) rad.

    Parameters
    ----------
    R_body_cam : (3, 3)
        Orientation of the camera.
    cov_rotation : (3, 3), rad^2
        Of its right perturbation, ``R_body_cam @ exp_so3(d)``; where it is not finite neither is the result.
    """
    if not np.all(np.isfinite(cov_rotation)):
        return np.full(3, np.inf)
    angles = [
        np.subtract(yaw_pitch_roll(R_body_cam @ exp_so3(d)), yaw_pitch_roll(R_body_cam @ exp_so3(-d)))
        for d in np.eye(3) * _DIFFERENCE
    ]
    J = np.array(angles).T / (2 * _DIFFERENCE)
    return np.asarray(np.sqrt(np.diag(J @ cov_rotation @ J.T)))


def link_pose(T_body_cam: Array) -> Array:
    """Return ``T_body_link``, (4, 4): the camera's link (x along the view, y left, z up) at the optical centre."""
    R = nearest_rotation(T_body_cam[:3, :3])
    return rigid(R, T_body_cam[:3, 3]) @ inverse(rigid(_R_LINK_OPTICAL, np.zeros(3)))
