"""Normal equations of the reprojection of landmarks by the paper's camera model."""

from itertools import pairwise

import numpy as np

from boxcal.calib.four_steps.reprojection import left_pose_jacobian
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import CameraKind, project_with_jacobians


def reprojection_sums(values: Array, T_cam_box: Array, p_box: Array, uv_px: Array, starts: Ids) -> Array:
    """Return the sums of products of derivatives and errors of each view, (P, 12, 12), px.

    Rows and columns are the derivatives of the pixels by fu, fv, cu, cv and kr, by a left perturbation (w, t) of
    ``T_cam_box``, and the error, seen less predicted; of a view with a landmark behind the camera the last entry, the
    sum of its squared errors, is infinite.

    Parameters
    ----------
    values : (5,)
        fu, fv, cu, cv and kr.
    T_cam_box : (P, 4, 4), m
        Poses.
    p_box, uv_px : (L, 3), (L, 2), m and px
        Landmarks, view by view, and where they are seen.
    starts : (P + 1,)
        Where the landmarks of each view begin, and how many there are.
    """
    T = np.repeat(T_cam_box, np.diff(starts), axis=0)
    p_cam = (T[:, :3, :3] @ p_box[:, :, None])[:, :, 0] + T[:, :3, 3]
    uv, by_camera, by_point = project_with_jacobians(CameraKind.RADIAL, values, p_cam)
    rows = np.concatenate([by_camera, by_point @ left_pose_jacobian(p_cam), (uv_px - uv)[:, :, None]], axis=2)
    parts = [rows[a:b].reshape(-1, 12) for a, b in pairwise(starts)]
    sums = np.array([part.T @ part for part in parts])
    behind = np.add.reduceat(p_cam[:, 2] <= 0, starts[:-1]) > 0
    sums[behind, 11, 11] = np.inf
    return sums
