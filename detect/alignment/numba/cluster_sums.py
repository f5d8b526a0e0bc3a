"""Residuals summed over squares of the image, and what white noise would make of them.

The reference is :func:`boxcal.detect.alignment.registration.cluster_sums.cluster_sums`.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.arrays import clear
from boxcal.detect.alignment.numba.cholesky import factor, solve_factored, solve_lower_rows
from boxcal.detect.alignment.numba.finish import moves_of
from boxcal.detect.alignment.numba.image_model import ROWS, add_products
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.pixels import BLOCK, COLUMN, ORDER, ROW
from boxcal.detect.alignment.registration.image_model import CLUSTERS
from boxcal.detect.alignment.registration.parameters import BLACK, KURTOSIS, PARAMETERS

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
    moves, A, B = np.zeros((2, PARAMETERS)), np.zeros((PARAMETERS, PARAMETERS)), np.empty((PARAMETERS, _MOVES))
    solution = np.empty(PARAMETERS)
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
        for axis in range(2):
            solve_factored(A, moves[axis], solution)
            for i in range(PARAMETERS):
                B[i, 2 * c + axis] = solution[i]
    W, moved, white = np.zeros((PARAMETERS, _SQUARES * _MOVES)), np.zeros(_SQUARES * _MOVES), np.zeros(_MOVES)
    _fill_moved(normals, gradients, B, W, moved, white)
    return _mean_squares(W, moved, A, white, max(noise2, 1e-12), np.empty(_SQUARES * _MOVES))


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
    """Fill squares' normal matrices times moves (14, 36 * 8), gradients times moves (36 * 8), and variances (8,).

    ``B`` are the moves (14, 8): eight of them are one vector.
    """
    for square in range(_SQUARES):
        normal, gradient, begin = normals[square], gradients[square], square * _MOVES
        if normal[BLACK, BLACK] == 0:  # without pixels
            continue
        for i in range(PARAMETERS):
            row, by_square = W[i, begin : begin + _MOVES], normal[i]
            for e in range(_MOVES):
                total = 0.0
                for j in range(PARAMETERS):
                    total += by_square[j] * B[j, e]
                row[e] = total
            by, of_moves, sums = gradient[i], B[i], moved[begin : begin + _MOVES]
            for e in range(_MOVES):
                white[e] += of_moves[e] * row[e]
                sums[e] += by * of_moves[e]


@loops(fastmath=ORDER)
def _mean_squares(W: Any, moved: Any, L: Any, white: Any, noise2: Any, fitted: Any) -> tuple[float, float]:  # noqa: PLR0917
    """Return the mean over the corners' eight coordinates, observed and expected; ``L`` is the factor of the normal.

    The systems of all squares and coordinates are solved together, in place in ``W`` (14, 36 * 8): long vectors.
    ``fitted`` (36 * 8,) is scratch for the sums of their squares.
    """
    solve_lower_rows(L, W)
    clear(fitted)
    for i in range(PARAMETERS):
        row = W[i]
        for k in range(len(row)):
            fitted[k] += row[k] * row[k]
    seen, expected = 0.0, 0.0
    for e in range(_MOVES):
        moved2, explained, variance = 0.0, 0.0, max(white[e], 1e-300)
        for square in range(_SQUARES):
            moved2 += moved[square * _MOVES + e] ** 2
            explained += fitted[square * _MOVES + e]
        seen += moved2 / noise2 / variance / _MOVES
        expected += max(variance - explained, 0.0) / variance / _MOVES
    return seen, expected
