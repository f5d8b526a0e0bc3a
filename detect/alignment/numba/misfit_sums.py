"""Sums over tags' pixels that tell what the alignment's model leaves out.

The reference is :func:`boxcal.detect.alignment.registration.misfit_sums.misfit_sums`. Compiled apart from the steps,
from pixels and Jacobians that those leave, so that two processes can share the work of compiling.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.numba.block_motion import motion_of_tag
from boxcal.detect.alignment.numba.cluster_sums import clusters_of_tag
from boxcal.detect.alignment.numba.gauss_newton import LastStep, last_step
from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.numba.pixels import BLOCK
from boxcal.detect.alignment.registration.finish import KURTOSIS_PRIOR
from boxcal.detect.alignment.registration.misfit_sums import MisfitSums
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array


def misfit_sums(batch: Batch, tags: TagAlignments, cluster_px: NDArray[np.int64]) -> MisfitSums:
    """Return what :func:`boxcal.detect.alignment.registration.misfit_sums.misfit_sums` does."""
    return sums_of(batch, last_step(batch), tags.corners_px, tags.noise**2, cluster_px)


def sums_of(
    batch: Batch, kept: LastStep, corners_px: Array, noise2: Array, cluster_px: NDArray[np.int64]
) -> MisfitSums:
    """Return the sums of tags (N,) from what their last step left; corners (N, 4, 2) and residuals' variances (N,)."""
    n = len(batch)
    out = MisfitSums(observed=np.zeros(n), expected=np.zeros(n), motion=np.zeros((n, 3)))
    _fill(batch.arrays(), kept, cluster_px, np.ascontiguousarray(corners_px), noise2, KURTOSIS_PRIOR, out)
    return out


@kernel()
def _fill(  # noqa: PLR0917 - arrays in, arrays out
    batch: Any, kept: Any, cluster_px: Any, corners: Any, noise2: Any, prior: Any, out: Any
) -> None:
    for k in range(len(batch.rows)):
        n, first = kept.used[k], kept.first[k]
        if n == 0:
            continue
        last = first + (n + BLOCK - 1) // BLOCK
        pixels, jac = kept.pixels[first:last], kept.jacobian[:, BLOCK * first : BLOCK * last]
        out.observed[k], out.expected[k] = clusters_of_tag(
            batch, k, pixels, n, jac, cluster_px[k], corners[k], noise2[k], prior
        )
        motion_of_tag(batch, k, pixels, n, jac, noise2[k], out.motion[k])
