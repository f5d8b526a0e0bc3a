"""Normal equations of reprojection, compiled: see :mod:`boxcal.calib.four_steps.reprojection_sums`."""

from typing import Any

import numpy as np

from boxcal.calib.four_steps.compiled.kernel import kernel
from boxcal.target.arrays import Array, Ids


def reprojection_sums(values: Array, T_cam_box: Array, p_box: Array, uv_px: Array, starts: Ids) -> Array:
    """Return what :func:`boxcal.calib.four_steps.reprojection_sums.reprojection_sums` does."""
    sums = np.zeros((len(T_cam_box), 12, 12))
    poses, points, pixels = (np.ascontiguousarray(part, dtype=np.float64) for part in (T_cam_box, p_box, uv_px))
    fill_sums(values, poses, points, pixels, starts, sums)
    return sums


@kernel(fastmath={"contract", "reassoc", "nsz", "arcp"})
def fill_sums(values: Any, poses: Any, p_box: Any, uv_px: Any, starts: Any, sums: Any) -> None:  # noqa: PLR0917
    """Fill sums (P, 12, 12), which are zero."""
    fu, fv, cu, cv, kr = values
    row = np.zeros((2, 12))
    row[0, 2] = row[1, 3] = 1.0
    for s in range(len(sums)):
        T, out = poses[s], sums[s]
        for n in range(starts[s], starts[s + 1]):
            a, b, c = p_box[n, 0], p_box[n, 1], p_box[n, 2]
            px = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
            py = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
            pz = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
            if not pz > 0:
                out[11, 11] = np.inf
            x, y = px / pz, py / pz
            r2 = x * x + y * y
            g, cross = 1 + kr * r2, 2 * kr * x * y
            row[0, 0], row[0, 4], row[0, 11] = g * x, fu * r2 * x, uv_px[n, 0] - fu * g * x - cu
            row[1, 1], row[1, 4], row[1, 11] = g * y, fv * r2 * y, uv_px[n, 1] - fv * g * y - cv
            for k in range(2):
                f = fu if k == 0 else fv
                by_x = f * (g + 2 * kr * x * x if k == 0 else cross)
                by_y = f * (cross if k == 0 else g + 2 * kr * y * y)
                u, v, w = by_x / pz, by_y / pz, -(by_x * x + by_y * y) / pz
                row[k, 5], row[k, 6], row[k, 7] = py * w - pz * v, pz * u - px * w, px * v - py * u
                row[k, 8], row[k, 9], row[k, 10] = u, v, w
            for i in range(12):
                e, f = row[0, i], row[1, i]
                for j in range(i + 1):
                    out[i, j] += e * row[0, j] + f * row[1, j]
        for i in range(12):
            for j in range(i):
                out[j, i] = out[i, j]
