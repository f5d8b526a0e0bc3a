"""The sums of :mod:`detect.align.model`, compiled by numba: the same arguments, the same results to half a per cent.

Importing this module needs numba (the extra ``fast``); :func:`detect.align.solve.align` falls back to numpy.

A tag's pixels are first collected (once for several steps, as they stay nearly the same), then summed in blocks: every
loop over a block is short, without branches and in single precision, so that the compiler turns it into vector
instructions. Module edges near a pixel enter by partial
summation, ``sum_k E_k (Phi_k - Phi_k+1) = E_0 + sum_e Phi_e (E_e+1 - E_e)``, which needs the differences of the
modules along u, along v and along both only.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from detect.align.model import LEAST_GAIN, MIDDLE, NEAR_SIGMAS, PARAMETERS, SQUARES, Frame, Sums, no_sums
from detect.align.pattern import Array

_NEAR = 3.5
_REACH = np.float32(4.5)
_BLOCK = 64
_MOST = 16
"""Edges across a tag, at most."""
_ROWS = 16
"""Rows of the Jacobian: the parameters, the residual, and one that stays zero."""
_OF_PIXEL = 7
"""x, y, u, v, grey level, column and row of a collected pixel."""
_OF_EDGE = 6
"""Rows an edge takes: Phi with its kurtosis, its slope, widening, tail, density, distance."""
_F0, _F05, _F1, _F2, _F3, _F6 = (np.float32(x) for x in (0, 0.5, 1, 2, 3, 6))
_F24TH, _ROOT = np.float32(1 / 24), np.float32(1 / np.sqrt(2 * np.pi))
# Abramowitz and Stegun 26.2.17, |error| < 7.5e-8
_P = np.float32(0.2316419)
_B1, _B2, _B3, _B4, _B5 = (np.float32(x) for x in (0.319381530, -0.356563782, 1.781477937, -1.821255978, 1.330274429))
_32ND = np.float32(-1 / 32)
_E2, _E3, _E4, _E5, _E6 = (np.float32(x) for x in (1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720))


def accumulate(  # noqa: PLR0917 - as the reference
    frame: Frame,
    cells: Array,
    rows: NDArray[np.int64],
    theta: Array,
    place: Array,
    boxes: NDArray[np.int64],
    margin: Array,
    stride: NDArray[np.int64],
) -> Sums:
    """Return the normal equations of tags at their present parameters; see :func:`detect.align.model.accumulate`."""
    sums = no_sums(len(rows), cells)
    _run(
        frame.grey, frame.tone, is_linear(frame.tone), frame.lens, cells, rows, theta, place, boxes, margin, stride,
        sums.normal, sums.gradient, sums.stats, sums.blocks,
    )  # fmt: skip
    return sums


def squares(  # noqa: PLR0917 - as the reference
    frame: Frame,
    cells: Array,
    rows: NDArray[np.int64],
    theta: Array,
    place: Array,
    boxes: NDArray[np.int64],
    margin: Array,
    stride: NDArray[np.int64],
    square_px: NDArray[np.int64],
) -> tuple[Array, Array]:
    """Return the normal equations of each square of the image apart; see :func:`detect.align.model.squares`."""
    normal = np.zeros((len(rows), SQUARES**2, PARAMETERS, PARAMETERS))
    gradient = np.zeros((len(rows), SQUARES**2, PARAMETERS))
    _squares(
        frame.grey, frame.tone, is_linear(frame.tone), frame.lens, cells, rows, theta, place, boxes, margin, stride,
        square_px, normal, gradient,
    )  # fmt: skip
    return normal, gradient


def is_linear(tone: Array) -> bool:
    """Return whether a tone curve is the identity."""
    return bool(len(tone) == 2 and tone[0] == 0 and tone[1] == 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _run(  # noqa: PLR0917 - arrays in, arrays out
    grey: Any, tone: Any, linear: Any, lens: Any, cells: Any, rows: Any, theta: Any, place: Any, boxes: Any,
    margin: Any,
    stride: Any, normal: Any, gradient: Any, stats: Any, blocks: Any,
) -> None:  # fmt: skip
    for k in range(len(rows)):
        if not np.all(np.isfinite(theta[k])):
            continue
        pixels = room(boxes[k])
        n = collect(grey, lens, cells[rows[k]], theta[k], place[k], boxes[k], margin[k], stride[k], pixels)
        jac = differentiate(tone, linear, cells[rows[k]], theta[k], place[k], pixels, n, stats[k])
        add_blocks(pixels, n, jac, blocks[k])
        add_products(jac, normal[k], gradient[k])


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _line(lens: Any, theta: Any, place: Any, first: Any, row: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill x, y, u and v of the pixels of a row, from the first column on."""
    h0, h1, h2, h3, h4, h5, h6, h7 = theta[0], theta[1], theta[2], theta[3], theta[4], theta[5], theta[6], theta[7]
    centre_x, centre_y, a1, a2, a3, per_px2 = lens[0], lens[1], lens[2], lens[3], lens[5], lens[4] * lens[4]
    place_x, place_y, scale = place[0], place[1], place[2]
    # the chart about the tag's centre
    dx, dy = place_x - centre_x, place_y - centre_y
    q = (dx * dx + dy * dy) * per_px2
    slope = -2 * per_px2 * (a1 + q * (2 * a2 + q * (3 * a3)))
    bx, by, D = slope * dx, slope * dy, 1 + q * (a1 + q * (3 * a2 + q * (5 * a3)))
    dy = row - centre_y
    rest = 1 - by * dy
    for i in range(out.shape[1]):
        dx = np.float64(first + i) - centre_x
        q = (dx * dx + dy * dy) * per_px2
        f = D / (rest - bx * dx - q * (a1 + q * (a2 + q * a3)))
        x = (centre_x + dx * f - place_x) * scale
        y = (centre_y + dy * f - place_y) * scale
        w = 1 / (h6 * x + h7 * y + 1)
        out[0, i] = x
        out[1, i] = y
        out[2, i] = (h0 * x + h1 * y + h2) * w
        out[3, i] = (h3 * x + h4 * y + h5) * w


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def collect(  # noqa: PLR0917
    grey: Any, lens: Any, cells: Any, theta: Any, place: Any, box: Any, margin: Any, stride: Any, into: Any
) -> int:
    """Write x, y, u, v, grey level, column and row of the pixels that count; return how many."""
    wide_u, wide_v = _widths(theta, place)
    near_u, near_v = NEAR_SIGMAS * wide_u, NEAR_SIGMAS * wide_v
    modules = cells.shape[0] - 2
    every, shift, every_near = stride[0], stride[1], stride[2]
    line = np.empty((4, max(box[1] - box[0], 1)))
    n = 0
    for row in range(box[2], box[3]):
        _line(lens, theta, place, box[0], row, line)
        to_chosen = (row * shift) % every
        to_near = (every_near - (box[0] + row) % every_near) % every_near
        column = box[0]
        while column < box[1]:
            ahead = min(to_chosen, to_near)
            if ahead > 0:
                column += ahead
                to_chosen -= ahead
                to_near -= ahead
                continue
            chosen = to_chosen == 0
            at = column
            column += 1
            to_chosen = every - 1 if chosen else to_chosen - 1
            to_near = every_near - 1 if to_near == 0 else to_near - 1
            i = at - box[0]
            u, v = line[2, i], line[3, i]
            if not (u > -margin and u < modules + margin and v > -margin and v < modules + margin):
                continue
            if not chosen:
                # beside the lattice only pixels count that an edge between black and white crosses
                at_u, at_v = int(u + 1), int(v + 1)
                edge_u, edge_v = int(u + 1.5) - 1, int(v + 1.5) - 1
                crossed = (
                    abs(u - edge_u) < near_u
                    and edge_u >= 0
                    and edge_u <= modules
                    and cells[at_v, edge_u] != cells[at_v, edge_u + 1]
                ) or (
                    abs(v - edge_v) < near_v
                    and edge_v >= 0
                    and edge_v <= modules
                    and cells[edge_v, at_u] != cells[edge_v + 1, at_u]
                )
                if not crossed:
                    continue
            into[0, n], into[1, n], into[2, n], into[3, n], into[4, n] = line[0, i], line[1, i], u, v, grey[row, at]
            into[5, n], into[6, n] = at, row
            n += 1
    return n


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _edge(place: Any, inverse: Any, first: Any, e: Any, k: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill what a module edge does to each pixel of a block, a row for each of the six figures."""
    shift, k24 = np.float32(e), np.float32(k) * _F24TH
    for p in range(_BLOCK):
        a = min(max((place[p] - (first[p] + shift)) * inverse[p], -_REACH), _REACH)
        a2 = a * a
        x = a2 * _32ND
        g = _F1 + x * (_F1 + x * (_E2 + x * (_E3 + x * (_E4 + x * (_E5 + x * _E6)))))
        g = g * g
        g = g * g
        g = g * g
        density = g * g * _ROOT
        t = _F1 / (_F1 + _P * abs(a))
        far = density * t * (_B1 + t * (_B2 + t * (_B3 + t * (_B4 + t * _B5))))
        step = _F1 - far if a > _F0 else far
        tail = -(a2 - _F3) * a * density * _F24TH
        full = density * (_F1 + k24 * (a2 * (a2 - _F6) + _F3))
        out[0, p] = step + np.float32(k) * tail
        out[1, p] = full
        out[2, p] = -a * full
        out[3, p] = tail
        out[4, p] = density
        out[5, p] = a


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _across(weight: Any, edge: Any, sums: Any) -> None:
    """Add an edge along u, times the difference of the modules there, to the sums along a row of modules."""
    for p in range(_BLOCK):
        c = weight[p]
        d = c * edge[4, p]
        da = d * edge[5, p]
        sums[0, p] += c * edge[0, p]
        sums[1, p] += c * edge[1, p]
        sums[2, p] += c * edge[2, p]
        sums[3, p] += c * edge[3, p]
        sums[4, p] += d
        sums[5, p] += da
        sums[6, p] += da * edge[5, p]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _down(sums: Any, edge: Any, rho: Any, total: Any) -> None:
    """Add an edge along v, times the sums along u of the differences there, to P and its derivatives."""
    for p in range(_BLOCK):
        s, b = sums[0, p], edge[5, p]
        d = rho[p] * edge[4, p]
        db = d * b
        total[0, p] += edge[0, p] * s + d * sums[4, p] + _F05 * rho[p] * db * sums[5, p]
        total[1, p] += edge[0, p] * sums[1, p] - d * sums[5, p]
        total[2, p] += edge[1, p] * s - db * sums[4, p]
        total[3, p] += edge[0, p] * sums[2, p] + edge[2, p] * s + d * sums[6, p] + db * b * sums[4, p]
        total[4, p] += edge[0, p] * sums[3, p] + edge[3, p] * s


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _geometry(theta: Any, sigma: Any, at: Any, geometry: Any) -> None:
    """Fill 1 / w, 1 / s_u, 1 / s_v and the correlation of the blur on the tag."""
    h0, h1, h3, h4 = np.float32(theta[0]), np.float32(theta[1]), np.float32(theta[3]), np.float32(theta[4])
    h6, h7, inverse = np.float32(theta[6]), np.float32(theta[7]), np.float32(1 / sigma)
    limit = np.float32(0.9)
    for p in range(_BLOCK):
        w = _F1 / (h6 * at[0, p] + h7 * at[1, p] + _F1)
        ux, uy = (h0 - at[2, p] * h6) * w, (h1 - at[2, p] * h7) * w
        vx, vy = (h3 - at[3, p] * h6) * w, (h4 - at[3, p] * h7) * w
        u, v = _F1 / np.sqrt(ux * ux + uy * uy), _F1 / np.sqrt(vx * vx + vy * vy)
        geometry[0, p] = w
        geometry[1, p] = u * inverse
        geometry[2, p] = v * inverse
        geometry[3, p] = min(max((ux * vx + uy * vy) * u * v, -limit), limit)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _jacobian(light: Any, at: Any, geometry: Any, total: Any, bend: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill the rows of the Jacobian; ``bend`` is the tone curve's slope, 0 for what fills up the last block."""
    gain, slope_x, slope_y, kappa = (
        np.float32(light[1]), np.float32(light[2]), np.float32(light[3]), np.float32(light[4])
    )  # fmt: skip
    # short loops: of one with all of these rows the compiler does not see that they lie apart
    for p in range(_BLOCK):
        factor = (gain + slope_x * at[0, p] + slope_y * at[1, p]) * bend[p]
        out[12, p] = factor * total[3, p]
        out[13, p] = factor * total[4, p]
        out[2, p] = factor * total[1, p] * geometry[1, p] * geometry[0, p]
        out[5, p] = factor * total[2, p] * geometry[2, p] * geometry[0, p]
    for k in (0, 3):
        for p in range(_BLOCK):
            out[k, p] = out[k + 2, p] * at[0, p]
            out[k + 1, p] = out[k + 2, p] * at[1, p]
    for p in range(_BLOCK):
        both = -(out[2, p] * at[2, p] + out[5, p] * at[3, p])
        out[6, p] = both * at[0, p]
        out[7, p] = both * at[1, p]
    for p in range(_BLOCK):
        lit = (total[0, p] + kappa) * bend[p]
        out[8, p] = bend[p]
        out[9, p] = total[0, p] * bend[p]
        out[10, p] = at[0, p] * lit
        out[11, p] = at[1, p] * lit


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _widths(theta: Any, place: Any) -> Any:
    """Return the blur's deviations along u and v at the tag's centre, modules."""
    sigma = np.exp(theta[12]) * place[2]
    u0, u1 = theta[0] - theta[2] * theta[6], theta[1] - theta[2] * theta[7]
    v0, v1 = theta[3] - theta[5] * theta[6], theta[4] - theta[5] * theta[7]
    return sigma * np.sqrt(u0 * u0 + u1 * u1), sigma * np.sqrt(v0 * v0 + v1 * v1)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _module_differences(cells: Any, out: Any) -> None:
    """Fill a tag's modules (row 0, rows of modules one after the other) and their differences along u, v and both."""
    side = cells.shape[0]
    for j in range(side):
        for i in range(side):
            out[0, j * side + i] = cells[j, i]
    for k in range(side * side - 1):
        out[1, k] = out[0, k + 1] - out[0, k]
    for k in range(side * side - side):
        out[2, k] = out[0, k + side] - out[0, k]
        out[3, k] = out[1, k + side] - out[1, k]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _residuals(at: Any, light: Any, tone: Any, linear: Any, total: Any, used: Any, bend: Any, out: Any, stats: Any) -> None:  # fmt: skip  # noqa: PLR0917, E501
    """Fill the residuals of a block and the tone curve's slope, both 0 behind the used pixels; add to the sums."""
    offset, gain, slope_x, slope_y, kappa = (
        np.float32(light[0]), np.float32(light[1]), np.float32(light[2]), np.float32(light[3]), np.float32(light[4])
    )  # fmt: skip
    shown = bend  # for a moment
    for p in range(_BLOCK):
        lit = offset + gain * total[0, p] + (slope_x * at[0, p] + slope_y * at[1, p]) * (total[0, p] + kappa)
        shown[p] = lit
    r2, y1, y2, p1, p2 = _F0, _F0, _F0, _F0, _F0
    if linear:
        for p in range(_BLOCK):
            lit, live = shown[p], _F1 if p < used else _F0
            value, predicted = at[4, p] * live, min(max(lit, _F0), _F1) * live
            r = value - predicted
            out[p] = r
            bend[p] = live if lit >= _F0 and lit < _F1 else _F0
            r2 += r * r
            y1 += value
            y2 += value * value
            p1 += predicted
            p2 += predicted * predicted
    else:
        last = len(tone) - 1
        for p in range(used):
            lit = np.float64(shown[p])
            t = min(max(lit * last, 0.0), last - 1e-9)
            i = int(t)
            step = tone[i + 1] - tone[i]
            value, predicted = at[4, p], np.float32(tone[i] + (t - i) * step)
            r = value - predicted
            out[p] = r
            bend[p] = step * last if lit >= 0 and lit < 1 else 0.0
            r2 += r * r
            y1 += value
            y2 += value * value
            p1 += predicted
            p2 += predicted * predicted
        for p in range(used, _BLOCK):
            out[p] = _F0
            bend[p] = _F0
    stats[1] += r2
    stats[2] += y1
    stats[3] += y2
    stats[4] += p1
    stats[5] += p2


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def replace_pixels(theta: Any, pixels: Any, n: Any) -> None:
    """Fill u and v of collected pixels anew."""
    h0, h1, h2, h3, h4, h5, h6, h7 = theta[0], theta[1], theta[2], theta[3], theta[4], theta[5], theta[6], theta[7]
    for p in range(n):
        x, y = np.float64(pixels[0, p]), np.float64(pixels[1, p])
        w = 1 / (h6 * x + h7 * y + 1)
        pixels[2, p] = (h0 * x + h1 * y + h2) * w
        pixels[3, p] = (h3 * x + h4 * y + h5) * w


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def differentiate(  # noqa: PLR0915, PLR0917 - arrays in, arrays out
    tone: Any, linear: Any, cells: Any, theta: Any, place: Any, pixels: Any, n: Any, stats: Any
) -> Any:
    """Return the Jacobian of collected pixels, (B, 16, 64), residuals in row 14; add to the sums of residuals."""
    modules = cells.shape[0] - 2
    side = cells.shape[0]
    wide_u, wide_v = _widths(theta, place)
    # edges in reach of a place, by the blur at the tag's centre
    count_u = min(int(2 * _NEAR * wide_u) + 1, modules + 1, _MOST)
    count_v = min(int(2 * _NEAR * wide_v) + 1, modules + 1, _MOST)
    sigma = np.exp(theta[12]) * place[2]
    kappa = theta[8] / theta[9] if abs(theta[9]) > 1e-9 else 0.0
    light = (theta[8], theta[9], theta[10], theta[11], kappa)
    parts = (n + _BLOCK - 1) // _BLOCK
    jac = np.empty((parts, _ROWS, _BLOCK), np.float32)
    at = np.empty((5, _BLOCK), np.float32)
    geometry = np.empty((4, _BLOCK), np.float32)
    first_u, first_v = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    corner = np.empty(_BLOCK, np.uint32)
    edges_u = np.empty((count_u, _OF_EDGE, _BLOCK), np.float32)
    edge_v = np.empty((_OF_EDGE, _BLOCK), np.float32)
    weight, bend = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    sums, total = np.empty((7, _BLOCK), np.float32), np.empty((5, _BLOCK), np.float32)
    table = np.zeros((4, side * side), np.float32)
    _module_differences(cells, table)
    flat, along_u, along_v, along_both = table[0], table[1], table[2], table[3]
    half_u, half_v = 65 - 0.5 * count_u, 65 - 0.5 * count_v
    for part in range(parts):
        begin = part * _BLOCK
        used = min(_BLOCK, n - begin)
        for k in range(5):
            for p in range(used):
                at[k, p] = pixels[k, begin + p]
            for p in range(used, _BLOCK):
                at[k, p] = pixels[k, begin]
        for p in range(_BLOCK):
            i = min(max(int(at[2, p] + half_u) - 64, 0), modules + 1 - count_u)
            j = min(max(int(at[3, p] + half_v) - 64, 0), modules + 1 - count_v)
            first_u[p], first_v[p] = i, j
            corner[p] = j * side + i
        _geometry(theta, sigma, at, geometry)
        total[:] = 0
        sums[:] = 0
        for e in range(count_u):
            _edge(at[2], geometry[1], first_u, e, theta[13], edges_u[e])
            for p in range(_BLOCK):
                weight[p] = along_u[corner[p] + e]
            _across(weight, edges_u[e], sums)
        for p in range(_BLOCK):
            total[0, p] = flat[corner[p]] + sums[0, p]
            total[1, p] = sums[1, p]
            total[3, p] = sums[2, p]
            total[4, p] = sums[3, p]
        for f in range(count_v):
            _edge(at[3], geometry[2], first_v, f, theta[13], edge_v)
            sums[:] = 0
            for e in range(count_u):
                beyond = f * side + e
                for p in range(_BLOCK):
                    weight[p] = along_both[corner[p] + beyond]
                _across(weight, edges_u[e], sums)
            for p in range(_BLOCK):
                sums[0, p] += along_v[corner[p] + f * side]
            _down(sums, edge_v, geometry[3], total)
        into = jac[part]
        _residuals(at, light, tone, linear, total, used, bend, into[14], stats)
        into[15] = 0
        _jacobian(light, at, geometry, total, bend, into)
    stats[0] += n
    return jac


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_blocks(pixels: Any, n: Any, jac: Any, blocks: Any) -> None:
    """Add the residuals of collected pixels to the sums over modules."""
    side = blocks.shape[0]
    for p in range(n):
        i = min(max(int(pixels[2, p] + 1), 0), side - 1)
        j = min(max(int(pixels[3, p] + 1), 0), side - 1)
        blocks[j, i, 0] += jac[p // _BLOCK, 14, p % _BLOCK]
        blocks[j, i, 1] += 1


@njit(cache=True, nogil=True, error_model="numpy")
def first_light(tone: Any, cells: Any, pixels: Any, n: Any, theta: Any) -> None:
    """Set offset and gain of a tag from its collected pixels; see :func:`detect.align.model.first_light`."""
    total, count = np.zeros(2), np.zeros(2)
    for p in range(n):
        u, v = pixels[2, p] + np.float32(1), pixels[3, p] + np.float32(1)
        i, j = int(u), int(v)
        if abs(u - i - 0.5) < MIDDLE and abs(v - j - 0.5) < MIDDLE:
            kind = 1 if cells[j, i] > 0.5 else 0
            total[kind] += pixels[4, p]
            count[kind] += 1
    if count[0] > 0 and count[1] > 0:
        levels = np.interp(total / count, tone, np.linspace(0.0, 1.0, len(tone)))
        theta[8], theta[9] = levels[0], max(levels[1] - levels[0], LEAST_GAIN)


@njit(cache=True, nogil=True, error_model="numpy")
def room(box: Any) -> Any:
    """Return an array to collect the pixels of a box in."""
    return np.empty((_OF_PIXEL, max(box[1] - box[0], 0) * max(box[3] - box[2], 0)), np.float32)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_products(jac: Any, normal: Any, gradient: Any) -> None:
    """Fill the normal matrix and the gradient, four products of rows at a time."""
    for i in range(0, PARAMETERS, 2):
        for j in range(i, _ROWS, 2):
            a, b, c, d = _F0, _F0, _F0, _F0
            for part in range(len(jac)):
                rows = jac[part]
                for p in range(_BLOCK):
                    a += rows[i, p] * rows[j, p]
                    b += rows[i, p] * rows[j + 1, p]
                    c += rows[i + 1, p] * rows[j, p]
                    d += rows[i + 1, p] * rows[j + 1, p]
            if j == PARAMETERS:
                gradient[i], gradient[i + 1] = a, c
            else:
                normal[i, j], normal[i, j + 1], normal[i + 1, j], normal[i + 1, j + 1] = a, b, c, d
                normal[j, i], normal[j + 1, i], normal[j, i + 1], normal[j + 1, i + 1] = a, b, c, d


@njit(cache=True, nogil=True, error_model="numpy")
def _squares(  # noqa: PLR0917
    grey: Any, tone: Any, linear: Any, lens: Any, cells: Any, rows: Any, theta: Any, place: Any, boxes: Any,
    margin: Any, stride: Any, square_px: Any, normal: Any, gradient: Any,
) -> None:  # fmt: skip
    stats = np.zeros(6)
    for k in range(len(rows)):
        if not np.all(np.isfinite(theta[k])):
            continue
        pixels = room(boxes[k])
        n = collect(grey, lens, cells[rows[k]], theta[k], place[k], boxes[k], margin[k], stride[k], pixels)
        jac = differentiate(tone, linear, cells[rows[k]], theta[k], place[k], pixels, n, stats)
        side = square_px[k]
        left, top = boxes[k, 0] // side, boxes[k, 2] // side
        row = np.empty(_ROWS, np.float32)
        for p in range(n):
            i = min(int(pixels[5, p]) // side - left, SQUARES - 1)
            j = min(int(pixels[6, p]) // side - top, SQUARES - 1)
            at = j * SQUARES + i
            for a in range(_ROWS):
                row[a] = jac[p // _BLOCK, a, p % _BLOCK]
            for a in range(PARAMETERS):
                for b in range(PARAMETERS):
                    normal[k, at, a, b] += row[a] * row[b]
                gradient[k, at, a] += row[a] * row[14]
