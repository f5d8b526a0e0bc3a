"""Levenberg-Marquardt step of the reprojection, the poses eliminated (Schur complement)."""

import numpy as np

from boxcal.calib.four_steps.reprojection import move_left
from boxcal.target.arrays import Array

CAMERA, POSE, ERROR = slice(0, 5), slice(5, 11), 11
"""Where the camera's unknowns, the pose's and the error stand in the sums of a view."""


def damped_step(sums: Array, lam: float, T_cam_box: Array) -> tuple[Array, Array, float]:
    """Return the change of the camera's values, (5,), the poses after the step, (P, 4, 4), and what it promises, px^2.

    Parameters
    ----------
    sums : (P, 12, 12)
        As of :func:`boxcal.calib.four_steps.reprojection_sums.reprojection_sums`.
    lam
        Marquardt's damping: by this fraction the diagonals grow.
    T_cam_box : (P, 4, 4), m
        Poses before the step.
    """
    A, a = sums[:, CAMERA, CAMERA].sum(axis=0), sums[:, CAMERA, ERROR].sum(axis=0)
    B, C, c = sums[:, CAMERA, POSE], sums[:, POSE, POSE], sums[:, POSE, ERROR]
    right = np.concatenate([np.swapaxes(B, 1, 2), c[:, :, None]], axis=2)
    by_camera = np.linalg.solve(C * (1 + lam * np.eye(6)), right)  # (P, 6, 5 + 1)
    reduced = np.sum(B @ by_camera, axis=0)
    d_camera = np.linalg.solve(A * (1 + lam * np.eye(5)) - reduced[:, :5], a - reduced[:, 5])
    d_poses = by_camera[:, :, 5] - by_camera[:, :, :5] @ d_camera
    return d_camera, move_left(T_cam_box, d_poses), float(d_camera @ a + np.sum(d_poses * c))
