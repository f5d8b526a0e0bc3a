"""Residuals of corners and their derivatives by camera model, motion of the camera, growth and target, whitened."""

import numpy as np

from boxcal.calib.likelihood.problem import Problem
from boxcal.target.arrays import Array, Ids


def corner_rows(  # noqa: PLR0917 - arrays in, arrays out
    problem: Problem,
    error_px: Array,
    by_lens: Array,
    by_point: Array,
    p_cam: Array,
    group: Ids,
    R_face_cam: Array,
    spare: int = 0,
) -> tuple[Array, Array]:
    """Return whitened residuals (L, 2) and the derivatives of the whitened predictions (L, 2, k + 7 + d + spare).

    Parameters
    ----------
    problem
        Covariances of the corners, and how they move as the tags' black grows and by the target's direct unknowns.
    error_px : (L, 2), px
        Seen less predicted.
    by_lens, by_point : (L, 2, k), (L, 2, 3)
        Derivatives of pixels by the camera model and by the point.
    p_cam : (L, 3), m
        Points in frame ``cam``.
    group : (L,)
        Group of each corner: those of one stop on one face.
    R_face_cam : (G, 3, 3)
        How the camera is turned against the face of each group.
    spare
        Columns of zeros behind those.
    """
    whiten, by_direct = problem.whiten, problem.target.by_direct
    whitened = whiten @ by_point
    k, d = by_lens.shape[2], by_direct.shape[2]
    J = np.empty((len(error_px), 2, k + 7 + d + spare))
    J[:, :, :k] = whiten @ by_lens
    x, y, z = p_cam[:, None, 0], p_cam[:, None, 1], p_cam[:, None, 2]
    bx, by, bz = whitened[:, :, 0], whitened[:, :, 1], whitened[:, :, 2]
    # Motion (w, t) of the camera: the point moves by p x w - t.
    J[:, :, k] = by * z - bz * y
    J[:, :, k + 1] = bz * x - bx * z
    J[:, :, k + 2] = bx * y - by * x
    J[:, :, k + 3 : k + 6] = -whitened
    J[:, :, k + 6] = (whiten @ problem.outward_px[:, :, None])[:, :, 0]
    if d:
        J[:, :, k + 7 : k + 7 + d] = whitened @ (np.swapaxes(R_face_cam[group], 1, 2) @ by_direct)
    J[:, :, k + 7 + d :] = 0.0
    return (whiten @ error_px[:, :, None])[:, :, 0], J
