"""Rays and charts of single pixels; the reference is :mod:`boxcal.detect.alignment.radial_camera`."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.radial_camera import (
    A1,
    A2,
    A3,
    CENTRE_X,
    CENTRE_Y,
    FAR,
    LEAST_SLOPE,
    LOG_ASPECT,
    PER_RADIUS,
    SKEW,
    STEPS,
    STILL,
)
from boxcal.target.arrays import Array


def undistort_locally(lens: Array, normalisation: Array, uv_px: Array) -> Array:
    """Return what :func:`boxcal.detect.alignment.radial_camera.undistort_locally` does, of pixels (N, P, 2)."""
    out = np.empty(uv_px.shape)
    _undistort(lens, np.ascontiguousarray(normalisation), np.ascontiguousarray(uv_px, dtype=np.float64), out)
    return out


@kernel()
def _undistort(lens: Any, normalisation: Any, uv: Any, out: Any) -> None:
    skew, aspect, per_px2 = lens[SKEW], np.exp(lens[LOG_ASPECT]), lens[PER_RADIUS] ** 2
    for k in range(len(uv)):
        bx, by, D = local_undistortion(lens, normalisation[k])
        scale = normalisation[k, 2]
        tag_dx, tag_dy = normalisation[k, 0] - lens[CENTRE_X], normalisation[k, 1] - lens[CENTRE_Y]
        for p in range(uv.shape[1]):
            dx, dy = uv[k, p, 0] - lens[CENTRE_X], uv[k, p, 1] - lens[CENTRE_Y]
            x, y = dx - skew * dy, aspect * dy
            q = (x * x + y * y) * per_px2
            f = D / (1 - q * (lens[A1] + q * (lens[A2] + q * lens[A3])) - bx * x - by * y)
            out[k, p, 0], out[k, p, 1] = (dx * f - tag_dx) * scale, (dy * f - tag_dy) * scale


@loops()
def depth(lens: Any, q: Any) -> tuple[float, float, float]:
    """Return g at the squared radius q, its slope and ``g - d dg/dd``, as the reference of the same name does."""
    a1, a2, a3 = lens[A1], lens[A2], lens[A3]
    return (
        1 - q * (a1 + q * (a2 + q * a3)),
        -2 * lens[PER_RADIUS] ** 2 * (a1 + q * (2 * a2 + q * (3 * a3))),
        1 + q * (a1 + q * (3 * a2 + q * (5 * a3))),
    )


@loops()
def square(lens: Any, dx: Any, dy: Any) -> tuple[float, float]:
    """Return a pixel from the centre as a camera with square pixels without skew would have it."""
    return dx - lens[SKEW] * dy, np.exp(lens[LOG_ASPECT]) * dy


@loops()
def local_undistortion(lens: Any, normalisation: Any) -> tuple[float, float, float]:
    """Return b and D of the chart about a tag's centre, see :func:`boxcal.detect.alignment.radial_camera.chart`."""
    dx, dy = square(lens, normalisation[0] - lens[CENTRE_X], normalisation[1] - lens[CENTRE_Y])
    _, slope, D = depth(lens, (dx * dx + dy * dy) * lens[PER_RADIUS] ** 2)
    return slope * dx, slope * dy, D


@loops()
def to_pixel(lens: Any, x: Any, y: Any, z: Any) -> tuple[float, float]:
    """Return the pixel that sees along a ray, NaN if none does; the reference is ``radial_camera.to_pixels``."""
    rho = np.hypot(x, y) * lens[PER_RADIUS]
    size = np.hypot(rho, z)
    down = z + np.sqrt(max(z * z + 4 * lens[A1] * rho * rho, 0.0))
    if not down > 1e-3 * size:
        return np.nan, np.nan
    s, moved = 2 * rho / down, np.inf
    for _ in range(STEPS):
        g, slope, _ = depth(lens, s * s)
        moved = (s * z - g * rho) / max(z - slope * s * rho / lens[PER_RADIUS] ** 2, LEAST_SLOPE * size)
        s = min(max(s - moved, 0.0), FAR)
        if abs(moved) <= STILL:
            break
    if not abs(moved) < 1e-3:
        return np.nan, np.nan
    scale = s / rho if rho > 1e-12 * size else 1 / z
    y = np.exp(-lens[LOG_ASPECT]) * y
    return lens[CENTRE_X] + (x + lens[SKEW] * y) * scale, lens[CENTRE_Y] + y * scale
