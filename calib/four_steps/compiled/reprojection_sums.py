"""Normal equations of reprojection, compiled: see :mod:`boxcal.calib.four_steps.reprojection_sums`.

Derivatives and errors of a view's landmarks stand column by column, u and v apart: sums of products of two columns are
what processors have vector instructions for.
"""

from typing import Any

import numpy as np

from boxcal.calib.four_steps.compiled.kernel import kernel
from boxcal.target.arrays import Array, Ids

_COLUMNS = np.array([[0, 2, *range(4, 12)], [1, 3, *range(4, 12)]])
"""What pixels along u, and along v, depend on, and their error: all but the other focal length and principal point."""


def reprojection_sums(values: Array, T_cam_box: Array, p_box: Array, uv_px: Array, starts: Ids) -> Array:
    """Return what :func:`boxcal.calib.four_steps.reprojection_sums.reprojection_sums` does."""
    sums = np.zeros((len(T_cam_box), 12, 12))
    poses, points, pixels = (np.ascontiguousarray(part, dtype=np.float64) for part in (T_cam_box, p_box, uv_px))
    columns = np.empty((*_COLUMNS.shape, int(np.diff(starts).max(initial=0))))
    fill_sums(values, poses, points, pixels, starts, columns, sums)
    return sums


@kernel(fastmath={"contract", "reassoc", "nsz", "arcp"})
def fill_sums(values: Any, poses: Any, p_box: Any, uv_px: Any, starts: Any, columns: Any, sums: Any) -> None:  # noqa: PLR0917
    """Fill sums (P, 12, 12), which are zero; columns (2, 10, most landmarks of a view) is for work."""
    for s in range(len(sums)):
        count, out = starts[s + 1] - starts[s], sums[s]
        behind = _differentiate(values, poses[s], p_box[starts[s] :], uv_px[starts[s] :], columns, count)
        for k in range(2):
            for i in range(10):
                for j in range(i + 1):
                    total = 0.0
                    for n in range(count):
                        total += columns[k, i, n] * columns[k, j, n]
                    out[_COLUMNS[k, i], _COLUMNS[k, j]] += total
        for i in range(12):
            for j in range(i):
                out[j, i] = out[i, j]
        if behind:
            out[11, 11] = np.inf


@kernel(inner=True, fastmath={"contract", "reassoc", "nsz", "arcp"})
def _differentiate(values: Any, T: Any, p_box: Any, uv_px: Any, columns: Any, count: int) -> bool:  # noqa: PLR0917
    """Fill the columns with a view's first landmarks; return whether one is behind the camera."""
    fu, fv, cu, cv, kr = values
    u, v, behind = columns[0], columns[1], False
    for n in range(count):
        a, b, c = p_box[n, 0], p_box[n, 1], p_box[n, 2]
        px = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
        py = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
        pz = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
        behind |= not pz > 0
        x, y, near = px / pz, py / pz, 1 / pz
        r2 = x * x + y * y
        g, cross = 1 + kr * r2, 2 * kr * x * y
        u[0, n], u[1, n], u[2, n], u[9, n] = g * x, 1.0, fu * r2 * x, uv_px[n, 0] - fu * g * x - cu
        v[0, n], v[1, n], v[2, n], v[9, n] = g * y, 1.0, fv * r2 * y, uv_px[n, 1] - fv * g * y - cv
        for k in range(2):
            f = fu if k == 0 else fv
            by_x = f * (g + 2 * kr * x * x if k == 0 else cross)
            by_y = f * (cross if k == 0 else g + 2 * kr * y * y)
            d, e, h = by_x * near, by_y * near, -(by_x * x + by_y * y) * near
            columns[k, 3, n], columns[k, 4, n], columns[k, 5, n] = py * h - pz * e, pz * d - px * h, px * e - py * d
            columns[k, 6, n], columns[k, 7, n], columns[k, 8, n] = d, e, h
    return behind
