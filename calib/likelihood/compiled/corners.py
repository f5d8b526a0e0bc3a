"""Rows of corners, compiled: see :mod:`boxcal.calib.likelihood.corner_rows`."""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.calib.likelihood.problem import Problem
from boxcal.target.arrays import Array, Ids


def corner_rows(  # noqa: PLR0917 - as the reference
    problem: Problem,
    error_px: Array,
    by_lens: Array,
    by_point: Array,
    p_cam: Array,
    group: Ids,
    R_face_cam: Array,
    spare: int = 0,
) -> tuple[Array, Array]:
    """Return what :func:`boxcal.calib.likelihood.corner_rows.corner_rows` does."""
    by_direct = problem.target.by_direct
    residual = np.empty(error_px.shape)
    J = np.empty((len(error_px), 2, by_lens.shape[2] + 7 + by_direct.shape[2] + spare))
    seen = tuple(np.ascontiguousarray(part) for part in (problem.whiten, error_px, problem.outward_px))
    derivatives = tuple(np.ascontiguousarray(part) for part in (by_lens, by_point, by_direct))
    poses = np.ascontiguousarray(p_cam), np.ascontiguousarray(R_face_cam)
    fill_rows(group, seen, derivatives, poses, residual, J)
    return residual, J


@kernel()
def fill_rows(group: Any, seen: Any, derivatives: Any, poses: Any, residual: Any, J: Any) -> None:  # noqa: PLR0917
    """Fill residuals (L, 2) and rows (L, 2, k + 7 + d + spare) of the corners of each group; ``group`` (L,)."""
    whiten, error, outward = seen
    by_lens, by_point, by_direct = derivatives
    p_cam, R = poses
    k, d = by_lens.shape[2], by_direct.shape[2]
    for n in range(len(group)):
        g, x, y, z = group[n], p_cam[n, 0], p_cam[n, 1], p_cam[n, 2]
        for i in range(2):
            a, b = whiten[n, i, 0], whiten[n, i, 1]
            residual[n, i] = a * error[n, 0] + b * error[n, 1]
            row = J[n, i]
            for m in range(k):
                row[m] = a * by_lens[n, 0, m] + b * by_lens[n, 1, m]
            bx = a * by_point[n, 0, 0] + b * by_point[n, 1, 0]
            by = a * by_point[n, 0, 1] + b * by_point[n, 1, 1]
            bz = a * by_point[n, 0, 2] + b * by_point[n, 1, 2]
            row[k], row[k + 1], row[k + 2] = by * z - bz * y, bz * x - bx * z, bx * y - by * x
            row[k + 3], row[k + 4], row[k + 5] = -bx, -by, -bz
            row[k + 6] = a * outward[n, 0] + b * outward[n, 1]
            # along the axes of the face
            ux = R[g, 0, 0] * bx + R[g, 0, 1] * by + R[g, 0, 2] * bz
            uy = R[g, 1, 0] * bx + R[g, 1, 1] * by + R[g, 1, 2] * bz
            uz = R[g, 2, 0] * bx + R[g, 2, 1] * by + R[g, 2, 2] * bz
            for m in range(d):
                row[k + 7 + m] = ux * by_direct[n, 0, m] + uy * by_direct[n, 1, m] + uz * by_direct[n, 2, m]
            for m in range(k + 7 + d, len(row)):
                row[m] = 0.0
