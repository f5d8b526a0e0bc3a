"""Homographies between planes: exact from four points, least squares from more."""

import numpy as np

from detect.align.pattern import Array


def fit_homographies(src: Array, dst: Array) -> Array:
    """Return the homographies (N, 8), last entry 1, that map quadrilaterals (N, 4, 2) to one or N others.

    A quadrilateral with three corners in line has none: its entries are NaN.
    """
    dst = np.broadcast_to(dst, src.shape)
    x, y, u, v = src[..., 0], src[..., 1], dst[..., 0], dst[..., 1]
    zero, one = np.zeros_like(x), np.ones_like(x)
    A = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], -1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], -1),
        ],
        axis=1,
    )
    b = np.concatenate([u, v], axis=1)
    bad = ~(np.abs(np.linalg.det(np.nan_to_num(A))) > 1e-9)
    A[bad] = np.eye(8)
    h = np.linalg.solve(A, b[..., None])[..., 0]
    h[bad] = np.nan
    return np.asarray(h)


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
