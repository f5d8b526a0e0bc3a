"""Residuals summed over squares of the image, and what white noise would make of them.

The reference is :func:`boxcal.detect.alignment.registration.cluster_sums.cluster_sums`.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.cholesky import factor, solve_factored
from boxcal.detect.alignment.numba.finish import moves_of
from boxcal.detect.alignment.numba.image_model import ROWS, add_products
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.pixels import BLOCK, COLUMN, ORDER, ROW
from boxcal.detect.alignment.registration.image_model import CLUSTERS
from boxcal.detect.alignment.registration.parameters import KURTOSIS, PARAMETERS

_MOVES = 8
"""Coordinates of the corners."""
_SQUARES = CLUSTERS * CLUSTERS


@kernel(inner=True)
def clusters_of_tag(  # noqa: PLR0917 - arrays in, arrays out
    batch: Any, k: Any, normals: Any, gradients: Any, corners: Any, noise2: Any, prior: Any
) -> Any:
    """Return the clusters' mean square and its expectation, in units of the corners' variance under white noise.

    ``noise2`` is the residuals' variance, ``prior`` the kurtosis's deviation, ``corners`` are (4, 2) in px.
    """
    moves, A, B = np.zeros((2, PARAMETERS)), np.zeros((PARAMETERS, PARAMETERS)), np.empty((_MOVES, PARAMETERS))
    for square in range(_SQUARES):
        for i in range(PARAMETERS):
            for j in range(PARAMETERS):
                A[i, j] += normals[square, i, j]
    for i in range(PARAMETERS):
        A[i, i] += 1e-12 + 1e-9 * A[i, i]
    A[KURTOSIS, KURTOSIS] += max(noise2, 1e-9) / prior**2
    factor(A)
    for c in range(4):
        moves_of(batch.lens, batch.theta[k], batch.normalisation[k], corners[c], moves)
        solve_factored(A, moves[0], B[2 * c])
        solve_factored(A, moves[1], B[2 * c + 1])
    W, moved, white = np.empty((PARAMETERS, _SQUARES * _MOVES)), np.zeros(_SQUARES * _MOVES), np.zeros(_MOVES)
    _fill_moved(normals, gradients, B, W, moved, white)
    return _mean_squares(W, moved, A, white, max(noise2, 1e-12))


@kernel(inner=True)
def fill_squares(  # noqa: PLR0917 - arrays in, arrays out
    pixels: Any, n: Any, jac: Any, side: Any, box: Any, normals: Any, gradients: Any
) -> None:
    """Fill the normal matrices and gradients of the squares in which pixels lie.

    Pixels are put in the order of their squares first, so that the products are vector instructions.
    """
    left, top = box[0] // side, box[2] // side
    square, order = np.empty(n, np.int64), np.empty(n, np.int64)
    begin = np.zeros(_SQUARES + 2, np.int64)
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
    room = np.empty(ROWS * (n + BLOCK), np.float32)
    for k in range(_SQUARES):
        count = begin[k + 1] - begin[k]
        if count == 0:
            continue
        width = (count + BLOCK - 1) // BLOCK * BLOCK
        rows = room[: ROWS * width].reshape((ROWS, width))
        for a in range(ROWS):
            for m in range(count):
                rows[a, m] = jac[a, order[begin[k] + m]]
            for m in range(count, width):
                rows[a, m] = 0
        add_products(rows, normals[k], gradients[k])


@loops(fastmath=ORDER)
def _fill_moved(normals: Any, gradients: Any, B: Any, W: Any, moved: Any, white: Any) -> None:  # noqa: PLR0917
    """Fill squares' normal matrices times moves (14, 36 * 8), gradients times moves (36 * 8), and variances (8,)."""
    for square in range(_SQUARES):
        for e in range(_MOVES):
            k = square * _MOVES + e
            for i in range(PARAMETERS):
                total = 0.0
                for j in range(PARAMETERS):
                    total += normals[square, i, j] * B[e, j]
                W[i, k] = total
                white[e] += B[e, i] * total
                moved[k] += gradients[square, i] * B[e, i]


@kernel(inner=True, fastmath=ORDER)
def _mean_squares(W: Any, moved: Any, L: Any, white: Any, noise2: Any) -> tuple[float, float]:
    """Return the mean over the corners' eight coordinates, observed and expected; ``L`` is the factor of the normal.

    The systems of all squares and coordinates are solved together, in place in ``W`` (14, 36 * 8): long vectors.
    """
    moved2, fitted, wide = np.zeros(_MOVES), np.zeros(_MOVES), W.shape[1]
    for i in range(PARAMETERS):
        row, factor_i = W[i], 1 / L[i, i]
        for m in range(i):
            before, factor_m = W[m], L[i, m]
            for k in range(wide):
                row[k] -= factor_m * before[k]
        for k in range(wide):
            row[k] *= factor_i
    for k in range(wide):
        moved2[k % _MOVES] += moved[k] * moved[k]
        for i in range(PARAMETERS):
            fitted[k % _MOVES] += W[i, k] * W[i, k]
    seen, expected = 0.0, 0.0
    for e in range(_MOVES):
        variance = max(white[e], 1e-300)
        seen += moved2[e] / noise2 / variance / _MOVES
        expected += max(variance - fitted[e], 0.0) / variance / _MOVES
    return seen, expected
