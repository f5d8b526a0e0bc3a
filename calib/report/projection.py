"""How far a point that the robot knows may lie from where the calibration says it appears, over the image."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import Array, hat
from boxcal.target.camera.camera_model import Lens, project_lens

_STEPS = 30
_CONVERGED_PX = 1e-3


def projection_sigma(
    lens: Lens, values: Array, cov: Array, T_body_cam: Array, *, uv_px: Array, distance: float
) -> Array:
    """Return standard deviations, (N,) px, root of the sum over u and v; NaN where no ray is seen.

    A point that is known in the body's frame lies on a pixel's ray at a distance from the camera. How far its image
    moves with camera and mounting is propagated from their covariance.

    Parameters
    ----------
    lens, values
        Lens and its coefficients; those beyond kr count as exact.
    cov : (14, 14)
        In the order and with the side that ``calib.detail`` has; finite.
    T_body_cam : (4, 4), m
        Mounting.
    uv_px : (N, 2), px
        Where.
    distance : m
        From the camera.
    """
    p_cam = np.concatenate([rays(lens, values, uv_px), np.ones((len(uv_px), 1))], axis=1)
    p_cam *= distance / np.linalg.norm(p_cam, axis=1)[:, None]
    seen = np.all(np.isfinite(p_cam), axis=1)
    sigma = np.full(len(uv_px), np.nan)
    _, by_lens, by_point = project_lens(lens, values, p_cam[seen])
    J = np.zeros((int(seen.sum()), 2, 14))
    J[:, :, :5] = by_lens[:, :, :5]
    J[:, :, 8:11] = by_point @ hat(p_cam[seen])
    J[:, :, 11:] = -by_point @ T_body_cam[:3, :3].T
    variance = np.einsum("nij,jk,nik->n", J, cov, J)
    sigma[seen] = np.sqrt(np.maximum(variance, 0.0))
    return sigma


def rays(lens: Lens, values: Array, uv_px: Array) -> Array:
    """Return (x/z, y/z) of pixels, (N, 2), by Newton's method; NaN where the lens sees nothing."""
    xy = (uv_px - values[2:4]) / values[:2]
    for _ in range(_STEPS):
        uv, _, by_point = project_lens(lens, values, np.concatenate([xy, np.ones((len(xy), 1))], axis=1))
        J = by_point[:, :, :2]
        det = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        e = uv_px - uv
        step = np.stack([J[:, 1, 1] * e[:, 0] - J[:, 0, 1] * e[:, 1], J[:, 0, 0] * e[:, 1] - J[:, 1, 0] * e[:, 0]], 1)
        step /= np.where(np.abs(det) > 1e-9, det, np.nan)[:, None]
        xy = xy + np.clip(step, -0.5, 0.5)
        if np.nanmax(np.abs(step), initial=0.0) < 1e-12:
            break
    uv, _, by_point = project_lens(lens, values, np.concatenate([xy, np.ones((len(xy), 1))], axis=1))
    det = np.linalg.det(by_point[:, :, :2])
    good = (np.abs(uv - uv_px).max(axis=1) < _CONVERGED_PX) & (det > 0)
    return np.where(good[:, None], xy, np.nan)
