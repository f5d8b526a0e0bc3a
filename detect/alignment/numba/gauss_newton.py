"""The steps of an alignment, tag after tag, without a call per step and sum.

The reference is :func:`boxcal.detect.alignment.registration.gauss_newton.iterate`.
"""

from typing import Any

import numpy as np
from numba import njit

from boxcal.detect.alignment.numba.arrays import clear, clear_rows, finite, put, put_rows
from boxcal.detect.alignment.numba.cholesky import solve_positive
from boxcal.detect.alignment.numba.image_model import ROWS, add_products, differentiate
from boxcal.detect.alignment.numba.pixels import BLOCK, add_blocks, collect, initial_intensity, replace_pixels, room
from boxcal.detect.alignment.registration.image_model import Sums
from boxcal.detect.alignment.registration.parameters import KURTOSIS, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array

_FAR_MODULES = 0.1
"""A tag that has moved less still covers the same pixels."""


def iterate(
    batch: Batch, sums: Sums, *, normalised: Array, module_px: Array, free: Any, damping: float, stop_px: float,
    iterations: int, limits: Array, held: tuple[float, float, float], much: float, prior: float, guess: bool,
) -> None:  # fmt: skip
    """Take Gauss-Newton steps until each tag stands still; parameters and ``sums`` (from zero) change in place.

    Parameters
    ----------
    batch
        The tags.
    sums
        Of the last step, the sum of squared residuals less what that step explains.
    normalised : (N, 4, 2)
        Corners in normalised places; what moves there says when to stop.
    module_px : (N,), px
    free : (S, 14)
        What each step may change; the last row holds for all further steps.
    damping, stop_px, iterations
        As in :func:`boxcal.detect.alignment.registration.align.align`.
    limits : (2, 2)
        Least and most log sigma, then kurtosis.
    held
        Longest step of a point, in modules; of log sigma; largest fraction of the squared residuals a step may explain.
    much
        A step that explains this share is not the last.
    prior
        Deviation of the kurtosis before anything is seen.
    guess
        Set black and white from the middle of the modules first.
    """
    _iterate(
        *batch.arrays_and(
            sums.normal, sums.gradient, sums.stats, sums.blocks, normalised, module_px, free, damping, stop_px,
            iterations, limits, held, much, prior, guess,
        )
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _iterate(  # noqa: PLR0917 - arrays in, arrays out
    grey: Any, response: Any, linear: Any, lens: Any, cells: Any, rows: Any, theta: Any, normalisation: Any,
    bounding_boxes: Any, margin: Any,
    stride: Any, normal: Any, gradient: Any, stats: Any, blocks: Any, normalised: Any, module_px: Any,
    free: Any, damping: Any, stop_px: Any, iterations: Any, limits: Any, held: Any, much: Any, prior: Any,
    guess: Any,
) -> None:  # fmt: skip
    step = np.zeros(PARAMETERS)
    for k in range(len(rows)):
        if not finite(theta[k]):
            continue
        pixels, n, since = room(bounding_boxes[k]), 0, np.inf
        jac = np.empty((0, ROWS, BLOCK), np.float32)
        for number in range(iterations):
            clear_rows(normal[k])
            clear(gradient[k])
            clear(stats[k])
            if since > _FAR_MODULES:
                n = collect(
                    grey,
                    lens,
                    cells[rows[k]],
                    theta[k],
                    normalisation[k],
                    bounding_boxes[k],
                    margin[k],
                    stride[k],
                    pixels,
                )
                since = 0.0
                if guess and number == 0:
                    initial_intensity(response, cells[rows[k]], pixels, n, theta[k])
            else:
                replace_pixels(theta[k], pixels, n)
            jac = differentiate(response, linear, cells[rows[k]], theta[k], normalisation[k], pixels, n, stats[k])
            add_products(jac, normal[k], gradient[k])
            information = max(stats[k, 1], 1e-9) / max(stats[k, 0] - PARAMETERS, 1.0) / prior**2
            _solve(normal[k], gradient[k], free[min(number, len(free) - 1)], theta[k], information, damping, step)
            _hold(theta[k], limits, held, step)
            less = 0.0
            for i in range(PARAMETERS):
                row = 0.0
                for j in range(PARAMETERS):
                    row += normal[k, i, j] * step[j]
                less += step[i] * (2 * gradient[k, i] - row)
            less = min(max(less, 0.0), held[2] * stats[k, 1])
            converging = less > much * stats[k, 1]
            stats[k, 1] -= less
            moved = _step_on(theta[k], step, normalised[k])
            since += moved
            if number >= len(free) - 1 and moved * module_px[k] < stop_px and not converging:
                break
        add_blocks(pixels, n, jac, blocks[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(  # noqa: PLR0917
    normal: Any, gradient: Any, free: Any, theta: Any, information: Any, damping: Any, step: Any
) -> None:
    """Fill the damped step of the free parameters, by Cholesky's decomposition."""
    A, b = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    put_rows(A, normal)
    put(b, gradient)
    A[KURTOSIS, KURTOSIS] += information
    b[KURTOSIS] -= information * theta[KURTOSIS]
    for i in range(PARAMETERS):
        A[i, i] += damping * A[i, i] if A[i, i] > 1e-12 else 1.0
        if not free[i]:
            for j in range(PARAMETERS):
                A[i, j], A[j, i] = 0.0, 0.0
            A[i, i], b[i] = 1.0, 0.0
    solve_positive(A, b, step)


@njit(cache=True, nogil=True, error_model="numpy")
def _hold(theta: Any, limits: Any, held: Any, step: Any) -> None:
    """Hold a step back where it would leave what the model can follow."""
    for i in range(PARAMETERS):
        if not np.isfinite(step[i]):
            step[i] = 0.0
    share = min(1.0, held[0] / max(abs(step[2]), abs(step[5]), 1e-12))
    for i in range(8):
        step[i] *= share
    step[LOG_PSF] = min(max(step[LOG_PSF], -held[1]), held[1])
    for row, i in enumerate((LOG_PSF, KURTOSIS)):
        step[i] = min(max(theta[i] + step[i], limits[row, 0]), limits[row, 1]) - theta[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _step_on(theta: Any, step: Any, normalised: Any) -> float:
    """Take the step; return how far that moves a corner at most, in modules."""
    most = 0.0
    before = np.empty((4, 2))
    for turn in range(2):
        for c in range(4):
            x, y = normalised[c, 0], normalised[c, 1]
            w = theta[6] * x + theta[7] * y + 1
            u = (theta[0] * x + theta[1] * y + theta[2]) / w
            v = (theta[3] * x + theta[4] * y + theta[5]) / w
            if turn == 0:
                before[c, 0], before[c, 1] = u, v
            else:
                most = max(most, abs(u - before[c, 0]), abs(v - before[c, 1]))
        if turn == 0:
            for i in range(PARAMETERS):
                theta[i] += step[i]
    return most
