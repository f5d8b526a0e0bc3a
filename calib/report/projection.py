"""How far a point that the robot knows may lie from where the calibration says it appears, over the image."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import hat
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel, project_with_jacobians, unproject


def projection_sigma(camera: CameraModel, cov: Array, T_body_cam: Array, *, uv_px: Array, distance: float) -> Array:
    """Return standard deviations, (N,) px, root of the sum over u and v; NaN where no ray is seen.

    A point that is known in the body's frame lies on a pixel's ray at a distance from the camera. How far its image
    moves with camera and mounting is propagated from their covariance.

    Parameters
    ----------
    camera
        Its distortion coefficients beyond kr count as exact.
    cov : (14, 14)
        In the order and with the side that ``calib.detail`` has; finite.
    T_body_cam : (4, 4), m
        Mounting.
    uv_px : (N, 2), px
        Where.
    distance : m
        From the camera.
    """
    p_cam = np.concatenate([unproject(camera, uv_px), np.ones((len(uv_px), 1))], axis=1)
    p_cam *= distance / np.linalg.norm(p_cam, axis=1)[:, None]
    seen = np.all(np.isfinite(p_cam), axis=1)
    sigma = np.full(len(uv_px), np.nan)
    _, by_lens, by_point = project_with_jacobians(camera.kind, camera.values, p_cam[seen])
    J = np.zeros((int(seen.sum()), 2, 14))
    J[:, :, :5] = by_lens[:, :, :5]
    J[:, :, 8:11] = by_point @ hat(p_cam[seen])
    J[:, :, 11:] = -by_point @ T_body_cam[:3, :3].T
    variance = np.einsum("nij,jk,nik->n", J, cov, J)
    sigma[seen] = np.sqrt(np.maximum(variance, 0.0))
    return sigma
