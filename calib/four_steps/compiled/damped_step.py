"""Levenberg-Marquardt step of the reprojection, compiled: see :mod:`boxcal.calib.four_steps.damped_step`."""

from typing import Any

import numpy as np

from boxcal.calib.four_steps.compiled.kernel import kernel
from boxcal.target.arrays import Array


def damped_step(sums: Array, lam: float, T_cam_box: Array) -> tuple[Array, Array, float]:
    """Return what :func:`boxcal.calib.four_steps.damped_step.damped_step` does."""
    poses = np.array(T_cam_box, dtype=np.float64)
    shared, own = np.zeros((5, 6)), np.empty((len(poses), 6, 12))
    promised = fill_step(np.ascontiguousarray(sums), float(lam), shared, own, poses)
    return shared[:, 5], poses, float(promised)


@kernel(inner=True)
def _eliminate(rows: Any, count: int) -> None:
    """Solve equations (count, count + k), right-hand sides last, by Gauss-Jordan: they are positive definite."""
    for i in range(count):
        pivot = rows[i, i]
        for j in range(i, rows.shape[1]):
            rows[i, j] /= pivot
        for r in range(count):
            if r != i:
                f = rows[r, i]
                for j in range(i, rows.shape[1]):
                    rows[r, j] -= f * rows[i, j]


@kernel()
def fill_step(sums: Any, lam: float, shared: Any, own: Any, poses: Any) -> float:  # noqa: PLR0912
    """Solve for the camera's change, last column of shared (5, 6), and move the poses; own (P, 6, 12) is for work."""
    for s in range(len(sums)):
        for i in range(5):
            for j in range(5):
                shared[i, j] += sums[s, i, j] * (1 + lam if i == j else 1.0)
            shared[i, 5] += sums[s, i, 11]
    right = shared[:, 5].copy()
    for s in range(len(sums)):
        rows = own[s]
        for i in range(6):
            for j in range(6):
                rows[i, j] = sums[s, 5 + i, 5 + j] * (1 + lam if i == j else 1.0)
            for j in range(5):
                rows[i, 6 + j] = sums[s, 5 + i, j]
            rows[i, 11] = sums[s, 5 + i, 11]
        _eliminate(rows, 6)
        for i in range(5):
            for j in range(6):
                for k in range(6):
                    shared[i, j] -= sums[s, i, 5 + k] * rows[k, 6 + j]
    _eliminate(shared, 5)
    promised = 0.0
    for i in range(5):
        promised += right[i] * shared[i, 5]
    step = np.empty(6)
    for s in range(len(sums)):
        for k in range(6):
            step[k] = own[s, k, 11]
            for j in range(5):
                step[k] -= own[s, k, 6 + j] * shared[j, 5]
            promised += step[k] * sums[s, 5 + k, 11]
        _move(step, poses[s])
    return promised


@kernel(inner=True)
def _move(step: Any, T: Any) -> None:
    """Turn and shift a pose (4, 4) from the left by a step (w, t)."""
    x, y, z = step[0], step[1], step[2]
    q = x * x + y * y + z * z
    angle = np.sqrt(q)
    a = np.sin(angle) / angle if q > 1e-8 else 1 - q / 6
    b = (1 - np.cos(angle)) / q if q > 1e-8 else 0.5 - q / 24
    for j in range(4):
        u, v, w = T[0, j], T[1, j], T[2, j]
        cu, cv, cw = y * w - z * v, z * u - x * w, x * v - y * u
        T[0, j] = u + a * cu + b * (y * cw - z * cv) + (step[3] if j == 3 else 0.0)
        T[1, j] = v + a * cv + b * (z * cu - x * cw) + (step[4] if j == 3 else 0.0)
        T[2, j] = w + a * cw + b * (x * cv - y * cu) + (step[5] if j == 3 else 0.0)
