"""Wheel noise propagated along legs, compiled: see :mod:`boxcal.calib.likelihood.leg_propagation`."""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.calib.likelihood.leg_propagation import DRAGGED, SIDEWAYS


@kernel()
def _corrected(  # noqa: PLR0917
    dphi: Any, starts: Any, at_start: Any, at_end: Any, radius: Any, ends: Any, out: Any, u: Any
) -> None:
    """Fill out (S, 2) with the corrected travel, rad, and u (S, 2) with it in m.

    And ends (N, 2, 2) with the first and last moving samples, or -1.
    """
    for n in range(starts.shape[0] - 1):
        for w in range(2):
            first, last = -1, -1
            for s in range(starts[n], starts[n + 1]):
                out[s, w] = dphi[s, w]
                if dphi[s, w] != 0.0:
                    last = s
                    if first < 0:
                        first = s
            ends[n, w, 0], ends[n, w, 1] = first, last
            if first >= 0:
                out[first, w] -= at_start[n, w]
                out[last, w] += at_end[n, w]
            else:
                spread = (at_end[n, w] - at_start[n, w]) / (starts[n + 1] - starts[n])
                for s in range(starts[n], starts[n + 1]):
                    out[s, w] += spread
            for s in range(starts[n], starts[n + 1]):
                u[s, w] = radius[w] * out[s, w]


DISPLACEMENT, D_WHEELS, SLIP, ROLLED = 0, 3, 12, 21
"""Where displacement (3), its derivatives by the wheels (9), covariance (9) and distances (2) begin in a row."""
SUMS = 23


@kernel(inner=True)
def _arc(h: float) -> tuple[float, float, float]:
    """Return the cosine of an angle h, ``sin(h) / h`` and its derivative."""
    q = h * h
    if q < _SMALL2:
        cosine = 1 - q / 2 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56)))
        return cosine, 1 - q / 6 * (1 - q / 20 * (1 - q / 42)), -h / 3 * (1 - q / 10 * (1 - q / 28 * (1 - q / 54)))
    cosine, sinc = np.cos(h), np.sin(h) / h
    return cosine, sinc, (cosine - sinc) / h


_SMALL2 = 2.5e-3
"""Square of an angle below which the series are exact to rounding, rad^2."""


@kernel()
def _propagate(starts: Any, dphi: Any, u: Any, b: float, sums: Any, by_travel: Any, by_sideways: Any) -> None:  # noqa: PLR0917
    """Fill what one pass over the samples of each leg gives; u (S, 2) is the distance that the wheels rolled."""
    per_b = 1 / b
    for n in range(starts.shape[0] - 1):
        x, y, th = 0.0, 0.0, 0.0
        heading_c, heading_s = 1.0, 0.0
        for s in range(starts[n], starts[n + 1]):
            ds, dth = (u[s, 0] + u[s, 1]) / 2, (u[s, 0] - u[s, 1]) * per_b
            h = dth / 2
            cosine, sinc, dsinc = _arc(h)
            # Halfway through the sample's arc, then at its end: a turn by h each.
            sine = h * sinc
            c, si = heading_c * cosine - heading_s * sine, heading_s * cosine + heading_c * sine
            heading_c, heading_s = c * cosine - si * sine, si * cosine + c * sine
            x += ds * sinc * c
            y += ds * sinc * si
            th += dth
            # By the sample's own ds, by drift aside, and by its turn where the leg ended here.
            by_travel[0, 0, s], by_travel[0, 1, s] = sinc * c, sinc * si
            by_sideways[0, s], by_sideways[1, s] = -sinc * si, sinc * c
            by_travel[1, 0, s] = 0.5 * ds * (dsinc * c - sinc * si) + y
            by_travel[1, 1, s] = 0.5 * ds * (dsinc * si + sinc * c) - x
        sums[n, DISPLACEMENT], sums[n, DISPLACEMENT + 1], sums[n, DISPLACEMENT + 2] = x, y, th
        rolled_R, rolled_L, b_x, b_y, b_t = 0.0, 0.0, 0.0, 0.0, 0.0
        Rx, Ry, Rt, Lx, Ly, Lt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        xx, xy, xt, yy, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for s in range(starts[n], starts[n + 1]):
            turn_x, turn_y = (by_travel[1, 0, s] - y) * per_b, (by_travel[1, 1, s] + x) * per_b
            half_x, half_y = by_travel[0, 0, s] / 2, by_travel[0, 1, s] / 2
            px, py, qx, qy, t = half_x + turn_x, half_y + turn_y, half_x - turn_x, half_y - turn_y, per_b
            by_travel[0, 0, s], by_travel[0, 1, s], by_travel[0, 2, s] = px, py, t
            by_travel[1, 0, s], by_travel[1, 1, s], by_travel[1, 2, s] = qx, qy, -t
            dth = (u[s, 0] - u[s, 1]) * per_b
            right, left = abs(u[s, 0]), abs(u[s, 1])
            rolled_R, rolled_L = rolled_R + right, rolled_L + left
            b_x, b_y, b_t = b_x - turn_x * dth, b_y - turn_y * dth, b_t - t * dth
            Rx, Ry, Rt = Rx + px * dphi[s, 0], Ry + py * dphi[s, 0], Rt + t * dphi[s, 0]
            Lx, Ly, Lt = Lx + qx * dphi[s, 1], Ly + qy * dphi[s, 1], Lt - t * dphi[s, 1]
            w, v, aside = right + DRAGGED * left, left + DRAGGED * right, SIDEWAYS * (right + left)
            side_x, side_y = by_sideways[0, s], by_sideways[1, s]
            xx += w * px * px + v * qx * qx + aside * side_x * side_x
            xy += w * px * py + v * qx * qy + aside * side_x * side_y
            yy += w * py * py + v * qy * qy + aside * side_y * side_y
            xt += (w * px - v * qx) * t
            yt += (w * py - v * qy) * t
            tt += (w + v) * t * t
        sums[n, ROLLED], sums[n, ROLLED + 1] = rolled_R, rolled_L
        for i, values in enumerate(((Rx, Lx, b_x), (Ry, Ly, b_y), (Rt, Lt, b_t))):
            for j in range(3):
                sums[n, D_WHEELS + 3 * i + j] = values[j]
        for i, values in enumerate(((xx, xy, xt), (xy, yy, yt), (xt, yt, tt))):
            for j in range(3):
                sums[n, SLIP + 3 * i + j] = values[j]


@kernel()
def _readings(  # noqa: PLR0912, PLR0917
    starts: Any, raw: Any, ends: Any, radius: Any, by_travel: Any, d_start: Any, d_end: Any, quantisation: Any
) -> None:
    """Fill the derivatives by the readings at both ends, and the covariance of those between."""
    step = np.empty(3)
    for n in range(starts.shape[0] - 1):
        for w in range(2):
            first, last = ends[n, w, 0], ends[n, w, 1]
            if first < 0:
                for i in range(3):
                    total = 0.0
                    for s in range(starts[n], starts[n + 1]):
                        total += by_travel[w, i, s]
                    total *= radius[w] / (starts[n + 1] - starts[n])
                    d_start[n, i, w], d_end[n, i, w] = -total, total
                continue
            for i in range(3):
                d_start[n, i, w] = -radius[w] * by_travel[w, i, first]
                d_end[n, i, w] = radius[w] * by_travel[w, i, last]
            before = first
            for s in range(first + 1, last + 1):
                if raw[s, w] != 0.0:
                    for i in range(3):
                        step[i] = radius[w] * (by_travel[w, i, before] - by_travel[w, i, s])
                    for i in range(3):
                        for j in range(i + 1):
                            quantisation[n, i, j] += step[i] * step[j] / 12
                    before = s
        for i in range(3):
            for j in range(i):
                quantisation[n, j, i] = quantisation[n, i, j]


def propagate(path: Any, wheels: Any, at_start: Any, at_end: Any, added: Any) -> tuple[Any, ...]:
    """Return what the wheels say of each leg: see :func:`boxcal.calib.likelihood.leg_propagation.propagate`."""
    N, S = len(path.starts), len(path.dphi)
    starts, radius = np.append(path.starts, S), np.ascontiguousarray(wheels[:2])
    raw, dphi, u = np.ascontiguousarray(path.dphi), np.empty((S, 2)), np.empty((S, 2))
    ends = np.empty((N, 2, 2), dtype=np.int64)
    _corrected(raw, starts, np.ascontiguousarray(at_start), np.ascontiguousarray(at_end), radius, ends, dphi, u)
    if added is not None:
        u += added
    sums, by_travel, by_sideways = np.zeros((N, SUMS)), np.empty((2, 3, S)), np.zeros((3, S))
    _propagate(starts, dphi, u, float(wheels[2]), sums, by_travel, by_sideways)
    displacement, d_wheels, slip, rolled = np.split(sums, (D_WHEELS, SLIP, ROLLED), axis=1)
    d_wheels, slip = d_wheels.reshape(N, 3, 3), slip.reshape(N, 3, 3)
    d_start, d_end, quantisation = np.empty((N, 3, 2)), np.empty((N, 3, 2)), np.zeros((N, 3, 3))
    _readings(starts, raw, ends, radius, by_travel, d_start, d_end, quantisation)
    return displacement, d_wheels, d_start, d_end, slip, quantisation, rolled, by_travel, by_sideways
