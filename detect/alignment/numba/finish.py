"""Corners, their covariances and what verification needs of aligned tags, from the sums of the last step."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.arrays import put_rows
from boxcal.detect.alignment.numba.cholesky import factor, solve_lower_rows
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.radial_camera import depth, local_undistortion, square, to_pixel
from boxcal.detect.alignment.radial_camera import LOG_ASPECT, PER_RADIUS, SKEW
from boxcal.detect.alignment.registration.finish import KURTOSIS_PRIOR, Finished
from boxcal.detect.alignment.registration.image_model import Sums
from boxcal.detect.alignment.registration.parameters import KURTOSIS, PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array


def finish(
    frame: Frame, patterns: Patterns, *, theta: Array, normalisation: Array, sums: Sums, covariance: bool
) -> Finished:
    """Return corners, covariances and qualities as :func:`boxcal.detect.alignment.registration.finish.finish` does."""
    n = len(theta)
    out = Finished(corners=np.empty((n, 4, 2)), cov=np.zeros((n, 4, 2, 2)), quality=np.empty((n, 4)))
    _finish(frame.lens, patterns.modules, theta, normalisation, sums, covariance, out)
    return out


@kernel()
def _finish(  # noqa: PLR0917 - arrays in, arrays out
    lens: Any, modules: Any, theta: Any, normalisation: Any, sums: Any, covariance: Any, out: Any
) -> None:
    normal, stats, corners, cov, quality = sums.normal, sums.stats, out.corners, out.cov, out.quality
    A = np.empty((PARAMETERS, PARAMETERS))
    moves, half = np.zeros((2, PARAMETERS)), np.empty((PARAMETERS, 8))
    for k in range(len(theta)):
        n, r2, y, y2, p, p2 = stats[k, 0], stats[k, 1], stats[k, 2], stats[k, 3], stats[k, 4], stats[k, 5]
        count = max(n, 1.0)
        var_y, var_p = y2 / count - (y / count) ** 2, p2 / count - (p / count) ** 2
        cross = 0.5 * (y2 + p2 - r2) / count - (y / count) * (p / count)
        noise2 = r2 / max(n - PARAMETERS, 1.0)
        contrast = max(2 * np.sqrt(max(var_y, 0.0)), 1e-6)
        quality[k, 0] = min(cross / np.sqrt(max(var_y * var_p, 1e-12)), 1.0)
        quality[k, 1] = _worst(sums.blocks[k], 2, 2.0) / contrast
        quality[k, 2] = _worst(sums.blocks[k], 1, 4.0) / contrast
        quality[k, 3] = np.sqrt(noise2)
        if covariance:
            put_rows(A, normal[k])
            for i in range(PARAMETERS):
                A[i, i] += 1e-12 + 1e-9 * normal[k, i, i]
            A[KURTOSIS, KURTOSIS] += max(r2, 1e-9) / max(n - PARAMETERS, 1.0) / KURTOSIS_PRIOR**2
            factor(A)
        for c in range(4):
            u, v = modules * (c == 1 or c == 2), modules * (c >= 2)  # noqa: PLR1714 - a set takes long to compile
            _corner(lens, theta[k], normalisation[k], float(u), float(v), corners[k, c])
            if covariance:
                moves_of(lens, theta[k], normalisation[k], corners[k, c], moves)
                for m in range(PARAMETERS):
                    half[m, 2 * c], half[m, 2 * c + 1] = moves[0, m], moves[1, m]
        if covariance:
            solve_lower_rows(A, half)
            _fill_covariances(half, noise2, cov[k])


@loops(fastmath={"contract"})
def _fill_covariances(half: Any, noise2: Any, cov: Any) -> None:
    """Fill the corners' covariances (4, 2, 2): products of columns (14, 8) that belong to one corner."""
    for c in range(4):
        xx, xy, yy = 0.0, 0.0, 0.0
        for m in range(PARAMETERS):
            x, y = half[m, 2 * c], half[m, 2 * c + 1]
            xx += x * x
            xy += x * y
            yy += y * y
        cov[c, 0, 0], cov[c, 1, 1] = xx * noise2, yy * noise2
        cov[c, 0, 1], cov[c, 1, 0] = xy * noise2, xy * noise2


@loops()
def _worst(blocks: Any, side: Any, least: Any) -> float:
    """Return the largest mean residual of squares of modules that have pixels enough."""
    most = 0.0
    size = len(blocks)
    for j in range(0, size, side):
        for i in range(0, size, side):
            total, count = 0.0, 0.0
            for b in range(j, min(j + side, size)):
                for a in range(i, min(i + side, size)):
                    total += blocks[b, a, 0]
                    count += blocks[b, a, 1]
            if count >= least:
                most = max(most, abs(total) / count)
    return most


@loops()
def _corner(lens: Any, h: Any, normalisation: Any, u: Any, v: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill the pixel of a place on the tag: H inverted by its adjugate, then bent as the reference does."""
    out[0], out[1] = np.nan, np.nan
    x = (h[4] - h[5] * h[7]) * u + (h[2] * h[7] - h[1]) * v + (h[1] * h[5] - h[2] * h[4])
    y = (h[5] * h[6] - h[3]) * u + (h[0] - h[2] * h[6]) * v + (h[2] * h[3] - h[0] * h[5])
    w = (h[3] * h[7] - h[4] * h[6]) * u + (h[1] * h[6] - h[0] * h[7]) * v + (h[0] * h[4] - h[1] * h[3])
    x, y = x / w, y / w
    if not (abs(x) < 1e3 and abs(y) < 1e3):
        return
    bx, by, D = local_undistortion(lens, normalisation)
    ex, ey = x / normalisation[2] + normalisation[0] - lens[0], y / normalisation[2] + normalisation[1] - lens[1]
    ex, ey = square(lens, ex, ey)
    out[0], out[1] = to_pixel(lens, ex, ey, D + bx * ex + by * ey)


@loops()
def moves_of(lens: Any, h: Any, normalisation: Any, corner: Any, out: Any) -> None:
    """Fill how a corner, px, moves with the homography: it stays where its modules are."""
    bx, by, D = local_undistortion(lens, normalisation)
    dx, dy = corner[0] - lens[0], corner[1] - lens[1]
    sx, sy = square(lens, dx, dy)
    g, slope, _ = depth(lens, (sx * sx + sy * sy) * lens[PER_RADIUS] ** 2)
    f = D / (g - bx * sx - by * sy)
    x, y = (
        (dx * f + lens[0] - normalisation[0]) * normalisation[2],
        (dy * f + lens[1] - normalisation[1]) * normalisation[2],
    )
    # of the place on the chart by the pixel
    cx, cy = -f * f / D * (slope * sx - bx), -f * f / D * (slope * sy - by)
    cy = np.exp(lens[LOG_ASPECT]) * cy - lens[SKEW] * cx
    xx, xy, yx, yy = f + dx * cx, dx * cy, dy * cx, f + dy * cy
    w = 1 / (h[6] * x + h[7] * y + 1)
    u, v = (h[0] * x + h[1] * y + h[2]) * w, (h[3] * x + h[4] * y + h[5]) * w
    ux, uy, vx, vy = (h[0] - u * h[6]) * w, (h[1] - u * h[7]) * w, (h[3] - v * h[6]) * w, (h[4] - v * h[7]) * w
    # of the modules by the pixel, and its inverse
    a, b = (ux * xx + uy * yx) * normalisation[2], (ux * xy + uy * yy) * normalisation[2]
    c, d = (vx * xx + vy * yx) * normalisation[2], (vx * xy + vy * yy) * normalisation[2]
    det = a * d - b * c
    det = det if abs(det) > 1e-15 else 1e-15
    for row in range(2):
        by_u, by_v = (-d / det, b / det) if row == 0 else (c / det, -a / det)
        out[row, 0], out[row, 1], out[row, 2] = by_u * x * w, by_u * y * w, by_u * w
        out[row, 3], out[row, 4], out[row, 5] = by_v * x * w, by_v * y * w, by_v * w
        both = -(by_u * u + by_v * v) * w
        out[row, 6], out[row, 7] = both * x, both * y
