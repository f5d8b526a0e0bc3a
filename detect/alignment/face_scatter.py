"""Errors of corners estimated from their scatter about their own faces, whatever box these make.

A box may differ from its plan, and a lens from its model; both displace the corners of a face by a field that varies
little from tag to tag, a polynomial of low degree over the face. Paper that is wrinkled, or tags that are glued one by
one, displace whole tags. What corners err by in alignment changes a tag's shape. So what remains beside each face's
polynomial and each tag's own displacement tells the size of the errors: of noise, and of all that the alignment does
not model (motion, ink that spread, a curve of the camera's own), which the residuals of pixels tell but roughly.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.row_sets import distinct
from boxcal.detect.alignment.tag_patterns import Index
from boxcal.target.arrays import Array
from boxcal.target.box import Target

DEGREES = ((10, 4), (5, 3), (3, 2))
"""Tags of a face, at least, and the degree of its polynomial: 12 to 30 unknowns for 8 coordinates a tag."""
PRIOR = 5.0
"""So many squared deviations are taken to have been as large as the covariances say."""
ENOUGH = 12
"""Degrees of freedom with which faces tell more than the whole box does."""
RANGE = (0.02, 400.0)
"""Of the factor."""
SHAPE = 1.15 * 6 / 8
"""Fraction of the squares of a tag's eight coordinates that is left without its displacement. White noise moves a tag
as a whole less than its corners apart: 1.15 was measured over the pictures of benchmarks/hard_pictures.py."""
FAR2, ROUNDS = 18.0, 4
"""A corner's normalised square beyond this many times the mean of its coordinates' is an outlier and counts as that."""


def scatter(
    target: Target, rows: Index, apart_px: Array, cov_px2: Array, kinds: NDArray[np.bool_]
) -> tuple[Array, float]:
    """Return by what factor corners' variances differ from what their covariances say, by their faces.

    Parameters
    ----------
    target, rows
        Which tags (N,).
    apart_px : (N, 4, 2), px
        From a box that has the corners roughly where they are.
    cov_px2 : (N, 4, 2, 2), px^2
    kinds : (N,)
        Tags of two kinds, each with a factor of its own.

    Returns
    -------
    The factor of each tag (N,), the same for those of one face and kind, and the degrees of freedom that told them.
    """
    size = np.ones(len(rows))
    groups: list[tuple[Index, Array]] = []
    faces = target.tag_faces[rows]
    for face in distinct(faces):
        at = np.flatnonzero(faces == face)
        degree = next((degree for least, degree in DEGREES if len(at) >= least), None)
        if degree is None or not np.isfinite(apart_px[at]).all():
            continue
        basis = _polynomials(target, degree)[rows[at]].reshape(4 * len(at), -1)
        left = _left_over(basis, apart_px[at].reshape(-1, 2), cov_px2[at].reshape(-1, 2, 2)).reshape(-1, 4, 2)
        shape = left - left.mean(axis=1, keepdims=True)
        squares = np.sum(shape**2, axis=2) / (SHAPE * (1 - basis.shape[1] / (4 * len(at))))
        groups += [(at[kinds[at] == kind], squares[kinds[at] == kind]) for kind in (False, True)]
    for kind in (False, True):
        some = [(at, squares) for at, squares in groups if len(at) and kinds[at[0]] == kind]
        if some:
            usual = _mean_square(np.concatenate([squares.ravel() for _, squares in some]), 1.0)
            size[kinds == kind] = usual
            for at, squares in some:
                size[at] = _mean_square(squares.ravel(), usual)
    return size, float(sum(2 * squares.size for _, squares in groups))


def _mean_square(squares: Array, expected: float) -> float:
    """Return the mean square of a coordinate, of corners' normalised squares (P,); outliers count as far ones do."""
    size = expected
    for _ in range(ROUNDS):
        total = np.minimum(squares, FAR2 * size).sum()
        size = min(max(float(total + PRIOR * expected) / (2 * len(squares) + PRIOR), RANGE[0]), RANGE[1])
    return size


@lru_cache(maxsize=16)
def _polynomials(target: Target, degree: int) -> Array:
    """Return products (T, 4, K) of Chebyshev polynomials up to a degree at tags' corners, faces from -1 to 1."""
    out = np.empty((len(target.tag_faces), 4, (degree + 1) * (degree + 2) // 2))
    for face in np.unique(target.tag_faces):
        at = target.tag_faces == face
        T = target.T_box_face(int(face))
        p = ((target.tag_corners[at].reshape(-1, 3) - T[:3, 3]) @ T[:3, :3])[:, :2]
        low, high = p.min(axis=0), p.max(axis=0)
        place = (2 * p - low - high) / np.maximum(high - low, 1e-12)
        x, y = (np.polynomial.chebyshev.chebvander(place[:, k], degree) for k in (0, 1))
        products = [x[:, i] * y[:, j] for i in range(degree + 1) for j in range(degree + 1 - i)]
        out[at] = np.stack(products, axis=1).reshape(-1, 4, len(products))
    return out


def _left_over(basis: Array, apart: Array, cov: Array) -> Array:
    """Return the normalised deviations (P, 2) from the polynomials that fit deviations (P, 2), px, best."""
    a = 1 / np.sqrt(cov[:, 0, 0])
    b = -cov[:, 0, 1] / cov[:, 0, 0]
    c = 1 / np.sqrt(np.maximum(cov[:, 1, 1] + b * cov[:, 0, 1], 1e-300))
    # a u and c (b u + v): the inverse of the covariance's lower triangular factor; its square are the weights
    uu, uv, vv = a * a + b * b * c * c, b * c * c, c * c
    k, u, v = basis.shape[1], apart[:, 0], apart[:, 1]
    normal, right = np.empty((2 * k, 2 * k)), np.empty(2 * k)
    normal[:k, :k], normal[k:, k:] = basis.T @ (uu[:, None] * basis), basis.T @ (vv[:, None] * basis)
    normal[:k, k:] = normal[k:, :k] = basis.T @ (uv[:, None] * basis)
    right[:k], right[k:] = (uu * u + uv * v) @ basis, (uv * u + vv * v) @ basis
    normal.flat[:: 2 * k + 1] *= 1 + 1e-10
    fitted = np.linalg.solve(normal, right)
    u, v = u - basis @ fitted[:k], v - basis @ fitted[k:]
    return np.stack([a * u, c * (b * u + v)], axis=1)
