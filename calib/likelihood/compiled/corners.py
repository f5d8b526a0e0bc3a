"""Rows of corners, compiled: see :mod:`boxcal.calib.likelihood.corner_rows`."""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.calib.likelihood.problem import Problem
from boxcal.target.arrays import Array


def corner_rows(  # noqa: PLR0917 - as the reference
    problem: Problem, error_px: Array, by_lens: Array, by_point: Array, p_cam: Array, R_box_cam: Array, by_direct: Array
) -> tuple[Array, Array]:
    """Return what :func:`boxcal.calib.likelihood.corner_rows.corner_rows` does."""
    residual = np.empty(error_px.shape)
    J = np.empty((len(error_px), 2, by_lens.shape[2] + 7 + by_direct.shape[2]))
    seen = tuple(np.ascontiguousarray(part) for part in (problem.whiten, error_px, problem.outward_px))
    derivatives = tuple(np.ascontiguousarray(part) for part in (by_lens, by_point, by_direct))
    poses = np.ascontiguousarray(p_cam), np.ascontiguousarray(R_box_cam)
    fill_rows(problem.corner_starts, seen, derivatives, poses, residual, J)
    return residual, J


@kernel()
def fill_rows(starts: Any, seen: Any, derivatives: Any, poses: Any, residual: Any, J: Any) -> None:  # noqa: PLR0917
    """Fill residuals (L, 2) and rows (L, 2, k + 7 + d) of the corners of each stop; ``starts`` (P + 1,)."""
    whiten, error, outward = seen
    by_lens, by_point, by_direct = derivatives
    p_cam, R = poses
    k, d = by_lens.shape[2], by_direct.shape[2]
    for stop in range(len(starts) - 1):
        for n in range(starts[stop], starts[stop + 1]):
            x, y, z = p_cam[n, 0], p_cam[n, 1], p_cam[n, 2]
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
                # along the axes of the box
                ux = R[stop, 0, 0] * bx + R[stop, 0, 1] * by + R[stop, 0, 2] * bz
                uy = R[stop, 1, 0] * bx + R[stop, 1, 1] * by + R[stop, 1, 2] * bz
                uz = R[stop, 2, 0] * bx + R[stop, 2, 1] * by + R[stop, 2, 2] * bz
                for m in range(d):
                    row[k + 7 + m] = ux * by_direct[n, 0, m] + uy * by_direct[n, 1, m] + uz * by_direct[n, 2, m]
