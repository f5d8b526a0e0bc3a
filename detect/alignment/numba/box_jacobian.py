"""Corners of a rigid box on the charts about the pixels where they are seen, many at a time in vector instructions.

The reference is :class:`boxcal.detect.alignment.box_refinement.Tangent`.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.box_refinement import CAMERA
from boxcal.detect.alignment.numba.kernel import loops
from boxcal.detect.alignment.numba.pixels import ORDER
from boxcal.detect.alignment.radial_camera import (
    A1,
    A2,
    A3,
    CENTRE_X,
    CENTRE_Y,
    LOG_ASPECT,
    P1,
    P2,
    PER_RADIUS,
    SKEW,
)

UNKNOWNS = CAMERA + 6
ROWS = UNKNOWNS + 2
"""Of the Jacobian: the unknowns, the residuals, and one of zeros, which makes it an even number."""
POINTS, WIDE = 32, 64
"""Number of points at a time, and of residuals: first along x, then along y."""
_TURNED, _MOVED = CAMERA, CAMERA + 3
_LEAST_W = 1e-6


@loops()
def scalars(focal: Any, lens: Any) -> Any:
    """Return a camera as single numbers, so that what all points share is computed once."""
    per_px = lens[PER_RADIUS]
    centre, radial = (lens[CENTRE_X], lens[CENTRE_Y]), (lens[A1], lens[A2], lens[A3])
    return focal, centre, radial, per_px, np.exp(lens[LOG_ASPECT]), lens[SKEW], (per_px * lens[P1], per_px * lens[P2])


@loops(fastmath=ORDER, inline="always")
def _chart(camera: Any, raw_x: Any, raw_y: Any) -> Any:
    """Return of a pixel from the centre what ``Tangent`` knows of its chart.

    The pixel with square ones, without tangential terms and with, q, D, and the row (3,) that gives a point's depth.
    """
    focal, _, (a1, a2, a3), per_px, aspect, skew, (p1, p2) = camera
    x, y = raw_x - skew * raw_y, aspect * raw_y
    both = 2 * x * y
    dx, dy = x + p1 * both + p2 * (3 * x * x + y * y), y + p1 * (x * x + 3 * y * y) + p2 * both
    per_px2 = per_px * per_px
    q = (dx * dx + dy * dy) * per_px2
    D = 1 + q * (a1 + q * (3 * a2 + q * (5 * a3)))
    slope = 2 * per_px2 * (a1 + q * (2 * a2 + q * (3 * a3))) / D
    return x, y, dx, dy, q, D, slope * dx, slope * dy, 1 / (focal * D)


@loops(fastmath=ORDER)
def deviations(p_box: Any, uv: Any, camera: Any, T: Any, off: Any) -> bool:
    """Fill how far corners are off, px; return whether all points lie before the camera."""
    least, (centre_x, centre_y) = _LEAST_W / camera[0], camera[1]
    a, b, c, d = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    e, f, g, h = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    i, j, k, m = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    before = 0
    for p in range(len(uv)):
        _, _, dx, dy, _, _, ax, ay, az = _chart(camera, uv[p, 0] - centre_x, uv[p, 1] - centre_y)
        u, v, w = p_box[p, 0], p_box[p, 1], p_box[p, 2]
        x, y, z = a * u + b * v + c * w + d, e * u + f * v + g * w + h, i * u + j * v + k * w + m
        depth = ax * x + ay * y + az * z
        before += depth > least
        depth = depth if abs(depth) > least else least
        ex, ey = dx - x / depth, dy - y / depth
        off[p] = np.sqrt(ex * ex + ey * ey)
    return before == len(uv)


@loops(fastmath=ORDER)
def differentiate(p_box: Any, uv: Any, first: Any, camera: Any, T: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill rows of the Jacobian, ``out`` (ROWS * WIDE,), of points from the first on; zeros where there are no more."""
    focal, (centre_x, centre_y), _, per_px, aspect, skew, _ = camera
    least, count = _LEAST_W / focal, min(POINTS, len(uv) - first)
    a, b, c, d = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    e, f, g, h = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    i, j, k, m = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    if count < POINTS:
        for p in range(ROWS * WIDE):
            out[p] = 0.0
    for p in range(count):
        raw_x, raw_y = uv[first + p, 0] - centre_x, uv[first + p, 1] - centre_y
        sx, sy, dx, dy, q, D, ax, ay, az = _chart(camera, raw_x, raw_y)
        u, v, w = p_box[first + p, 0], p_box[first + p, 1], p_box[first + p, 2]
        x, y, z = a * u + b * v + c * w + d, e * u + f * v + g * w + h, i * u + j * v + k * w + m
        depth = ax * x + ay * y + az * z
        per_w = 1 / (depth if abs(depth) > least else least)
        seen_x, seen_y, deep = x * per_w, y * per_w, z * per_w / focal
        toward = 2 * per_px * per_px * (dx * seen_x + dy * seen_y)
        one, two, three = q - toward, q * (3 * q - 2 * toward), q * q * (5 * q - 3 * toward)
        r, along = p, seen_x / D
        out[r] = along * deep
        out[r + WIDE] = 1.0
        out[r + 2 * WIDE] = -skew
        out[r + 3 * WIDE], out[r + 4 * WIDE], out[r + 5 * WIDE] = along * one, along * two, along * three
        out[r + 6 * WIDE], out[r + 7 * WIDE] = 0.0, raw_y
        out[r + 8 * WIDE], out[r + 9 * WIDE] = -2 * per_px * sx * sy, -per_px * (3 * sx * sx + sy * sy)
        mx, my, mz = per_w - per_w * ax * seen_x, -per_w * ay * seen_x, -per_w * az * seen_x
        out[r + _TURNED * WIDE] = y * mz - z * my
        out[r + (_TURNED + 1) * WIDE], out[r + (_TURNED + 2) * WIDE] = z * mx - x * mz, x * my - y * mx
        out[r + _MOVED * WIDE], out[r + (_MOVED + 1) * WIDE], out[r + (_MOVED + 2) * WIDE] = mx, my, mz
        out[r + UNKNOWNS * WIDE] = dx - seen_x
        r, along = p + POINTS, seen_y / D
        out[r] = along * deep
        out[r + WIDE] = 0.0
        out[r + 2 * WIDE] = aspect
        out[r + 3 * WIDE], out[r + 4 * WIDE], out[r + 5 * WIDE] = along * one, along * two, along * three
        out[r + 6 * WIDE], out[r + 7 * WIDE] = -sy, 0.0
        out[r + 8 * WIDE], out[r + 9 * WIDE] = -per_px * (sx * sx + 3 * sy * sy), -2 * per_px * sx * sy
        mx, my, mz = -per_w * ax * seen_y, per_w - per_w * ay * seen_y, -per_w * az * seen_y
        out[r + _TURNED * WIDE] = y * mz - z * my
        out[r + (_TURNED + 1) * WIDE], out[r + (_TURNED + 2) * WIDE] = z * mx - x * mz, x * my - y * mx
        out[r + _MOVED * WIDE], out[r + (_MOVED + 1) * WIDE], out[r + (_MOVED + 2) * WIDE] = mx, my, mz
        out[r + UNKNOWNS * WIDE] = dy - seen_y


@loops(fastmath=ORDER)
def weigh(off: Any, first: Any, scale: Any, rows: Any) -> None:
    """Multiply the rows of the Jacobian (ROWS, WIDE) by the roots of points' weights, by their deviations."""
    for p in range(min(POINTS, len(off) - first)):
        share = off[first + p] / scale
        weight = 1 / np.sqrt(1 + share * share)
        rows[ROWS - 1, p], rows[ROWS - 1, POINTS + p] = weight, weight
    for r in range(ROWS - 1):
        for p in range(WIDE):
            rows[r, p] *= rows[ROWS - 1, p]
    for p in range(WIDE):
        rows[ROWS - 1, p] = 0.0


@loops(fastmath=ORDER)
def add_products(rows: Any, normal: Any, gradient: Any) -> None:
    """Add products of the Jacobian's rows (ROWS, WIDE) to the lower triangle of the normal matrix, and the gradient."""
    for i in range(0, UNKNOWNS, 2):
        for j in range(i, ROWS, 2):
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for p in range(WIDE):
                a += rows[i, p] * rows[j, p]
                b += rows[i, p] * rows[j + 1, p]
                c += rows[i + 1, p] * rows[j, p]
                d += rows[i + 1, p] * rows[j + 1, p]
            if j == UNKNOWNS:
                gradient[i] += a
                gradient[i + 1] += c
            else:
                normal[j, i] += a
                normal[j + 1, i] += b
                normal[j, i + 1] += c
                normal[j + 1, i + 1] += d


@loops(fastmath=ORDER)
def spreads(L: Any, rows: Any, out: Any) -> None:
    """Fill how far points move, (POINTS,) px, with the unknowns' deviations, of whose information L is the factor."""
    for p in range(POINTS):
        out[p] = 0.0
    for i in range(UNKNOWNS):
        for j in range(i):
            by = L[i, j]
            for p in range(WIDE):
                rows[i, p] -= by * rows[j, p]
        per = 1 / L[i, i]
        for p in range(WIDE):
            rows[i, p] *= per
        for p in range(POINTS):
            out[p] += rows[i, p] * rows[i, p] + rows[i, POINTS + p] * rows[i, POINTS + p]
    for p in range(POINTS):
        out[p] = np.sqrt(out[p])
