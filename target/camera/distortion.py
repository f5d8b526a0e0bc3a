"""Distortion of normalised image coordinates, forward, with derivatives: the four kinds of camera model.

Coefficients stand in OpenCV's order; the first, k1, is the paper's kr.
"""

from enum import StrEnum
from types import MappingProxyType

import numpy as np

from boxcal.target.arrays import Array

_ON_AXIS = 1e-9
"""Tangent of the angle off the axis below which a fisheye is the pinhole that touches it."""
_NEAR_AXIS = 3e-3
"""Tangent below which a fisheye's second derivative is taken from its series: the difference cancels there."""


class CameraKind(StrEnum):
    """Kinds of camera models.

    RADIAL is the paper's (one coefficient), BROWN OpenCV's 5 coefficients (Brown 1971), RATIONAL its 8, FISHEYE its
    equidistant fisheye with 4 (Kannala and Brandt 2006).
    """

    RADIAL = "radial"
    BROWN = "brown"
    RATIONAL = "rational"
    FISHEYE = "fisheye"


DISTORTION_NAMES = MappingProxyType(
    {
        CameraKind.RADIAL: ("kr",),
        CameraKind.BROWN: ("kr", "k2", "p1", "p2", "k3"),
        CameraKind.RATIONAL: ("kr", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
        CameraKind.FISHEYE: ("kr", "k2", "k3", "k4"),
    }
)
"""Names of each kind's distortion coefficients in OpenCV's order; kr is OpenCV's k1."""


Distorted = tuple[tuple[Array, Array], tuple[Array, Array, Array, Array], list[tuple[Array, Array]]]
"""Distorted (x, y); their derivatives dx/dx, dx/dy, dy/dx, dy/dy; and (dx, dy) by each coefficient."""


def distort(kind: CameraKind, k: Array, x: Array, y: Array) -> Distorted:
    """Return the distorted normalised coordinates of (x/z, y/z), with all derivatives.

    Parameters
    ----------
    kind
        Of camera model.
    k : (n,)
        Its distortion coefficients, in the order of ``DISTORTION_NAMES``.
    x, y : (L,)
        Normalised coordinates.
    """
    return _fisheye(k, x, y) if kind is CameraKind.FISHEYE else _polynomial(k, x, y)


def _polynomial(k: Array, x: Array, y: Array) -> Distorted:
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


def _fisheye(k: Array, x: Array, y: Array) -> Distorted:
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
