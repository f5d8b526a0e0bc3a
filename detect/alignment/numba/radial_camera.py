"""Rays and charts of single pixels; the reference is :mod:`boxcal.detect.alignment.radial_camera`."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.radial_camera import FAR, LEAST_SLOPE, STEPS, STILL


@kernel()
def depth(lens: Any, q: Any) -> tuple[float, float, float]:
    """Return g at the squared radius q, its slope and ``g - d dg/dd``, as the reference of the same name does."""
    a1, a2, a3 = lens[2], lens[3], lens[5]
    return (
        1 - q * (a1 + q * (a2 + q * a3)),
        -2 * lens[4] ** 2 * (a1 + q * (2 * a2 + q * (3 * a3))),
        1 + q * (a1 + q * (3 * a2 + q * (5 * a3))),
    )


@kernel()
def local_undistortion(lens: Any, normalisation: Any) -> tuple[float, float, float]:
    """Return b and D of the chart about a tag's centre, see :func:`boxcal.detect.alignment.radial_camera.chart`."""
    dx, dy = normalisation[0] - lens[0], normalisation[1] - lens[1]
    _, slope, D = depth(lens, (dx * dx + dy * dy) * lens[4] ** 2)
    return slope * dx, slope * dy, D


@kernel()
def to_pixel(lens: Any, x: Any, y: Any, z: Any) -> tuple[float, float]:
    """Return the pixel that sees along a ray, NaN if none does; the reference is ``radial_camera.to_pixels``."""
    rho = np.hypot(x, y) * lens[4]
    size = np.hypot(rho, z)
    down = z + np.sqrt(max(z * z + 4 * lens[2] * rho * rho, 0.0))
    if not down > 1e-3 * size:
        return np.nan, np.nan
    s, moved = 2 * rho / down, np.inf
    for _ in range(STEPS):
        g, slope, _ = depth(lens, s * s)
        moved = (s * z - g * rho) / max(z - slope * s * rho / lens[4] ** 2, LEAST_SLOPE * size)
        s = min(max(s - moved, 0.0), FAR)
        if abs(moved) <= STILL:
            break
    if not abs(moved) < 1e-3:
        return np.nan, np.nan
    scale = s / rho if rho > 1e-12 * size else 1 / z
    return lens[0] + x * scale, lens[1] + y * scale
