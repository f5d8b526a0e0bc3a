"""The sums of :mod:`boxcal.detect.alignment.registration.image_model`.

The same arguments, the same results to half a per cent.

A tag's pixels are first collected (:mod:`boxcal.detect.alignment.numba.pixels`), then summed in blocks
(:mod:`boxcal.detect.alignment.numba.edges`).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.numba.arrays import aligned, clear, put
from boxcal.detect.alignment.numba.edges import OF_EDGE, blur_geometry, cross, edge, jacobian
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.pixels import BLOCK, GREY, RESIDUAL, U, V, Y, widths
from boxcal.detect.alignment.registration.parameters import PARAMETERS

ROWS = 16
"""Rows of the Jacobian: the parameters, the residual, and one that stays zero."""
_RESIDUALS = PARAMETERS * BLOCK
_PER_SU, _PER_SV, _RHO, _FIRST_U, _FIRST_V = (k * BLOCK for k in range(1, 6))
"""Where rows of what a block's pixels see of the blur begin after the first."""
_NEAR = 3.5
_MOST = 16
"""Edges across a tag, at most."""
_F0, _F05, _F1 = np.float32(0), np.float32(0.5), np.float32(1)
_I0, _U1 = np.int32(0), np.uint64(1)
_UNDER_1 = np.float32(1 - 2**-20)
"""The light that saturates, and still lies within the last step of a table."""


class Work(NamedTuple):
    """Room for what is made of a block of pixels, a row of 64 for each figure one after the other.

    Attributes
    ----------
    rows : (16 * 64,)
        Of the Jacobian.
    total : (5 * 64,)
        P and its derivatives.
    geometry : (6 * 64,)
        1 / w, 1 / s_u, 1 / s_v, correlation of the blur on the tag, first edges in reach along u and along v.
    weights : (4 * 64,)
        Differences of modules along u, along v and along both, and modules.
    shown, response_slope : (64,)
        Light, and then grey levels; the response curve's slope.
    edge_v, edges_u : (7 * 64,), (16 * 7 * 64,)
        An edge along v and those along u, see :func:`boxcal.detect.alignment.numba.edges.edge`.
    corner : (64,)
        Place of the modules before the first edges in reach in a table.
    """

    rows: NDArray[np.float32]
    total: NDArray[np.float32]
    geometry: NDArray[np.float32]
    weights: NDArray[np.float32]
    shown: NDArray[np.float32]
    response_slope: NDArray[np.float32]
    edge_v: NDArray[np.float32]
    edges_u: NDArray[np.float32]
    corner: NDArray[np.uint32]


_OF_WORK = tuple(int(k) * BLOCK for k in np.cumsum([ROWS, 5, 6, 4, 1, 1, 7, 7 * _MOST]))
"""Where the parts of the room to work end."""


@kernel(inner=True)
def room_to_work() -> Work:
    """Return room for what is made of a block of pixels."""
    room, corner = aligned(_OF_WORK[-1]), np.empty(BLOCK, np.uint32)
    clear(room[: _OF_WORK[0]])
    return Work(
        room[: _OF_WORK[0]],
        room[_OF_WORK[0] : _OF_WORK[1]],
        room[_OF_WORK[1] : _OF_WORK[2]],
        room[_OF_WORK[2] : _OF_WORK[3]],
        room[_OF_WORK[3] : _OF_WORK[4]],
        room[_OF_WORK[4] : _OF_WORK[5]],
        room[_OF_WORK[5] : _OF_WORK[6]],
        room[_OF_WORK[6] :],
        corner,
    )


@loops(fastmath=True, forceinline=True)
def _residuals(at: Any, light: Any, used: Any, linear: Any, response: Any, work: Any) -> None:  # noqa: PLR0917
    """Fill the residuals of a block and the response curve's slope, both 0 behind the used pixels."""
    offset, gain, slope_x, slope_y, kappa = light
    total, shown, response_slope, residual = work.total, work.shown, work.response_slope, work.rows[_RESIDUALS:]
    for p in range(BLOCK):
        value = total[p]
        shown[p] = offset + gain * value + (slope_x * at[p] + slope_y * at[Y + p]) * (value + kappa)
    if linear:
        for p in range(BLOCK):
            lit = shown[p]
            shown[p] = min(max(lit, _F0), _F1)
            response_slope[p] = _F1 if lit >= _F0 and lit < _F1 else _F0
    else:
        _through_table(response, shown, response_slope, work.corner, work.weights)
    for p in range(BLOCK):
        live = _F1 if np.int32(p) < used else _F0
        r = (at[GREY + p] - shown[p]) * live
        residual[p] = r
        response_slope[p] *= live
    put(at[RESIDUAL : RESIDUAL + BLOCK], residual[:BLOCK])


@loops(fastmath=True, forceinline=True)
def _through_table(response: Any, shown: Any, response_slope: Any, places: Any, pairs: Any) -> None:
    """Replace light by grey levels, and fill the response curve's slopes there; the last two are room, two a pixel."""
    last, most = np.float32(len(response) - 1), np.int32(len(response) - 2)
    for p in range(BLOCK):
        t = min(max(shown[p], _F0), _UNDER_1) * last
        response_slope[p] = t
        places[p] = min(max(np.int32(t), _I0), most)  # what is not finite has no place in the table
    for p in range(BLOCK):  # apart, as no vector instruction reads a table
        i = np.uint64(places[p])
        low, high = response[i], response[i + _U1]
        pairs[2 * p], pairs[2 * p + 1] = low, high
    for p in range(BLOCK):
        t, low = response_slope[p], pairs[2 * p]
        rise = pairs[2 * p + 1] - low
        shown[p] = low + (t - np.floor(t)) * rise
        response_slope[p] = rise * last if t > _F0 and t < last * _UNDER_1 else _F0


@loops(fastmath=True, forceinline=True)
def _gather(table: Any, corner: Any, beyond: Any, weights: Any) -> None:
    """Fill weights from a table, so far beyond the first modules in reach."""
    shift = np.uint64(beyond)  # numba looks whether other numbers are negative, and counts from the end
    for p in range(BLOCK):
        weights[p] = table[np.uint64(corner[p]) + shift]


@loops(fastmath=True)
def differentiate(batch: Any, tag: Any, differences: Any, pixels: Any, n: Any, work: Any, jac: Any) -> None:  # noqa: PLR0917
    """Fill the Jacobian (16, 64 B) of placed pixels, residuals in row 14, zero in row 15.

    For ``differences`` see :func:`boxcal.detect.alignment.numba.edges.module_differences`.
    """
    theta, side = batch.theta[tag], batch.cells.shape[1]
    modules = side - 2
    wide_u, wide_v = widths(theta, batch.normalisation[tag])
    # edges in reach of a normalisation, by the blur at the tag's centre
    count_u = min(int(2 * _NEAR * wide_u) + 1, modules + 1, _MOST)
    count_v = min(int(2 * _NEAR * wide_v) + 1, modules + 1, _MOST)
    sigma = np.exp(theta[12]) * batch.normalisation[tag, 2]
    kappa = theta[8] / theta[9] if abs(theta[9]) > 1e-9 else 0.0
    light = (
        np.float32(theta[8]),
        np.float32(theta[9]),
        np.float32(theta[10]),
        np.float32(theta[11]),
        np.float32(kappa),
    )
    geometry, corner, weights, total, rows = work.geometry, work.corner, work.weights, work.total, work.rows
    along_u, along_v, along_both, flat = differences[0], differences[1], differences[2], differences[3]
    of_u, of_v = weights[:BLOCK], weights[BLOCK : 2 * BLOCK]
    of_both, of_module = weights[2 * BLOCK : 3 * BLOCK], weights[3 * BLOCK :]
    per_su, per_sv, rho = geometry[_PER_SU:_PER_SV], geometry[_PER_SV:_RHO], geometry[_RHO:_FIRST_U]
    first_u, first_v = geometry[_FIRST_U:_FIRST_V], geometry[_FIRST_V:]
    for part in range((n + BLOCK - 1) // BLOCK):
        at, used = pixels[part], np.int32(min(BLOCK, n - part * BLOCK))
        u, v = at[U : U + BLOCK], at[V : V + BLOCK]
        blur_geometry(theta, sigma, batch.blur, at, geometry)
        _first_in_reach(at, modules, count_u, count_v, first_u, first_v, corner)
        for e in range(count_u):
            edge(u, per_su, first_u, e, theta[13], work.edges_u[e * OF_EDGE : (e + 1) * OF_EDGE])
        for f in range(count_v):
            edge(v, per_sv, first_v, f, theta[13], work.edge_v)
            for e in range(count_u):
                _gather(along_both, corner, f * side + e, of_both)
                if f == 0:
                    _gather(along_u, corner, e, of_u)
                if e == 0:
                    _gather(along_v, corner, f * side, of_v)
                if f == 0 and e == 0:
                    _gather(flat, corner, 0, of_module)
                along = work.edges_u[e * OF_EDGE : (e + 1) * OF_EDGE]
                cross(weights, along, work.edge_v, rho, (e == 0, f == 0), total)
        _residuals(at, light, used, batch.linear, batch.response, work)
        jacobian(light, at, geometry, total, work.response_slope, rows)
        for row in range(ROWS):
            put(jac[row, part * BLOCK : (part + 1) * BLOCK], rows[row * BLOCK : (row + 1) * BLOCK])


@loops(fastmath=True, forceinline=True)
def _first_in_reach(  # noqa: PLR0917
    at: Any, modules: Any, count_u: Any, count_v: Any, first_u: Any, first_v: Any, corner: Any
) -> None:
    """Fill the first edges in reach of a block's pixels, and the place of the modules before them in a table."""
    half_u, half_v = _F1 - _F05 * np.float32(count_u), _F1 - _F05 * np.float32(count_v)
    last_u, last_v = np.float32(modules + 1 - count_u), np.float32(modules + 1 - count_v)
    width = np.float32(modules + 2)
    farthest = np.int32(last_v * width + last_u)
    for p in range(BLOCK):
        i = min(max(np.floor(at[U + p] + half_u), _F0), last_u)
        j = min(max(np.floor(at[V + p] + half_v), _F0), last_v)
        first_u[p] = i
        first_v[p] = j
        corner[p] = min(max(np.int32(j * width + i), _I0), farthest)


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


@loops(fastmath=True)
def sum_of_squares(row: Any) -> Any:
    """Return the sum of the squares of a row of the Jacobian."""
    total = _F0
    for p in range(len(row)):
        total += row[p] * row[p]
    return total
