"""The steps of an alignment, tag after tag, without a call per step and sum.

The reference is :func:`boxcal.detect.alignment.registration.gauss_newton.iterate`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.numba.arrays import clear, clear_rows, finite, put, put_rows
from boxcal.detect.alignment.numba.block_motion import motion_of_tag
from boxcal.detect.alignment.numba.cholesky import solve_positive
from boxcal.detect.alignment.numba.cluster_sums import clusters_of_tag
from boxcal.detect.alignment.numba.image_model import ROWS, add_products, differentiate
from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.numba.pixels import BLOCK, add_blocks, collect, initial_intensity, replace_pixels, room
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
from boxcal.detect.alignment.registration.misfit_sums import MisfitSums
from boxcal.detect.alignment.registration.parameters import KURTOSIS, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array

_NO_STEP = StepRules(
    free=np.ones((1, PARAMETERS), dtype=np.bool_), damping=0.0, stop_px=0.0, iterations=1, guess=False, sums_only=True
)


class _Misfit(NamedTuple):
    """Settings and results of the sums that tell what the model leaves out, if they are wanted."""

    wanted: bool
    cluster_px: NDArray[np.int64]
    corners: Array
    noise2: Array
    prior: float
    observed: Array
    expected: Array
    motion: Array


_NONE = np.zeros(0)
_NO_MISFIT = _Misfit(
    False, np.zeros(0, np.int64), np.zeros((0, 4, 2)), _NONE, KURTOSIS_PRIOR, _NONE, _NONE, np.zeros((0, 3))
)
_FAR_MODULES = 0.1
"""A tag that has moved less still covers the same pixels."""


def iterate(batch: Batch, sums: Sums, *, normalised: Array, module_px: Array, rules: StepRules) -> None:
    """Take Gauss-Newton steps until each tag stands still; parameters and ``sums`` (from zero) change in place.

    For the arguments see :func:`boxcal.detect.alignment.registration.gauss_newton.iterate`.
    """
    _iterate(batch.arrays(), sums, normalised, module_px, rules, _NO_MISFIT)


def accumulate(batch: Batch) -> Sums:
    """Return the normal equations of tags; see :func:`boxcal.detect.alignment.registration.image_model.accumulate`."""
    sums = no_sums(len(batch), batch.cells)
    _iterate(batch.arrays(), sums, np.zeros((len(batch), 4, 2)), np.ones(len(batch)), _NO_STEP, _NO_MISFIT)
    return sums


def misfit_sums(batch: Batch, tags: TagAlignments, cluster_px: NDArray[np.int64]) -> MisfitSums:
    """Return what :func:`boxcal.detect.alignment.registration.misfit_sums.misfit_sums` does."""
    n = len(batch)
    out = MisfitSums(observed=np.zeros(n), expected=np.zeros(n), motion=np.zeros((n, 3)))
    corners, noise2 = np.ascontiguousarray(tags.corners_px), tags.noise**2
    wanted = _Misfit(True, cluster_px, corners, noise2, KURTOSIS_PRIOR, *out)
    sums = no_sums(n, batch.cells)
    _iterate(batch.arrays(), sums, np.zeros((n, 4, 2)), np.ones(n), _NO_STEP, wanted)
    return out


@kernel()
def _iterate(batch: Any, sums: Any, normalised: Any, module_px: Any, rules: Any, misfit: Any) -> None:  # noqa: PLR0917
    """Take the steps of each tag, or fill its sums alone, or those of the misfit: all in one, as it compiles once."""
    normal, gradient, stats, theta = sums.normal, sums.gradient, sums.stats, batch.theta
    step = np.zeros(PARAMETERS)
    for k in range(len(batch.rows)):
        if not finite(theta[k]):
            continue
        pixels, n, since = room(batch.bounding_boxes[k]), 0, np.inf
        jac = np.empty((0, ROWS, BLOCK), np.float32)
        for number in range(rules.iterations):
            clear_rows(normal[k])
            clear(gradient[k])
            clear(stats[k])
            if since > _FAR_MODULES:
                n = collect(batch, k, pixels)
                since = 0.0
                if rules.guess and number == 0:
                    initial_intensity(batch, k, pixels, n)
            else:
                replace_pixels(theta[k], pixels, n)
            jac = differentiate(batch, k, pixels, n, stats[k])
            if misfit.wanted:
                misfit.observed[k], misfit.expected[k] = clusters_of_tag(
                    batch, k, pixels, n, jac, misfit.cluster_px[k], misfit.corners[k], misfit.noise2[k], misfit.prior
                )
                motion_of_tag(batch, k, pixels, n, jac, misfit.noise2[k], misfit.motion[k])
                break
            add_products(jac, normal[k], gradient[k])
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
            if number >= len(rules.free) - 1 and moved * module_px[k] < rules.stop_px and not converging:
                break
        add_blocks(pixels, n, jac, sums.blocks[k])


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


@kernel(inner=True)
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


@kernel(inner=True)
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
