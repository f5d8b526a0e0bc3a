"""From pixels to rays and back under any lens with a centre, and charts in which a tag is a homography.

A pixel at d from the centre, ``q = |d|^2 / radius^2``, sees along ``(d, g)``, ``g = 1 - a1 q - a2 q^2 - a3 q^3``: up to
one factor of the last coordinate, the focal length, which no homography minds. Zeros make a pinhole. A fisheye's g
falls through zero where it looks sideways, and its undistorted places ``d / g`` end there. Each tag therefore has its
own plane across the rays: with d0, g0 and g' of its centre,

    local_undistortion(d) = d D / (g - b d),  b = (dg/dd)(d0),  D = g0 - b d0,

which is d0 at the centre with the identity for a derivative. So edges are straight there, the blur is as wide in
all directions as on the sensor, and of a pinhole the chart is the image.
"""

import numpy as np

from boxcal.target.arrays import Array

STEPS = 12
STILL = 1e-7
"""A radius that moves less, in units of the lens's, is found: Newton's next error is its square."""
LEAST_SLOPE = 0.05
FAR = 30.0

CENTRE_X, CENTRE_Y, A1, A2, PER_RADIUS, A3, LOG_ASPECT, SKEW, P1, P2 = range(10)
"""What stands where in a lens: the centre, px; the radial terms about 1 / radius, 1 / px; the logarithm of height over
width of a square's image, and its skew; two tangential terms (Brown 1966), which only the box's fit knows."""
RADIAL = [A1, A2, A3]


def no_distortion(image_size: tuple[int, int]) -> Array:
    """Return the lens (10,) without distortion of an image (width, height) with square pixels."""
    width, height = image_size
    lens = np.zeros(10)
    lens[[CENTRE_X, CENTRE_Y, PER_RADIUS]] = (width - 1) / 2, (height - 1) / 2, 2 / max(width, height)
    return lens


def fisheye_distortion(image_size: tuple[int, int], focal_px: float) -> Array:
    """Return the lens (10,) whose rays' angles t grow as the radius: ``t cot t`` to thousandths up to 90 degrees."""
    lens = no_distortion(image_size)
    t2 = (1 / (lens[PER_RADIUS] * focal_px)) ** 2
    lens[RADIAL] = t2 / 3, t2**2 / 45, 0.0028 * t2**3
    return lens


def square(lens: Array, d: Array) -> Array:
    """Return pixels (..., 2) from the centre as a camera with square pixels without skew would have them."""
    out = np.empty(d.shape)
    out[..., 0] = d[..., 0] - lens[SKEW] * d[..., 1]
    out[..., 1] = np.exp(lens[LOG_ASPECT]) * d[..., 1]
    return out


def unsquare(lens: Array, d: Array) -> Array:
    """Return the inverse of :func:`square`, (..., 2)."""
    out = np.empty(d.shape)
    out[..., 1] = np.exp(-lens[LOG_ASPECT]) * d[..., 1]
    out[..., 0] = d[..., 0] + lens[SKEW] * out[..., 1]
    return out


def tangential(lens: Array, d: Array) -> Array:
    """Return what the two tangential terms add to pixels (..., 2) from the centre: linear in the terms, px."""
    x, y = d[..., 0], d[..., 1]
    both, xx, yy = 2 * x * y, 3 * x * x + y * y, x * x + 3 * y * y
    p1, p2 = lens[PER_RADIUS] * lens[P1], lens[PER_RADIUS] * lens[P2]
    moved = np.empty(d.shape)
    moved[..., 0], moved[..., 1] = p1 * both + p2 * xx, p1 * yy + p2 * both
    return moved


def distorted(lens: Array, d: Array) -> Array:
    """Return pixels (..., 2) from the centre with the tangential terms, by a step of fixed-point iteration."""
    s = square(lens, d)
    once = s - tangential(lens, s)
    return unsquare(lens, s - tangential(lens, once))


def depth(lens: Array, q: Array) -> tuple[Array, Array, Array]:
    """Return g at squared radii q, its slope ``dg/dd = slope d``, and ``g - d dg/dd``."""
    a1, a2, a3 = lens[A1], lens[A2], lens[A3]
    g = 1 - q * (a1 + q * (a2 + q * a3))
    slope = -2 * lens[PER_RADIUS] ** 2 * (a1 + q * (2 * a2 + q * (3 * a3)))
    return g, slope, 1 + q * (a1 + q * (3 * a2 + q * (5 * a3)))


def to_pixels(lens: Array, rays: Array) -> Array:
    """Return the pixels (..., 2) that see along rays (..., 3) of any length (z in units of the focal length); else NaN.

    Without the tangential terms.

    Newton's method on ``s z = g(s^2) rho``, s the radius, from the root for a1 alone.
    """
    rho, z = np.hypot(rays[..., 0], rays[..., 1]) * lens[PER_RADIUS], rays[..., 2]
    size = np.hypot(rho, z)
    down = z + np.sqrt(np.maximum(z * z + 4 * lens[A1] * rho * rho, 0))
    seen = down > 1e-3 * size
    s = 2 * rho / np.where(seen, down, 1)
    least = LEAST_SLOPE * np.maximum(size, 1e-300)
    for _ in range(STEPS):
        q = s * s
        g, slope, _ = depth(lens, q)
        moved = (s * z - g * rho) / np.maximum(z - slope * s * rho / lens[PER_RADIUS] ** 2, least)
        s = np.clip(s - moved, 0, FAR)
        if not np.any(np.abs(moved[seen]) > STILL):
            break
    seen &= np.abs(moved) < 1e-3
    scale = np.where(rho > 1e-12 * size, s / np.maximum(rho, 1e-300), 1 / np.where(z > 0, z, 1))
    return np.where(seen[..., None], lens[:2] + unsquare(lens, rays[..., :2] * scale[..., None]), np.nan)


def local_undistortion(lens: Array, centre_px: Array) -> tuple[Array, Array]:
    """Return b (..., 2) and D (...) of the charts about pixels (..., 2)."""
    d = square(lens, centre_px - lens[:2])
    _, slope, D = depth(lens, np.sum(d * d, axis=-1) * lens[PER_RADIUS] ** 2)
    return np.asarray(slope[..., None] * d), D


def undistort_locally(lens: Array, normalisation: Array, uv_px: Array) -> Array:
    """Return pixels (N, ..., 2) on the charts of N tags, from the tag's centre in units of its scale.

    ``normalisation`` (N, 3) holds the centres (x, y) px and 1 / scale px.
    """
    # by components, without small arrays of pairs: alignments call this for few tags at a time
    (tag_x, tag_y, scale), more = normalisation.T, (slice(None),) + (None,) * (uv_px.ndim - 2)
    skew, aspect, per_px2 = lens[SKEW], np.exp(lens[LOG_ASPECT]), lens[PER_RADIUS] ** 2
    tag_dx, tag_dy = tag_x - lens[CENTRE_X], tag_y - lens[CENTRE_Y]
    bx, by = tag_dx - skew * tag_dy, aspect * tag_dy
    _, slope, D = depth(lens, (bx * bx + by * by) * per_px2)
    bx, by = slope * bx, slope * by
    dx, dy = uv_px[..., 0] - lens[CENTRE_X], uv_px[..., 1] - lens[CENTRE_Y]
    x, y = dx - skew * dy, aspect * dy
    a1, a2, a3 = lens[A1], lens[A2], lens[A3]
    q = (x * x + y * y) * per_px2
    f = D[more] / (1 - q * (a1 + q * (a2 + q * a3)) - bx[more] * x - by[more] * y)
    out = np.empty_like(uv_px)
    out[..., 0] = (dx * f - tag_dx[more]) * scale[more]
    out[..., 1] = (dy * f - tag_dy[more]) * scale[more]
    return out


def distort_locally(lens: Array, normalisation: Array, xy: Array) -> Array:
    """Return the pixels of places (N, ..., 2) on charts: the inverse of :func:`undistort_locally`."""
    normalisation = normalisation.reshape(normalisation.shape[:1] + (1,) * (xy.ndim - 2) + (3,))
    b, D = local_undistortion(lens, normalisation[..., :2])
    e = xy / normalisation[..., 2:] + (normalisation[..., :2] - lens[:2])
    s = square(lens, e)
    z = D + np.sum(b * s, axis=-1)
    return to_pixels(lens, np.concatenate([s, z[..., None]], axis=-1))


def distortion_jacobian(lens: Array, normalisation: Array, uv_px: Array) -> Array:
    """Return how pixels (N, P, 2) move with their places on charts, in px of both: (N, P, 2, 2)."""
    b, D = local_undistortion(lens, normalisation[:, None, :2])
    d = uv_px - lens[:2]
    s = square(lens, d)
    g, slope, _ = depth(lens, np.sum(s * s, axis=-1) * lens[PER_RADIUS] ** 2)
    f = D / (g - np.sum(b * s, axis=-1))
    by_s = -((f * f / D)[..., None]) * (slope[..., None] * s - b)
    by_y = np.exp(lens[LOG_ASPECT]) * by_s[..., 1] - lens[SKEW] * by_s[..., 0]
    by_d = np.stack([by_s[..., 0], by_y], axis=-1)
    J = f[..., None, None] * np.eye(2) + d[..., :, None] * by_d[..., None, :]
    determinant = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
    J[~(np.abs(determinant) > 1e-6)] = np.eye(2)
    return np.linalg.inv(J)
