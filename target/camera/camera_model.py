"""Lenses: pixels of points and their derivatives, for the paper's model and for richer ones.

All begin with (fu, fv, cu, cv, kr); kr is the first coefficient k1. Coefficients stand in OpenCV's order.
"""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ON_AXIS = 1e-9
_NEAR_AXIS = 3e-3


class Lens(StrEnum):
    """A lens model.

    RADIAL is the paper's (one coefficient), BROWN OpenCV's 5 coefficients, RATIONAL its 8, FISHEYE its equidistant
    fisheye with 4.
    """

    RADIAL = "radial"
    BROWN = "brown"
    RATIONAL = "rational"
    FISHEYE = "fisheye"


_EXTRA = {
    Lens.RADIAL: (),
    Lens.BROWN: ("k2", "p1", "p2", "k3"),
    Lens.RATIONAL: ("k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    Lens.FISHEYE: ("k2", "k3", "k4"),
}


def extra_names(lens: Lens) -> tuple[str, ...]:
    """Return the names of the coefficients after kr, in OpenCV's order."""
    return _EXTRA[lens]


def first_values(lens: Lens, radial: Array) -> Array:
    """Return where to start from the paper's model: (fu, fv, cu, cv, kr) -> (5 + extras,).

    The equidistant fisheye has ``rho (1 + kr rho^2) = theta (1 + k1 theta^2)``, to third order ``k1 = kr + 1/3``.
    """
    values = np.concatenate([radial[:5], np.zeros(len(_EXTRA[lens]))])
    if lens is Lens.FISHEYE:
        values[4] += 1 / 3
    return values


def project_lens(lens: Lens, values: Array, p_cam: Array) -> tuple[Array, Array, Array]:
    """Return pixels and their derivatives.

    Parameters
    ----------
    lens
        Model.
    values : (n,)
        fu, fv, cu, cv, kr and the model's further coefficients.
    p_cam : (L, 3), m
        Points in front of the camera, frame ``cam``.

    Returns
    -------
    uv_px : (L, 2)
    d_values : (L, 2, n)
    d_point : (L, 2, 3), px/m
    """
    z = p_cam[:, 2]
    x, y = p_cam[:, 0] / z, p_cam[:, 1] / z
    if lens is Lens.FISHEYE:
        (xd, yd), (xdx, xdy, ydx, ydy), dk = _fisheye(values[4:], x, y)
    else:
        (xd, yd), (xdx, xdy, ydx, ydy), dk = _polynomial(values[4:], x, y)
    fu, fv, cu, cv = values[:4]
    uv = np.stack([fu * xd + cu, fv * yd + cv], axis=1)
    d_values = np.zeros((len(z), 2, len(values)))
    d_values[:, 0, 0], d_values[:, 1, 1] = xd, yd
    d_values[:, 0, 2] = d_values[:, 1, 3] = 1.0
    for k, (kx, ky) in enumerate(dk):
        d_values[:, 0, 4 + k], d_values[:, 1, 4 + k] = fu * kx, fv * ky
    d_point = np.empty((len(z), 2, 3))
    for row, f, by_x, by_y in ((0, fu, xdx, xdy), (1, fv, ydx, ydy)):
        d_point[:, row, 0], d_point[:, row, 1] = f * by_x / z, f * by_y / z
        d_point[:, row, 2] = -f * (by_x * x + by_y * y) / z
    return uv, d_values, d_point


_Distorted = tuple[tuple[Array, Array], tuple[Array, Array, Array, Array], list[tuple[Array, Array]]]


def _polynomial(k: Array, x: Array, y: Array) -> _Distorted:
    """Return OpenCV's radial and tangential distortion: coefficients k1 [k2 p1 p2 k3 [k4 k5 k6]]."""
    r2 = x * x + y * y
    if len(k) == 1:
        g, dg = 1 + k[0] * r2, np.full_like(r2, k[0])
        parts = (g + 2 * dg * x * x, 2 * dg * x * y, 2 * dg * x * y, g + 2 * dg * y * y)
        return (g * x, g * y), parts, [(r2 * x, r2 * y)]
    k1, k2, p1, p2, k3 = k[:5]
    k4, k5, k6 = k[5:8] if len(k) > 5 else (0.0, 0.0, 0.0)
    top, bottom = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    d_top, d_bottom = k1 + r2 * (2 * k2 + 3 * r2 * k3), k4 + r2 * (2 * k5 + 3 * r2 * k6)
    g = top / bottom
    dg = (d_top - g * d_bottom) / bottom  # by r2
    xd = g * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = g * y + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    cross = 2 * dg * x * y + 2 * p1 * x + 2 * p2 * y
    parts = (g + 2 * dg * x * x + 2 * p1 * y + 6 * p2 * x, cross, cross, g + 2 * dg * y * y + 6 * p1 * y + 2 * p2 * x)
    n1, n2, n3 = r2 / bottom, r2 * r2 / bottom, r2**3 / bottom
    dk = [
        (n1 * x, n1 * y),
        (n2 * x, n2 * y),
        (2 * x * y, r2 + 2 * y * y),
        (r2 + 2 * x * x, 2 * x * y),
        (n3 * x, n3 * y),
    ]
    if len(k) > 5:
        dk += [(-g * n * x, -g * n * y) for n in (n1, n2, n3)]
    return (xd, yd), parts, dk


def _fisheye(k: Array, x: Array, y: Array) -> _Distorted:
    """Return the equidistant fisheye: the angle theta off the axis lands at ``theta (1 + k1 theta^2 + ...)``."""
    r = np.hypot(x, y)
    axis = r < _ON_AXIS
    safe = np.where(axis, 1.0, r)
    theta = np.arctan(r)
    t2 = theta * theta
    poly = 1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))
    slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))
    g = np.where(axis, 1.0, theta * poly / safe)
    # dg/dr / r; near the axis by its series, since the difference cancels there
    series = 2 * (k[0] - 1 / 3) + 4 * (k[1] - k[0] + 0.2) * r * r
    turn = np.where(r < _NEAR_AXIS, series, (slope / (1 + r * r) - g) / (safe * safe))
    parts = (g + turn * x * x, turn * x * y, turn * x * y, g + turn * y * y)
    ratio = np.where(axis, 1.0, theta / safe)
    dk = [(ratio * t2**n * x, ratio * t2**n * y) for n in (1, 2, 3, 4)]
    return (g * x, g * y), parts, dk
