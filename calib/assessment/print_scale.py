"""Print scale as a score test on the reprojection errors, without solving for it.

A sheet printed with "fit to page", or on a printer that feeds unevenly, is larger or smaller across or up than
designed. Camera and poses adapt to some of that; what they cannot adapt to stays in the reprojection errors. One
Gauss-Newton step with camera, poses and both scales unknown (poses eliminated) finds it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.four_steps.reprojection import left_pose_jacobian
from boxcal.calib.geometry.two_by_two import inverse_roots
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.stop_residuals import SeenStop
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.camera.camera_model import project_with_jacobians

_MOST_SIGMA = 0.003
"""A scale with a larger standard deviation than this is not reported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintScale:
    """Printed over designed lengths, less one, with standard deviations.

    Attributes
    ----------
    x, sigma_x
        Across a sheet.
    y, sigma_y
        Up a sheet.
    """

    x: float
    y: float
    sigma_x: float
    sigma_y: float


def find_print_scale(calibration: Calibration, seen: Sequence[SeenStop], target: Target) -> PrintScale | None:
    """Return the print's scales against the landmark table, or None where the corners do not determine it.

    Parameters
    ----------
    calibration, seen
        The calibration, and what :func:`boxcal.calib.results.stop_residuals.stops_seen` found for it.
    target
        The landmark table that it was calibrated with.
    """
    kind, values = calibration.camera.kind, calibration.camera.values
    n = len(values) + 2
    A, g, squares, count = np.zeros((n, n)), np.zeros(n), 0.0, 0
    faces = np.array([target.T_box_face(f) for f in range(FACES)])
    for stop in seen:
        rows = stop.used
        if rows.sum() < 2 * n:
            continue
        p_cam, face = stop.p_cam[rows], faces[stop.face[rows]]
        p_face = np.einsum("lji,lj->li", face[:, :3, :3], stop.p_box[rows] - face[:, :3, 3])
        R_cam_box = stop.result.T_box_cam[:3, :3].T
        by_scale = R_cam_box @ face[:, :3, :2] * p_face[:, None, :2]
        _, by_lens, by_point = project_with_jacobians(kind, values, p_cam)
        cov_px2 = stop.view.cov_px2[rows]
        if calibration.detail is not None:
            cov_px2 = calibration.detail.corner_cov_px2(cov_px2)
        whiten = inverse_roots(cov_px2)
        shared = (whiten @ np.concatenate([by_lens, by_point @ by_scale], axis=2)).reshape(-1, n)
        own = (whiten @ by_point @ left_pose_jacobian(p_cam)).reshape(-1, 6)
        r = (whiten @ stop.error_px[rows][:, :, None]).ravel()
        q, _ = np.linalg.qr(own)
        shared, r = shared - q @ (q.T @ shared), r - q @ (q.T @ r)
        A += shared.T @ shared
        g += shared.T @ r
        squares += float(r @ r)
        count += len(r) - 6
    if count <= n or np.linalg.cond(_unit(A)) > 1e12:
        return None
    step = np.linalg.solve(A, g)
    noise = (squares - float(g @ step)) / (count - n)
    sigma = np.sqrt(noise * np.diag(np.linalg.inv(A)))
    if max(sigma[-2:]) > _MOST_SIGMA:
        return None
    return PrintScale(x=float(step[-2]), y=float(step[-1]), sigma_x=float(sigma[-2]), sigma_y=float(sigma[-1]))


def _unit(A: Array) -> Array:
    d = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return np.asarray(A / np.outer(d, d))
