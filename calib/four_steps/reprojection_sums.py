"""Normal equations of the reprojection of landmarks: the reference in numpy, and the switch to compiled code."""

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from itertools import pairwise

import numpy as np

from boxcal.calib.four_steps.reprojection import left_pose_jacobian
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import CameraKind, project_with_jacobians

Sums = Callable[[Array, Array, Array, Array, Ids], Array]
_NO_NUMBA = find_spec("numba") is None


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


@cache
def compiled_sums() -> Sums:
    """Return the compiled twin of :func:`reprojection_sums`, made before if it was not."""
    from boxcal.calib.four_steps.compiled import reprojection_sums as compiled  # noqa: PLC0415 - slow to import
    from boxcal.detect.alignment.compilation import finish  # noqa: PLC0415 - slow to import

    finish("boxcal.calib.four_steps.compiled.compilation")
    return compiled.reprojection_sums


def fastest_sums() -> Sums:
    """Return compiled code where numba is installed, else numpy."""
    return reprojection_sums if _NO_NUMBA else compiled_sums()
