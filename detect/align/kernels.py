"""The sums of :mod:`detect.align.model`, compiled by numba: the same arguments, the same results to half a per cent.

Importing this module needs numba (the extra ``fast``); :func:`detect.align.solve.accumulator` falls back to numpy.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import ndtr

from detect.align.model import NEAR_SIGMAS, PARAMETERS, Frame, Sums, no_sums
from detect.align.pattern import Array

_REACH = 3.7
_LAST = 1024
_TABLE_AT = np.linspace(-_REACH, _REACH, _LAST + 1)
_STEPS: Array = np.asarray(ndtr(_TABLE_AT))
_STEPS[0], _STEPS[-1] = 0.0, 1.0
_BELLS: Array = np.exp(-0.5 * _TABLE_AT**2) / np.sqrt(2 * np.pi)
_BELLS[0] = _BELLS[-1] = 0.0
_NEAR = 3.5
_MOST = 24
_PADDED = 16
"""Row length of the normal matrix while it is summed: whole vector registers."""


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
    linear = len(frame.tone) == 2 and frame.tone[0] == 0 and frame.tone[1] == 1
    _run(
        frame.grey, frame.tone, linear, frame.lens, cells, rows, theta, place, boxes, margin, stride, _STEPS, _BELLS,
        sums.normal, sums.gradient, sums.stats, sums.blocks,
    )  # fmt: skip
    return sums


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", boundscheck=False)
def _run(  # noqa: PLR0917 - arrays in, arrays out
    grey: Any, tone: Any, linear: Any, lens: Any, cells: Any, rows: Any, theta: Any, place: Any, boxes: Any,
    margin: Any,
    stride: Any, steps: Any, bells: Any, normal: Any, gradient: Any, stats: Any, blocks: Any,
) -> None:  # fmt: skip
    for k in range(len(rows)):
        _one(
            grey, tone, linear, lens, cells[rows[k]], theta[k], place[k], boxes[k], margin[k], stride[k], steps, bells,
            normal[k], gradient[k], stats[k], blocks[k],
        )  # fmt: skip


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _edges(  # noqa: PLR0917
    u: Any, s: Any, first: Any, count: Any, k: Any, steps: Any, bells: Any, work: Any
) -> None:
    """Fill what ``count`` module edges from the first on do to a place: weight, slope, widening, density, distance."""
    inverse = 1 / s
    before, before_bell, before_wide, before_tail = 1.0, 0.0, 0.0, 0.0
    for e in range(count):
        a = min(max((u - (first + e)) * inverse, -_REACH), _REACH)
        t = (a + _REACH) * (_LAST / (2 * _REACH))
        i = min(int(t), _LAST - 1)
        f = t - i
        step = steps[i] + f * (steps[i + 1] - steps[i])
        density = bells[i] + f * (bells[i + 1] - bells[i])
        a2 = a * a
        tail = -(a2 - 3) * a * density * (1 / 24)
        full = density * (1 + k * (1 / 24) * (a2 * (a2 - 6) + 3))
        step += k * tail
        wide = -a * full
        work[0, e] = before - step
        work[1, e] = (before_bell - full) * inverse
        work[2, e] = before_wide - wide
        work[3, e] = density
        work[4, e] = a
        work[5, e] = before_tail - tail
        before, before_bell, before_wide, before_tail = step, full, wide, tail
    work[0, count] = before
    work[1, count] = before_bell * inverse
    work[2, count] = before_wide
    work[5, count] = before_tail


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _one(  # noqa: PLR0912, PLR0915, PLR0917 - one loop over pixels, all of it hot
    grey: Any, tone: Any, linear: Any, lens: Any, cells: Any, theta: Any, place: Any, box: Any, margin: Any,
    stride: Any, steps: Any, bells: Any, normal: Any, gradient: Any, stats: Any, blocks: Any,
) -> None:  # fmt: skip
    modules = cells.shape[0] - 2
    h0, h1, h2, h3, h4, h5, h6, h7 = theta[0], theta[1], theta[2], theta[3], theta[4], theta[5], theta[6], theta[7]
    offset, gain, slope_x, slope_y = theta[8], theta[9], theta[10], theta[11]
    kappa = offset / gain if abs(gain) > 1e-9 else 0.0
    scale = place[2]
    sigma = np.exp(theta[12]) * scale
    kurtosis = theta[13]
    work_u, work_v = np.zeros((6, _MOST)), np.zeros((6, _MOST))
    # edges in reach of a place, by the blur at the tag's centre
    ux, uy = h0 - h2 * h6, h1 - h2 * h7
    vx, vy = h3 - h5 * h6, h4 - h5 * h7
    wide_u = sigma * np.sqrt(ux * ux + uy * uy)
    wide_v = sigma * np.sqrt(vx * vx + vy * vy)
    count_u = min(int(2 * _NEAR * wide_u) + 1, modules + 1, _MOST - 1)
    count_v = min(int(2 * _NEAR * wide_v) + 1, modules + 1, _MOST - 1)
    vertex = np.empty((modules + 1, modules + 1))
    for j in range(modules + 1):
        for i in range(modules + 1):
            vertex[j, i] = cells[j + 1, i + 1] - cells[j + 1, i] - cells[j, i + 1] + cells[j, i]
    jac = np.zeros(_PADDED)
    local = np.zeros((PARAMETERS, _PADDED))
    last = len(tone) - 1
    top = blocks.shape[0] - 1
    every, shift, every_near = stride[0], stride[1], stride[2]
    near_u, near_v = NEAR_SIGMAS * wide_u, NEAR_SIGMAS * wide_v
    for row in range(box[2], box[3]):
        first = box[0] + (row * shift) % every
        for column in range(box[0], box[1]):
            chosen = every == 1 or (column - first) % every == 0
            if not chosen and (column + row) % every_near != 0:
                continue
            dx, dy = column - lens[0], row - lens[1]
            q = (dx * dx + dy * dy) * lens[4] * lens[4]
            f = 1 + q * (lens[2] + q * lens[3])
            x = (lens[0] + dx * f - place[0]) * scale
            y = (lens[1] + dy * f - place[1]) * scale
            w = 1 / (h6 * x + h7 * y + 1)
            u = (h0 * x + h1 * y + h2) * w
            v = (h3 * x + h4 * y + h5) * w
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
            ux, uy = (h0 - u * h6) * w, (h1 - u * h7) * w
            vx, vy = (h3 - v * h6) * w, (h4 - v * h7) * w
            uu, vv = ux * ux + uy * uy, vx * vx + vy * vy
            s_u, s_v = np.sqrt(uu) * sigma, np.sqrt(vv) * sigma
            first_u = min(max(int(u + (64 + 1 - 0.5 * count_u)) - 64, 0), modules + 1 - count_u)
            first_v = min(max(int(v + (64 + 1 - 0.5 * count_v)) - 64, 0), modules + 1 - count_v)
            _edges(u, s_u, first_u, count_u, kurtosis, steps, bells, work_u)
            _edges(v, s_v, first_v, count_v, kurtosis, steps, bells, work_v)
            rho = min(max((ux * vx + uy * vy) / np.sqrt(uu * vv), -0.9), 0.9)
            p, p_u, p_v, p_s, p_k = 0.0, 0.0, 0.0, 0.0, 0.0
            for j in range(count_v + 1):
                c, c_u, c_s, c_k = 0.0, 0.0, 0.0, 0.0
                for i in range(count_u + 1):
                    e = cells[first_v + j, first_u + i]
                    c += e * work_u[0, i]
                    c_u += e * work_u[1, i]
                    c_s += e * work_u[2, i]
                    c_k += e * work_u[5, i]
                p += work_v[0, j] * c
                p_u += work_v[0, j] * c_u
                p_v += work_v[1, j] * c
                p_s += work_v[0, j] * c_s + work_v[2, j] * c
                p_k += work_v[0, j] * c_k + work_v[5, j] * c
            for j in range(count_v):
                vertical = rho * work_v[3, j]
                bj = work_v[4, j]
                for i in range(count_u):
                    c = vertical * work_u[3, i] * vertex[first_v + j, first_u + i]
                    ai = work_u[4, i]
                    p += c * (1 + 0.5 * rho * ai * bj)
                    p_u -= c * ai / s_u
                    p_v -= c * bj / s_v
                    p_s += c * (ai * ai + bj * bj)
            slope = slope_x * x + slope_y * y
            light = offset + gain * p + slope * (p + kappa)
            if linear:
                bend = 1.0 if light >= 0 and light < 1 else 0.0
                predicted = min(max(light, 0.0), 1.0)
            else:
                t = min(max(light * last, 0.0), last - 1e-9)
                i = int(t)
                step = tone[i + 1] - tone[i]
                predicted = tone[i] + (t - i) * step
                bend = step * last if light >= 0 and light < 1 else 0.0
            value = grey[row, column]
            r = value - predicted
            factor = (gain + slope) * bend
            lit = (p + kappa) * bend
            jac[8], jac[9], jac[10], jac[11] = bend, p * bend, x * lit, y * lit
            start = 8
            if abs(p_s) + abs(p_u) * s_u + abs(p_v) * s_v > 1e-4:
                start = 0
                gu, gv = factor * p_u * w, factor * p_v * w
                both = -(gu * u + gv * v)
                jac[0], jac[1], jac[2] = gu * x, gu * y, gu
                jac[3], jac[4], jac[5] = gv * x, gv * y, gv
                jac[6], jac[7], jac[12], jac[13] = both * x, both * y, factor * p_s, factor * p_k
            jac[14] = r
            if start == 0:
                for i in range(PARAMETERS):
                    ji = jac[i]
                    for j in range(_PADDED):
                        local[i, j] += ji * jac[j]
            else:
                for i in range(8, 12):
                    ji = jac[i]
                    for j in range(8, 12):
                        local[i, j] += ji * jac[j]
                    local[i, 14] += ji * r
            stats[0] += 1
            stats[1] += r * r
            stats[2] += value
            stats[3] += value * value
            stats[4] += predicted
            stats[5] += predicted * predicted
            i = min(int(u + 1), top)
            j = min(int(v + 1), top)
            blocks[j, i, 0] += r
            blocks[j, i, 1] += 1
    for i in range(PARAMETERS):
        gradient[i] = local[i, 14]
        for j in range(PARAMETERS):
            normal[i, j] = local[i, j]
