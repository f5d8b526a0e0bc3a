"""The sums of :mod:`boxcal.detect.alignment.registration.image_model`.

The same arguments, the same results to half a per cent.

A tag's pixels are first collected (:mod:`boxcal.detect.alignment.numba.pixels`), then summed in blocks
(:mod:`boxcal.detect.alignment.numba.edges`).
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.arrays import clear, put
from boxcal.detect.alignment.numba.edges import OF_EDGE, across, blur_geometry, down, edge, jacobian
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.pixels import BLOCK, widths
from boxcal.detect.alignment.registration.parameters import PARAMETERS

ROWS = 16
"""Rows of the Jacobian: the parameters, the residual, and one that stays zero."""
_NEAR = 3.5
_MOST = 16
"""Edges across a tag, at most."""
_F0, _F05, _F1 = np.float32(0), np.float32(0.5), np.float32(1)
_I0, _U1 = np.int32(0), np.uint64(1)
_UNDER_1 = np.float32(1 - 2**-20)
"""The light that saturates, and still lies within the last step of a table."""


@loops(fastmath=True)
def _residuals(  # noqa: PLR0917
    at: Any, light: Any, batch: Any, total: Any, used: Any, shown: Any, places: Any, response_slope: Any, out: Any,
    stats: Any,
) -> None:  # fmt: skip
    """Fill the residuals of a block and the response curve's slope, both 0 behind the used pixels; add to the sums.

    ``shown`` and ``places`` are room for as many figures.
    """
    offset, gain, slope_x, slope_y, kappa = (
        np.float32(light[0]), np.float32(light[1]), np.float32(light[2]), np.float32(light[3]), np.float32(light[4])
    )  # fmt: skip
    for p in range(BLOCK):
        value = total[p]
        shown[p] = offset + gain * value + (slope_x * at[p] + slope_y * at[BLOCK + p]) * (value + kappa)
    if batch.linear:
        for p in range(BLOCK):
            lit = shown[p]
            shown[p] = min(max(lit, _F0), _F1)
            response_slope[p] = _F1 if lit >= _F0 and lit < _F1 else _F0
    else:
        _through_table(batch.response, shown, response_slope, out, places)
    r2, y1, y2, p1, p2 = _F0, _F0, _F0, _F0, _F0
    for p in range(BLOCK):
        live = _F1 if p < used else _F0
        value, predicted = at[4 * BLOCK + p] * live, shown[p] * live
        r = value - predicted
        out[p] = r
        response_slope[p] *= live
        r2 += r * r
        y1 += value
        y2 += value * value
        p1 += predicted
        p2 += predicted * predicted
    stats[1] += r2
    stats[2] += y1
    stats[3] += y2
    stats[4] += p1
    stats[5] += p2


@loops(fastmath=True)
def _through_table(response: Any, shown: Any, response_slope: Any, step: Any, places: Any) -> None:
    """Replace light by grey levels, and fill the response curve's slopes there; the last two are room for as many."""
    last, most = np.float32(len(response) - 1), np.int32(len(response) - 2)
    for p in range(BLOCK):
        t = min(max(shown[p], _F0), _UNDER_1) * last
        response_slope[p] = t
        places[p] = min(max(np.int32(t), _I0), most)  # what is not finite has no place in the table
    for p in range(BLOCK):  # apart, as no vector instruction reads a table
        i = np.uint64(places[p])
        shown[p] = response[i]
        step[p] = response[i + _U1]
    for p in range(BLOCK):
        t, low = response_slope[p], shown[p]
        rise = step[p] - low
        shown[p] = low + (t - np.floor(t)) * rise
        response_slope[p] = rise * last if t > _F0 and t < last * _UNDER_1 else _F0


@loops(fastmath=True)
def _gather(table: Any, corner: Any, beyond: Any, weight: Any) -> None:
    """Fill weights from a table, so far beyond the first modules in reach."""
    shift = np.uint64(beyond)  # numba looks whether other numbers are negative, and counts from the end
    for p in range(BLOCK):
        weight[p] = table[np.uint64(corner[p]) + shift]


@kernel(inner=True, fastmath=True)
def differentiate(batch: Any, tag: Any, table: Any, pixels: Any, n: Any, stats: Any) -> Any:  # noqa: PLR0917
    """Return the Jacobian of collected pixels, (16, 64 B), residuals in row 14; add to the sums of residuals.

    ``table`` holds the tag's modules and their differences.
    """
    theta, normalisation, side = batch.theta[tag], batch.normalisation[tag], batch.cells.shape[1]
    modules = side - 2
    wide_u, wide_v = widths(theta, normalisation)
    # edges in reach of a normalisation, by the blur at the tag's centre
    count_u = min(int(2 * _NEAR * wide_u) + 1, modules + 1, _MOST)
    count_v = min(int(2 * _NEAR * wide_v) + 1, modules + 1, _MOST)
    sigma = np.exp(theta[12]) * normalisation[2]
    kappa = theta[8] / theta[9] if abs(theta[9]) > 1e-9 else 0.0
    light = (theta[8], theta[9], theta[10], theta[11], kappa)
    parts = (n + BLOCK - 1) // BLOCK
    jac, rows = np.empty((ROWS, parts * BLOCK), np.float32), np.empty(ROWS * BLOCK, np.float32)
    clear(rows[(ROWS - 1) * BLOCK :])
    geometry = np.empty(4 * BLOCK, np.float32)
    first_u, first_v = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    corner = np.empty(BLOCK, np.uint32)
    edges_u, edge_v = np.empty(count_u * OF_EDGE, np.float32), np.empty(OF_EDGE, np.float32)
    weight, response_slope = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    sums, total = np.empty(7 * BLOCK, np.float32), np.empty(5 * BLOCK, np.float32)
    flat, along_u, along_v, along_both = table[0], table[1], table[2], table[3]
    half_u, half_v = _F1 - _F05 * np.float32(count_u), _F1 - _F05 * np.float32(count_v)
    last_u, last_v = np.float32(modules + 1 - count_u), np.float32(modules + 1 - count_v)
    width, farthest = np.float32(side), np.int32(last_v * np.float32(side) + last_u)
    per_su, per_sv, rho = geometry[BLOCK : 2 * BLOCK], geometry[2 * BLOCK : 3 * BLOCK], geometry[3 * BLOCK :]
    for part in range(parts):
        at, used = pixels[part], min(BLOCK, n - part * BLOCK)
        u, v = at[2 * BLOCK : 3 * BLOCK], at[3 * BLOCK : 4 * BLOCK]
        for p in range(BLOCK):
            i = min(max(np.floor(u[p] + half_u), _F0), last_u)
            j = min(max(np.floor(v[p] + half_v), _F0), last_v)
            first_u[p] = i
            first_v[p] = j
            corner[p] = min(max(np.int32(j * width + i), _I0), farthest)
        blur_geometry(theta, sigma, batch.blur, at, geometry)
        clear(sums)
        for e in range(count_u):
            along = edges_u[e * OF_EDGE : (e + 1) * OF_EDGE]
            edge(u, per_su, first_u, e, theta[13], along)
            _gather(along_u, corner, e, weight)
            across(weight, along, sums)
        _gather(flat, corner, 0, weight)
        _begin_total(weight, sums, total)
        for f in range(count_v):
            edge(v, per_sv, first_v, f, theta[13], edge_v)
            clear(sums)
            for e in range(count_u):
                _gather(along_both, corner, f * side + e, weight)
                across(weight, edges_u[e * OF_EDGE : (e + 1) * OF_EDGE], sums)
            _gather(along_v, corner, f * side, weight)
            for p in range(BLOCK):
                sums[p] += weight[p]
            down(sums, edge_v, rho, total)
        _residuals(at, light, batch, total, used, weight, corner, response_slope, rows[PARAMETERS * BLOCK :], stats)
        jacobian(light, at, geometry, total, response_slope, rows)
        for row in range(ROWS):
            put(jac[row, part * BLOCK : (part + 1) * BLOCK], rows[row * BLOCK : (row + 1) * BLOCK])
    stats[0] += n
    return jac


@loops(fastmath=True)
def _begin_total(flat: Any, sums: Any, total: Any) -> None:
    """Fill P and its derivatives by u, v, log sigma and kurtosis as the edges along u alone make them."""
    for p in range(BLOCK):
        total[p] = flat[p] + sums[p]
        total[BLOCK + p] = sums[BLOCK + p]
        total[2 * BLOCK + p] = _F0
        total[3 * BLOCK + p] = sums[2 * BLOCK + p]
        total[4 * BLOCK + p] = sums[3 * BLOCK + p]


@loops(fastmath=True)
def add_products(jac: Any, normal: Any, gradient: Any) -> None:
    """Fill the normal matrix and the gradient, four products of rows at a time."""
    for i in range(0, PARAMETERS, 2):
        for j in range(i, ROWS, 2):
            a, b, c, d = _F0, _F0, _F0, _F0
            left, left_1, right, right_1 = jac[i], jac[i + 1], jac[j], jac[j + 1]
            for p in range(jac.shape[1]):
                a += left[p] * right[p]
                b += left[p] * right_1[p]
                c += left_1[p] * right[p]
                d += left_1[p] * right_1[p]
            if j == PARAMETERS:
                gradient[i], gradient[i + 1] = a, c
            else:
                normal[i, j], normal[i, j + 1], normal[i + 1, j], normal[i + 1, j + 1] = a, b, c, d
                normal[j, i], normal[j + 1, i], normal[j, i + 1], normal[j + 1, i + 1] = a, b, c, d
