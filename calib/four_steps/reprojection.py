"""Rigid motions of landmarks, and their derivatives by a left perturbation of the pose."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_se3, hat
from boxcal.target.arrays import Array


def transform(T: Array, p: Array) -> Array:
    """Return points (L, 3) moved by a rigid motion (4, 4)."""
    return np.asarray(p @ T[:3, :3].T + T[:3, 3])


def left_pose_jacobian(p_cam: Array) -> Array:
    """Return d p_cam / d xi, (L, 3, 6), for ``T_cam_box <- exp_se3(xi) @ T_cam_box``, xi = (w, t), at xi = 0."""
    out = np.empty((len(p_cam), 3, 6))
    out[:, :, :3] = -hat(p_cam)
    out[:, :, 3:] = np.eye(3)
    return out


def move_left(T: Array, xi: Array) -> Array:
    """Return ``exp_se3(xi) @ T``, (..., 4, 4)."""
    return np.asarray(exp_se3(xi) @ T)
