"""Normal equations of corners, compiled: see :mod:`boxcal.calib.likelihood.corner_sums`.

Of what unknowns do in a group's columns nine in ten entries are zero, so only the others are multiplied.
"""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.target.arrays import Array, Ids


def corner_sums(  # noqa: PLR0917 - as the reference
    rows: tuple[Array, Array, Array], group: Ids, group_stop: Ids, stops: int, shared: Array, own: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return what :func:`boxcal.calib.likelihood.corner_sums.corner_sums` does."""
    (G, _, n), k = shared.shape, own.shape[2]
    maps = np.concatenate([shared, own], axis=2)
    sums = group_sums(rows, group, G)
    A, right, squares = np.zeros((n, n)), np.zeros(n), np.zeros(stops)
    B, D, c = np.zeros((stops, n, k)), np.zeros((stops, k, k)), np.zeros((stops, k))
    fill_equations(sums, group_stop, maps, (A, right, B, D, c, squares))
    return A, right, B, D, c, squares


def group_sums(rows: tuple[Array, Array, Array], group: Ids, groups: int) -> Array:
    """Return what :func:`boxcal.calib.likelihood.corner_sums.group_sums` does."""
    corners = tuple(np.ascontiguousarray(part, dtype=np.float64) for part in rows)
    m = corners[0].shape[2]
    sums = np.zeros((groups, m + 1, m + 1))
    fill_sums(corners, group, sums)
    return sums


@kernel(fastmath=True)
def fill_sums(rows: Any, group: Any, sums: Any) -> None:
    """Add the products of derivatives and residuals of all corners to those of their groups (G, m + 1, m + 1)."""
    jacobian, residual, weight = rows
    m = jacobian.shape[2]
    for n in range(len(group)):
        w, out = weight[n], sums[group[n]]
        if w == 0.0:
            continue
        u, v, e, f = jacobian[n, 0], jacobian[n, 1], residual[n, 0], residual[n, 1]
        for i in range(m):
            a, b = w * u[i], w * v[i]
            for j in range(i + 1):
                out[i, j] += a * u[j] + b * v[j]
            out[m, i] += a * e + b * f
        out[m, m] += w * (e * e + f * f)
    for k in range(len(sums)):
        for i in range(m + 1):
            for j in range(i):
                sums[k, j, i] = sums[k, i, j]


@kernel(fastmath=True)
def fill_equations(sums: Any, group_stop: Any, maps: Any, out: Any) -> None:
    """Add the groups' sums to the equations of the unknowns (m, n + k) of each, through what is not zero in them."""
    A, right, B, D, c, squares = out
    n, m, width = len(right), maps.shape[1], maps.shape[2]
    at, moved = np.empty((m * width, 2), np.int64), np.empty((m, width))
    for g in range(len(group_stop)):
        stop, count = group_stop[g], 0
        for i in range(m):
            for j in range(width):
                moved[i, j] = 0.0
                if maps[g, i, j] != 0.0:
                    at[count, 0], at[count, 1] = i, j
                    count += 1
        for e in range(count):
            i, j = at[e, 0], at[e, 1]
            value = maps[g, i, j]
            for r in range(m):
                moved[r, j] += sums[g, r, i] * value
        for e in range(count):
            i, j = at[e, 0], at[e, 1]
            value = maps[g, i, j]
            if j < n:
                right[j] += value * sums[g, m, i]
                for q in range(n):
                    A[j, q] += value * moved[i, q]
                for q in range(n, width):
                    B[stop, j, q - n] += value * moved[i, q]
            else:
                c[stop, j - n] += value * sums[g, m, i]
                for q in range(n, width):
                    D[stop, j - n, q - n] += value * moved[i, q]
        squares[stop] += sums[g, m, m]
