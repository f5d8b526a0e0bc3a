"""The homography of least squares; the reference is in :mod:`boxcal.detect.alignment.homography`."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.arrays import clear_rows
from boxcal.detect.alignment.numba.cholesky import factor, solve_factored
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.target.arrays import Array

_STEPS, _STILL, _LEAST = 30, 1e-12, 1e-15
"""Of the inverse iteration: at most this many steps, until the vector moves less; and what is added to the matrix,
relative."""


def least_squares_homography(src: Array, dst: Array) -> Array:
    """Return what :func:`boxcal.detect.alignment.homography.least_squares_homography` does."""
    H = np.empty((3, 3))
    _fit(np.ascontiguousarray(src, dtype=np.float64), np.ascontiguousarray(dst, dtype=np.float64), H)
    return H


@kernel()
def _fit(src: Any, dst: Any, H: Any) -> None:
    x0, y0, s = _normalised(src)
    u0, v0, d = _normalised(dst)
    A, p = np.empty((9, 9)), np.ones(3)
    clear_rows(A)
    for k in range(len(src)):
        p[0], p[1] = s * (src[k, 0] - x0), s * (src[k, 1] - y0)
        u, v = d * (dst[k, 0] - u0), d * (dst[k, 1] - v0)
        for i in range(3):
            for j in range(3):
                product = p[i] * p[j]
                A[i, j] += product
                A[6 + i, j] -= u * product
                A[6 + i, 3 + j] -= v * product
                A[6 + i, 6 + j] += (u * u + v * v) * product
    trace = 2 * (A[0, 0] + A[1, 1] + A[2, 2]) + A[6, 6] + A[7, 7] + A[8, 8]
    for i in range(3):
        for j in range(3):
            A[3 + i, 3 + j] = A[i, j]
    for i in range(9):
        A[i, i] += _LEAST * trace
    factor(A)
    h, new = np.full(9, 1.0 / 3.0), np.empty(9)
    for _ in range(_STEPS):
        solve_factored(A, h, new)
        length, along = 0.0, 0.0
        for i in range(9):
            length += new[i] * new[i]
            along += new[i] * h[i]
        per, moved = np.copysign(1 / np.sqrt(length), along), 0.0
        for i in range(9):
            moved = max(moved, abs(per * new[i] - h[i]))
            h[i] = per * new[i]
        if moved < _STILL:
            break
    # of places that are not normalised
    for i in range(3):
        a, b = h[3 * i] * s, h[3 * i + 1] * s
        H[i, 0], H[i, 1], H[i, 2] = a, b, h[3 * i + 2] - a * x0 - b * y0
    for j in range(3):
        H[0, j], H[1, j] = H[0, j] / d + u0 * H[2, j], H[1, j] / d + v0 * H[2, j]


@loops()
def _normalised(points: Any) -> tuple[float, float, float]:
    """Return the centre of points (P, 2), and by what to scale them about it to a mean square of two."""
    x, y, square = 0.0, 0.0, 0.0
    for k in range(len(points)):
        x, y = x + points[k, 0], y + points[k, 1]
    x, y = x / len(points), y / len(points)
    for k in range(len(points)):
        square += (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
    return x, y, np.sqrt(2.0) / max(np.sqrt(square / len(points)), 1e-12)
