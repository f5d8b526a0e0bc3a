"""The steps of an alignment, tag after tag, without a call per step and sum.

The reference is :func:`boxcal.detect.alignment.registration.gauss_newton.iterate`.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.arrays import aligned, clear, clear_rows, finite, put, put_rows
from boxcal.detect.alignment.numba.block_motion import fill_blocks
from boxcal.detect.alignment.numba.cholesky import solve_positive
from boxcal.detect.alignment.numba.cluster_sums import fill_squares
from boxcal.detect.alignment.numba.collect import collect, room_for
from boxcal.detect.alignment.numba.edges import module_differences
from boxcal.detect.alignment.numba.image_model import ROWS, add_products, differentiate, room_to_work, sum_of_squares
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.pixels import BLOCK, add_residuals, initial_intensity
from boxcal.detect.alignment.numba.place import fill_coefficients, place_all
from boxcal.detect.alignment.registration.finish import KURTOSIS_PRIOR
from boxcal.detect.alignment.registration.gauss_newton import (
    KURTOSIS_RANGE,
    LOG_SIGMA_RANGE,
    LONGEST_LOG,
    LONGEST_MODULES,
    MOST_EXPLAINED,
    MUCH,
    StepRules,
)
from boxcal.detect.alignment.registration.image_model import Sums, no_sums
from boxcal.detect.alignment.registration.parameters import KURTOSIS, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.sandwich_sums import PartSums, no_part_sums
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array

_NO_STEP = StepRules(
    free=np.ones((1, PARAMETERS), dtype=np.bool_), damping=0.0, stop_px=0.0, iterations=1, guess=False, sums_only=True
)


_NOTHING = no_part_sums(np.zeros(0, dtype=np.bool_), np.zeros((0, 4), dtype=np.int64))
_FAR_MODULES = 0.1
"""A tag that has moved less still covers the same pixels."""


def iterate(
    batch: Batch, sums: Sums, *, normalised: Array, module_px: Array, rules: StepRules, parts: PartSums | None = None
) -> None:
    """Take Gauss-Newton steps until each tag stands still; parameters and ``sums`` (from zero) change in place.

    For the arguments see :func:`boxcal.detect.alignment.registration.gauss_newton.iterate`.
    """
    _iterate(batch.arrays(), sums, normalised, module_px, rules, _NOTHING if parts is None else parts)


def accumulate(batch: Batch) -> Sums:
    """Return the normal equations of tags; see :func:`boxcal.detect.alignment.registration.image_model.accumulate`."""
    sums = no_sums(len(batch), batch.cells)
    _iterate(batch.arrays(), sums, np.zeros((len(batch), 4, 2)), np.ones(len(batch)), _NO_STEP, _NOTHING)
    return sums


@kernel()
def _iterate(batch: Any, sums: Any, normalised: Any, module_px: Any, rules: Any, parts: Any) -> None:  # noqa: PLR0917
    """Take the steps of each tag, or fill its sums alone: all in one, as it compiles once."""
    normal, gradient, stats, theta = sums.normal, sums.gradient, sums.stats, batch.theta
    side = batch.cells.shape[1]
    step, differences = np.zeros(PARAMETERS), np.empty((4, side * side), np.float32)
    blocks = sums.blocks.reshape((len(theta), 2 * side * side))
    room, work = room_for(batch.bounding_boxes, side), room_to_work()
    for k in range(len(batch.rows)):
        if not finite(theta[k]):
            continue
        n, few, since = 0, 0, np.inf
        module_differences(batch.cells[batch.rows[k]], differences)
        jac = np.empty((ROWS, 0), np.float32)
        for number in range(rules.iterations):
            clear_rows(normal[k])
            clear(gradient[k])
            clear(stats[k])
            if since > _FAR_MODULES:
                n, few = collect(batch, k, rules.thinned and number == 0, room)
                since = 0.0
            guess, thinned = rules.guess and number == 0, number == 0 and few < n
            m = few if thinned else n
            fill_coefficients(batch.lens, theta[k], batch.normalisation[k], room.coefficients)
            place_all(room.coefficients, room.pixels, n if guess else m)
            if guess:
                initial_intensity(batch, k, room.pixels, n)
            width = (m + BLOCK - 1) // BLOCK * BLOCK
            jac = aligned(ROWS * width).reshape((ROWS, width))
            differentiate(batch, k, differences, room.pixels, m, work, jac)
            add_products(jac, normal[k], gradient[k])
            stats[k, 0], stats[k, 1] = m, sum_of_squares(jac[PARAMETERS])
            if rules.sums_only:
                break
            information = max(stats[k, 1], 1e-9) / max(stats[k, 0] - PARAMETERS, 1.0) / KURTOSIS_PRIOR**2
            free = rules.free[min(number, len(rules.free) - 1)]
            _solve(normal[k], gradient[k], free, theta[k], information, rules.damping, step)
            _hold(theta[k], step)
            less = 0.0
            for i in range(PARAMETERS):
                row = 0.0
                for j in range(PARAMETERS):
                    row += normal[k, i, j] * step[j]
                less += step[i] * (2 * gradient[k, i] - row)
            less = min(max(less, 0.0), MOST_EXPLAINED * stats[k, 1])
            converging = less > MUCH * stats[k, 1]
            stats[k, 1] -= less
            moved = _step_on(theta[k], step, normalised[k])
            since += moved
            still = moved * module_px[k] < rules.stop_px and not (converging or thinned)
            if number >= len(rules.free) - 1 and still:
                break
        add_residuals(room.pixels, n, side, room.at, blocks[k], stats[k])
        if k < len(parts.at) and parts.at[k] >= 0:
            _sum_parts(batch, k, room.pixels, n, jac, step, parts)


@kernel(inner=True)
def _sum_parts(batch: Any, k: Any, pixels: Any, n: Any, jac: Any, step: Any, parts: Any) -> None:  # noqa: PLR0917
    """Fill the sums over parts of a tag that is asked; residuals become, to first order, those after a step."""
    m = parts.at[k]
    for row in range(PARAMETERS):
        by, one, r = np.float32(step[row]), jac[row], jac[PARAMETERS]
        for p in range(jac.shape[1]):
            r[p] -= by * one[p]
    fill_squares(pixels, n, jac, parts.side[m], batch.bounding_boxes[k], parts.normals[m], parts.gradients[m])
    fill_blocks(batch, k, pixels, n, jac, parts.blocks[m])


@kernel(inner=True)
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


@loops()
def _hold(theta: Any, step: Any) -> None:
    """Hold a step back where it would leave what the model can follow."""
    for i in range(PARAMETERS):
        if not np.isfinite(step[i]):
            step[i] = 0.0
    fraction = min(1.0, LONGEST_MODULES / max(abs(step[2]), abs(step[5]), 1e-12))
    for i in range(8):
        step[i] *= fraction
    log_psf = theta[LOG_PSF] + min(max(step[LOG_PSF], -LONGEST_LOG), LONGEST_LOG)
    step[LOG_PSF] = min(max(log_psf, LOG_SIGMA_RANGE[0]), LOG_SIGMA_RANGE[1]) - theta[LOG_PSF]
    kurtosis = theta[KURTOSIS] + step[KURTOSIS]
    step[KURTOSIS] = min(max(kurtosis, KURTOSIS_RANGE[0]), KURTOSIS_RANGE[1]) - theta[KURTOSIS]


@loops()
def _step_on(theta: Any, step: Any, normalised: Any) -> float:
    """Take the step; return how far that moves a corner at most, in modules."""
    most = 0.0
    for i in range(PARAMETERS):
        theta[i] += step[i]
    for c in range(4):
        x, y = normalised[c, 0], normalised[c, 1]
        w, w0 = theta[6] * x + theta[7] * y + 1, (theta[6] - step[6]) * x + (theta[7] - step[7]) * y + 1
        for i in range(2):
            j = 3 * i
            now = (theta[j] * x + theta[j + 1] * y + theta[j + 2]) / w
            before = ((theta[j] - step[j]) * x + (theta[j + 1] - step[j + 1]) * y + theta[j + 2] - step[j + 2]) / w0
            most = max(most, abs(now - before))
    return most
