"""The collected pixels of a tag: blocks of 64, each with a row for each of seven figures, and sums over them."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.registration.image_model import LEAST_CONTRAST, MIDDLE

BLOCK = 64
"""Pixels that are summed together."""
ORDER = {"reassoc", "contract", "arcp", "nsz"}
"""What compiled sums may change: their order, not what they make of infinite figures, which decide what counts."""
OF_PIXEL = 7
"""x, y, u, v, grey level, column and row of a collected pixel."""
_U, _V, _GREY, COLUMN, ROW = (k * BLOCK for k in range(2, OF_PIXEL))
"""Where rows of a block begin after those of x and y."""


@kernel(inner=True)
def room(box: Any) -> Any:
    """Return blocks to collect the pixels of a box in, and one pixel more."""
    return np.empty((max(box[1] - box[0], 0) * max(box[3] - box[2], 0) // BLOCK + 1, OF_PIXEL * BLOCK), np.float32)


@loops(fastmath=ORDER)
def widths(theta: Any, normalisation: Any) -> Any:
    """Return the blur's deviations along u and v at the tag's centre, modules."""
    sigma = np.exp(theta[12]) * normalisation[2]
    u0, u1 = theta[0] - theta[2] * theta[6], theta[1] - theta[2] * theta[7]
    v0, v1 = theta[3] - theta[5] * theta[6], theta[4] - theta[5] * theta[7]
    return sigma * np.sqrt(u0 * u0 + u1 * u1), sigma * np.sqrt(v0 * v0 + v1 * v1)


@loops()
def fill_up(pixels: Any, n: Any) -> None:
    """Fill what n pixels leave free of their last block with the first pixel."""
    block = pixels[n // BLOCK]
    for at in range(n % BLOCK, BLOCK if n % BLOCK > 0 else 0):
        for row in range(OF_PIXEL):
            block[row * BLOCK + at] = pixels[0, row * BLOCK]


@kernel(inner=True)
def thin(pixels: Any, n: Any, every: Any) -> Any:
    """Return those of n collected pixels whose column and twice the row together ``every`` divides, and how many."""
    into, m = np.empty((n // BLOCK + 1, OF_PIXEL * BLOCK), np.float32), 0
    for p in range(n):
        block, at = pixels[p >> 6], p & 63
        if (int(block[COLUMN + at]) + 2 * int(block[ROW + at])) % every == 0:
            for row in range(OF_PIXEL):
                into[m >> 6, row * BLOCK + (m & 63)] = block[row * BLOCK + at]
            m += 1
    fill_up(into, m)
    return into, m


@kernel(inner=True)
def initial_intensity(batch: Any, k: Any, pixels: Any, n: Any) -> None:
    """Set offset and gain of a tag from its collected pixels.

    The reference is :func:`boxcal.detect.alignment.registration.image_model.initial_intensity`.
    """
    response, cells, theta = batch.response, batch.cells[batch.rows[k]], batch.theta[k]
    total, count = np.zeros(2), np.zeros(2)
    for p in range(n):
        block, at = pixels[p >> 6], p & 63
        u, v = block[_U + at] + np.float32(1), block[_V + at] + np.float32(1)
        i, j = int(u), int(v)
        if abs(u - i - 0.5) < MIDDLE and abs(v - j - 0.5) < MIDDLE:
            kind = 1 if cells[j, i] > 0.5 else 0
            total[kind] += block[_GREY + at]
            count[kind] += 1
    if count[0] > 0 and count[1] > 0:
        black, white = _light_of(response, total[0] / count[0]), _light_of(response, total[1] / count[1])
        theta[8], theta[9] = black, max(white - black, LEAST_CONTRAST)


@loops()
def _light_of(response: Any, grey: Any) -> Any:
    """Return the light that a response curve makes a grey level of."""
    last = len(response) - 1
    if grey <= response[0]:
        return 0.0
    if grey >= response[last]:
        return 1.0
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if response[middle] <= grey:
            low = middle
        else:
            high = middle
    return (low + (grey - response[low]) / (response[high] - response[low])) / last


@loops(fastmath=ORDER)
def add_blocks(pixels: Any, n: Any, jac: Any, blocks: Any) -> None:
    """Add the residuals of collected pixels to the sums over modules."""
    side = blocks.shape[0]
    for p in range(n):
        block, at = pixels[p >> 6], p & 63
        i = min(max(int(block[_U + at] + np.float32(1)), 0), side - 1)
        j = min(max(int(block[_V + at] + np.float32(1)), 0), side - 1)
        blocks[j, i, 0] += jac[14, p]
        blocks[j, i, 1] += 1
