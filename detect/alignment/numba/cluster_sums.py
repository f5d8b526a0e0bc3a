"""Residuals summed over squares of the image, and what white noise would make of them.

The reference is :func:`boxcal.detect.alignment.registration.cluster_sums.cluster_sums`.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.arrays import put_rows
from boxcal.detect.alignment.numba.cholesky import factor, solve_lower, solve_positive
from boxcal.detect.alignment.numba.finish import moves_of
from boxcal.detect.alignment.numba.image_model import ROWS, add_products
from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.numba.pixels import BLOCK, COLUMN, ROW
from boxcal.detect.alignment.registration.image_model import CLUSTERS
from boxcal.detect.alignment.registration.parameters import BLACK, KURTOSIS, PARAMETERS


@kernel(inner=True)
def clusters_of_tag(  # noqa: PLR0917 - arrays in, arrays out
    batch: Any, k: Any, pixels: Any, n: Any, jac: Any, side: Any, corners: Any, noise2: Any, prior: Any
) -> Any:
    """Return the clusters' mean square and its expectation, in units of the corners' variance under white noise.

    ``side`` is the clusters', px; ``noise2`` the residuals' variance, ``prior`` the kurtosis's deviation, ``corners``
    (4, 2) in px.
    """
    moves = np.zeros((2, PARAMETERS))
    A, B = np.empty((PARAMETERS, PARAMETERS)), np.empty((8, PARAMETERS))
    normal, inverse = np.empty((PARAMETERS, PARAMETERS)), np.empty((PARAMETERS, PARAMETERS))
    normals, gradients = (
        np.zeros((CLUSTERS * CLUSTERS, PARAMETERS, PARAMETERS)),
        np.zeros((CLUSTERS * CLUSTERS, PARAMETERS)),
    )
    _fill_squares(pixels, n, jac, side, batch.bounding_boxes[k], normals, gradients)
    for i in range(PARAMETERS):
        for j in range(PARAMETERS):
            normal[i, j] = 0.0
            for square in range(CLUSTERS * CLUSTERS):
                normal[i, j] += normals[square, i, j]
    put_rows(A, normal)
    for i in range(PARAMETERS):
        A[i, i] += 1e-12 + 1e-9 * normal[i, i]
    A[KURTOSIS, KURTOSIS] += max(noise2, 1e-9) / prior**2
    for c in range(4):
        moves_of(batch.lens, batch.theta[k], batch.normalisation[k], corners[c], moves)
        for row in range(2):
            put_rows(inverse, A)
            solve_positive(inverse, moves[row], B[2 * c + row])
    factor(A)
    return _mean_squares(normals, gradients, normal, A, B, max(noise2, 1e-12))


@kernel(inner=True)
def _fill_squares(  # noqa: PLR0917 - arrays in, arrays out
    pixels: Any, n: Any, jac: Any, side: Any, box: Any, normals: Any, gradients: Any
) -> None:
    """Fill the normal matrices and gradients of the squares in which pixels lie.

    Pixels are put in the order of their squares first, so that the products are vector instructions.
    """
    left, top = box[0] // side, box[2] // side
    square, order = np.empty(n, np.int64), np.empty(n, np.int64)
    begin = np.zeros(CLUSTERS * CLUSTERS + 2, np.int64)
    for p in range(n):
        block, at = pixels[p // BLOCK], p % BLOCK
        i = min(int(block[COLUMN + at]) // side - left, CLUSTERS - 1)
        j = min(int(block[ROW + at]) // side - top, CLUSTERS - 1)
        square[p] = j * CLUSTERS + i
        begin[square[p] + 2] += 1
    for k in range(len(begin) - 1):
        begin[k + 1] += begin[k]
    for p in range(n):
        order[begin[square[p] + 1]] = p
        begin[square[p] + 1] += 1
    room = np.zeros((len(jac), ROWS, BLOCK), np.float32)
    for k in range(CLUSTERS * CLUSTERS):
        count = begin[k + 1] - begin[k]
        parts = (count + BLOCK - 1) // BLOCK
        for m in range(parts * BLOCK):
            p = order[begin[k] + min(m, count - 1)]
            for a in range(ROWS):
                room[m // BLOCK, a, m % BLOCK] = jac[p // BLOCK, a, p % BLOCK] if m < count else np.float32(0)
        if parts > 0:
            add_products(room[:parts], normals[k], gradients[k])


@kernel(inner=True)
def _mean_squares(  # noqa: PLR0917 - arrays in
    normals: Any, gradients: Any, normal: Any, L: Any, B: Any, noise2: Any
) -> tuple[float, float]:
    """Return the mean over the corners' eight coordinates, observed and expected; ``L`` is the factor of the normal."""
    seen, expected = 0.0, 0.0
    W, half = np.empty(PARAMETERS), np.empty(PARAMETERS)
    for e in range(8):
        white = 0.0
        for i in range(PARAMETERS):
            for j in range(PARAMETERS):
                white += B[e, i] * normal[i, j] * B[e, j]
        white = max(white, 1e-300)
        moved2, fitted = 0.0, 0.0
        for square in range(len(normals)):
            if normals[square, BLACK, BLACK] == 0:
                continue
            moved = 0.0
            for i in range(PARAMETERS):
                moved += gradients[square, i] * B[e, i]
                W[i] = 0.0
                for j in range(PARAMETERS):
                    W[i] += normals[square, i, j] * B[e, j]
            solve_lower(L, W, half)
            moved2 += moved * moved
            for i in range(PARAMETERS):
                fitted += half[i] * half[i]
        seen += moved2 / noise2 / white / 8
        expected += max(white - fitted, 0.0) / white / 8
    return seen, expected
