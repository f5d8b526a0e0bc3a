"""Where a stop's landmarks should appear, and how that changes with camera and pose."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import Array, exp_se3, hat
from boxcal.target.camera.pinhole import Intrinsics


def transform(T: Array, p: Array) -> Array:
    """Return points (L, 3) moved by a rigid motion (4, 4)."""
    return np.asarray(p @ T[:3, :3].T + T[:3, 3])


def project_with_jacobians(camera: Intrinsics, p_cam: Array) -> tuple[Array, Array, Array]:
    """Return pixels and their derivatives.

    Parameters
    ----------
    camera
        Intrinsics.
    p_cam : (L, 3), m
        Points in frame ``cam``.

    Returns
    -------
    uv_px : (L, 2)
    d_camera : (L, 2, 5)
        By (fu, fv, cu, cv, kr).
    d_point : (L, 2, 3), px/m
        By the point in frame ``cam``.
    """
    z = p_cam[:, 2]
    x, y = p_cam[:, 0] / z, p_cam[:, 1] / z
    rho2 = x * x + y * y
    g = 1 + camera.kr * rho2
    uv = np.stack([camera.fu * g * x + camera.cu, camera.fv * g * y + camera.cv], axis=1)
    n = len(z)
    d_camera = np.zeros((n, 2, 5))
    d_camera[:, 0, 0], d_camera[:, 1, 1] = g * x, g * y
    d_camera[:, 0, 2] = d_camera[:, 1, 3] = 1.0
    d_camera[:, 0, 4], d_camera[:, 1, 4] = camera.fu * rho2 * x, camera.fv * rho2 * y
    # d(uv)/d(x, y), then (x, y) by the point.
    a, b, c = g + 2 * camera.kr * x * x, 2 * camera.kr * x * y, g + 2 * camera.kr * y * y
    uxx, uxy, uyx, uyy = camera.fu * a, camera.fu * b, camera.fv * b, camera.fv * c
    d_point = np.empty((n, 2, 3))
    d_point[:, 0, 0], d_point[:, 0, 1], d_point[:, 0, 2] = uxx / z, uxy / z, -(uxx * x + uxy * y) / z
    d_point[:, 1, 0], d_point[:, 1, 1], d_point[:, 1, 2] = uyx / z, uyy / z, -(uyx * x + uyy * y) / z
    return uv, d_camera, d_point


def left_pose_jacobian(p_cam: Array) -> Array:
    """Return d p_cam / d xi, (L, 3, 6), for ``T_cam_box <- exp_se3(xi) @ T_cam_box``, xi = (w, t), at xi = 0."""
    out = np.empty((len(p_cam), 3, 6))
    out[:, :, :3] = -hat(p_cam)
    out[:, :, 3:] = np.eye(3)
    return out


def move_left(T: Array, xi: Array) -> Array:
    """Return ``exp_se3(xi) @ T``."""
    return np.asarray(exp_se3(xi) @ T)
