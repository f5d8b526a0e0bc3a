"""Projection uncertainty: how far the image of a point known in the body's frame may lie from its prediction."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import hat
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel, project_with_jacobians, unproject


def points_at(camera: CameraModel, uv_px: Array, distance: float) -> Array:
    """Return the points (N, 3), m, at a distance from the camera that pixels (N, 2) see; NaN where they see nothing."""
    rays = np.concatenate([unproject(camera, uv_px), np.ones((len(uv_px), 1))], axis=1)
    return np.asarray(distance * rays / np.linalg.norm(rays, axis=1)[:, None])


def projection_sigma(camera: CameraModel, cov: Array, T_body_cam: Array, *, uv_px: Array, distance: float) -> Array:
    """Return standard deviations, (N,) px, root of the sum over u and v; NaN where no ray is seen.

    A point that is known in the body's frame lies on a pixel's ray at a distance from the camera. How far its image
    moves with camera and extrinsics is propagated from their covariance.

    Parameters
    ----------
    camera
        Camera model, with n ``values``.
    cov : (n + 6, n + 6)
        Of these, then of the camera extrinsics: right perturbation of the rotation (rad), translation along the
        body's axes (m); finite.
    T_body_cam : (4, 4), m
        Camera extrinsics.
    uv_px : (N, 2), px
        Where.
    distance : m
        From the camera.
    """
    p_cam = points_at(camera, uv_px, distance)
    seen = np.all(np.isfinite(p_cam), axis=1)
    sigma = np.full(len(uv_px), np.nan)
    _, J_lens, J_point = project_with_jacobians(camera.kind, camera.values, p_cam[seen])
    # A point fixed to the body moves in the camera by p x w - R^T dt, dt along the body's axes.
    J = np.concatenate([J_lens, J_point @ hat(p_cam[seen]), -J_point @ T_body_cam[:3, :3].T], axis=2)
    variance = np.einsum("nij,jk,nik->n", J, cov, J)
    sigma[seen] = np.sqrt(np.maximum(variance, 0.0))
    return sigma
