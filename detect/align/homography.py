"""Homographies between planes: exact from four points, least squares from more."""

import numpy as np
from numpy.typing import NDArray

from detect.align.pattern import Array


def fit_homographies(src: Array, dst: Array) -> Array:
    """Return the homographies (N, 8), last entry 1, that map quadrilaterals (N, 4, 2) to one or N others.

    Both are mapped from the unit square in closed form (Heckbert, Fundamentals of Texture Mapping and Image Warping,
    1989, 2.2.3). A quadrilateral with three corners in line has none: its entries are NaN.
    """
    s, d = _from_unit_square(src), _from_unit_square(dst)
    (a, b, c), (e, f, g), (i, j, k) = np.moveaxis(s, 0, -1)
    # the adjugate of s; what divides by zero is a corner at infinity
    rows = [
        [f * k - g * j, c * j - b * k, b * g - c * f],
        [g * i - e * k, a * k - c * i, c * e - a * g],
        [e * j - f * i, b * i - a * j, a * f - b * e],
    ]
    H = (d @ np.moveaxis(np.array(rows), -1, 0)).reshape(-1, 9)
    with np.errstate(divide="ignore", invalid="ignore"):
        h = H[:, :8] / H[:, 8, None]
    return np.where((_lines_up(src) | _lines_up(dst))[:, None] | ~np.isfinite(h), np.nan, h)


def _from_unit_square(quads: Array) -> Array:
    """Return the matrices (N, 3, 3) that map (0, 0), (1, 0), (1, 1), (0, 1) to the corners (N, 4, 2) or (4, 2)."""
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = np.moveaxis(quads.reshape(-1, 4, 2), 0, -1)
    ax, ay, bx, by = x1 - x2, y1 - y2, x3 - x2, y3 - y2
    sx, sy = x0 - x1 - bx, y0 - y1 - by
    det = ax * by - bx * ay
    g, h = sx * by - bx * sy, ax * sy - sx * ay
    rows = [
        [(x1 - x0) * det + g * x1, (x3 - x0) * det + h * x3, x0 * det],
        [(y1 - y0) * det + g * y1, (y3 - y0) * det + h * y3, y0 * det],
        [g, h, det],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _lines_up(quads: Array) -> NDArray[np.bool_]:
    """Return which quadrilaterals (N, 4, 2) or (4, 2) have three corners in line, to nine digits."""
    along = np.roll(quads, -1, axis=-2) - quads
    after = np.roll(along, -1, axis=-2)
    turn = np.abs(along[..., 0] * after[..., 1] - along[..., 1] * after[..., 0])
    size = np.maximum((along**2).sum(axis=(-2, -1)), 1e-300)
    return np.asarray(~(turn.min(axis=-1) > 1e-9 * size))


def least_squares_homography(src: Array, dst: Array) -> Array:
    """Return the homography (3, 3) from points (P, 2) to (P, 2), P >= 4: the normalised direct linear transform.

    Hartley and Zisserman, Multiple View Geometry, algorithm 4.2; three quarters of the points in line make it fail.
    """
    A_src, A_dst = _normaliser(src), _normaliser(dst)
    s, d = _mapped(A_src, src), _mapped(A_dst, dst)
    zero, one = np.zeros(len(s)), np.ones(len(s))
    rows = np.concatenate(
        [
            np.stack([s[:, 0], s[:, 1], one, zero, zero, zero, -d[:, 0] * s[:, 0], -d[:, 0] * s[:, 1], -d[:, 0]], 1),
            np.stack([zero, zero, zero, s[:, 0], s[:, 1], one, -d[:, 1] * s[:, 0], -d[:, 1] * s[:, 1], -d[:, 1]], 1),
        ]
    )
    _, vectors = np.linalg.eigh(rows.T @ rows)
    return np.asarray(np.linalg.inv(A_dst) @ vectors[:, 0].reshape(3, 3) @ A_src)


def map_points(H: Array, points: Array) -> Array:
    """Return points (..., 2) mapped by homographies (3, 3); NaN where they fall on or behind the horizon."""
    w = points @ H[2, :2] + H[2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        mapped = (points @ H[:2, :2].T + H[:2, 2]) / w[..., None]
    return np.asarray(np.where(np.abs(w)[..., None] > 1e-12, mapped, np.nan))


def _normaliser(points: Array) -> Array:
    centre = points.mean(axis=0)
    scale = np.sqrt(2) / max(float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean())), 1e-12)
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def _mapped(A: Array, points: Array) -> Array:
    return np.asarray(points @ A[:2, :2].T + A[:2, 2])
