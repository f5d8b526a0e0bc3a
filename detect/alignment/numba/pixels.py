"""The collected pixels of a tag: blocks of 64, each with a row for each of eight values, and sums over them."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.registration.image_model import LEAST_CONTRAST, MIDDLE

BLOCK = 64
"""Pixels that are summed together."""
ORDER = {"reassoc", "contract", "arcp", "nsz"}
"""What compiled sums may change: their order, not what they make of infinite values, which decide what counts."""
OF_PIXEL = 8
"""x, y, u, v, grey level, column, row and residual of a collected pixel."""
Y, U, V, GREY, COLUMN, ROW, RESIDUAL = (k * BLOCK for k in range(1, OF_PIXEL))
"""Where rows of a block begin after the first."""


@loops(fastmath=ORDER)
def widths(theta: Any, normalisation: Any) -> Any:
    """Return the blur's deviations along u and v at the tag's centre, modules."""
    sigma = np.exp(theta[12]) * normalisation[2]
    u0, u1 = theta[0] - theta[2] * theta[6], theta[1] - theta[2] * theta[7]
    v0, v1 = theta[3] - theta[5] * theta[6], theta[4] - theta[5] * theta[7]
    return sigma * np.sqrt(u0 * u0 + u1 * u1), sigma * np.sqrt(v0 * v0 + v1 * v1)


@kernel(inner=True)
def initial_intensity(batch: Any, k: Any, pixels: Any, n: Any) -> None:
    """Set offset and gain of a tag from its collected pixels.

    The reference is :func:`boxcal.detect.alignment.registration.image_model.initial_intensity`.
    """
    response, cells, theta = batch.response, batch.cells[batch.rows[k]], batch.theta[k]
    total, count = np.zeros(2), np.zeros(2)
    for p in range(n):
        block, at = pixels[p // BLOCK], p % BLOCK
        u, v = block[U + at] + np.float32(1), block[V + at] + np.float32(1)
        i, j = int(u), int(v)
        if abs(u - i - 0.5) < MIDDLE and abs(v - j - 0.5) < MIDDLE:
            kind = 1 if cells[j, i] > 0.5 else 0
            total[kind] += block[GREY + at]
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
def add_residuals(pixels: Any, n: Any, side: Any, at: Any, modules: Any, stats: Any) -> None:  # noqa: PLR0917
    """Add the residuals of collected pixels to the sums over modules, and grey levels and predictions to theirs.

    ``modules`` holds sums and numbers of pixels of modules in rows (2 S,), ``at`` is scratch for 64 places in it.
    """
    one, last = np.float32(1), np.int32(side - 1)
    for part in range((n + BLOCK - 1) // BLOCK):
        block, used = pixels[part], min(BLOCK, n - part * BLOCK)
        y1, y2, p1, p2 = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
        for p in range(BLOCK):
            i = min(max(np.int32(block[U + p] + one), np.int32(0)), last)
            j = min(max(np.int32(block[V + p] + one), np.int32(0)), last)
            at[p] = np.int32(np.int32(j * np.int32(side) + i) * np.int32(2))
            live = one if np.int32(p) < np.int32(used) else np.float32(0)
            y, predicted = block[GREY + p] * live, (block[GREY + p] - block[RESIDUAL + p]) * live
            y1 += y
            y2 += y * y
            p1 += predicted
            p2 += predicted * predicted
        stats[2] += y1
        stats[3] += y2
        stats[4] += p1
        stats[5] += p2
        if used == BLOCK:
            # neighbours in a block are often of one module, whose sums would wait for each other
            for q in range(BLOCK // 4):
                _add_residual(block, q, at, modules)
                _add_residual(block, q + BLOCK // 4, at, modules)
                _add_residual(block, q + BLOCK // 2, at, modules)
                _add_residual(block, q + 3 * BLOCK // 4, at, modules)
        else:
            for p in range(used):
                _add_residual(block, p, at, modules)


@loops()
def _add_residual(block: Any, p: Any, at: Any, modules: Any) -> None:
    """Add the residual of one of a block's pixels to the sum of its module."""
    module = np.uint64(at[p])
    modules[module] += block[RESIDUAL + p]
    modules[module + np.uint64(1)] += 1.0
