"""Homographies between planes: exact between squares and quadrilaterals, least squares from more points."""

import numpy as np

from boxcal.target.arrays import Array


def from_square(side: float, quads: Array) -> Array:
    """Return the homographies (N, 8), last entry 1, of the square (0, 0) to (side, side) to quadrilaterals (N, 4, 2).

    Corners in the order (0, 0), (side, 0), (side, side), (0, side). The closed form is Heckbert's (Fundamentals of
    Texture Mapping and Image Warping, 1989, 2.2.3). A quadrilateral with three corners in line has none: its entries
    are NaN.
    """
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = quads.transpose(1, 2, 0)
    ax, ay, bx, by = x1 - x2, y1 - y2, x3 - x2, y3 - y2
    sx, sy = x0 - x1 - bx, y0 - y1 - by
    det = ax * by - bx * ay
    g, h = sx * by - bx * sy, ax * sy - sx * ay
    # g + det and h + det vanish, as det does, where the corner before, after or opposite is in line with its neighbours
    size = np.abs(ax * by) + np.abs(bx * ay)
    least = np.minimum(np.minimum(np.abs(det), np.abs(g + det)), np.minimum(np.abs(h + det), np.abs(g + h + det)))
    det = np.where(least > 1e-9 * size, det, np.nan)
    g, h = g / det, h / det
    rows = [x1 - x0 + g * x1, x3 - x0 + h * x3, side * x0, y1 - y0 + g * y1, y3 - y0 + h * y3, side * y0, g, h]
    return np.asarray((np.array(rows) / (side * det / det)).T)


def to_square(quads: Array, side: float) -> Array:
    """Return the homographies (N, 8), last entry 1, of quadrilaterals (N, 4, 2) to a square: :func:`from_square` back.

    NaN also where (0, 0) lies on the line that goes to infinity.
    """
    a, b, c, d, e, f, g, h = from_square(side, quads).T
    last = a * e - b * d
    with np.errstate(divide="ignore", invalid="ignore"):
        rows = [e - f * h, c * h - b, b * f - c * e, f * g - d, a - c * g, c * d - a * f, d * h - e * g, b * g - a * h]
        return np.asarray((np.array(rows) / np.where(np.abs(last) > 0, last, np.nan)).T)


def least_squares_homography(src: Array, dst: Array) -> Array:
    """Return the homography (3, 3) from points (P, 2) to (P, 2), P >= 4: the normalised direct linear transform.

    Hartley and Zisserman, Multiple View Geometry, algorithm 4.2; three quarters of the points in line make it fail.
    """
    (src_scale, src_centre, s), (dst_scale, dst_centre, d) = _normalised(src), _normalised(dst)
    p = np.empty((len(s), 12))
    p[:, :2], p[:, 2] = s, 1
    p[:, 3:6], p[:, 6:9] = d[:, :1] * p[:, :3], d[:, 1:] * p[:, :3]
    p[:, 9:] = d[:, :1] * p[:, 3:6] + d[:, 1:] * p[:, 6:9]
    # of the equations (p, 0, -u p) h = 0 and (0, p, -v p) h = 0 the normal matrix, block by block
    blocks = p[:, :3].T @ p
    normal = np.zeros((9, 9))
    normal[:3, :3] = normal[3:6, 3:6] = blocks[:, :3]
    normal[:3, 6:] = normal[6:, :3] = -blocks[:, 3:6]
    normal[3:6, 6:] = normal[6:, 3:6] = -blocks[:, 6:9]
    normal[6:, 6:] = blocks[:, 9:]
    _, vectors = np.linalg.eigh(normal)
    (x, y), (u, v) = src_scale * src_centre, dst_centre
    to_src = np.array([[src_scale, 0, -x], [0, src_scale, -y], [0, 0, 1]])
    from_dst = np.array([[1 / dst_scale, 0, u], [0, 1 / dst_scale, v], [0, 0, 1]])
    return np.asarray(from_dst @ vectors[:, 0].reshape(3, 3) @ to_src)


def map_points(H: Array, points: Array) -> Array:
    """Return points (..., 2) mapped by homographies (3, 3); NaN where they fall on or behind the horizon."""
    w = points @ H[2, :2] + H[2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        mapped = (points @ H[:2, :2].T + H[:2, 2]) / w[..., None]
    return np.asarray(np.where(np.abs(w)[..., None] > 1e-12, mapped, np.nan))


def _normalised(points: Array) -> tuple[float, Array, Array]:
    """Return a scale, the centre (2,) and points (P, 2) about it, scaled to a mean square of two."""
    centre = points.sum(axis=0) / len(points)
    apart = points - centre
    scale = np.sqrt(2) / max(float(np.sqrt(np.vdot(apart, apart) / len(points))), 1e-12)
    return scale, centre, apart * scale
