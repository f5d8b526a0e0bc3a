"""Sums over the residuals of aligned tags that tell what the alignment's model leaves out.

The reference is :func:`boxcal.detect.alignment.registration.misfit_sums.misfit_sums`.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.numba.block_motion import motion_of_tag
from boxcal.detect.alignment.numba.cluster_sums import clusters_of_tag
from boxcal.detect.alignment.numba.image_model import differentiate
from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.numba.pixels import collect, room
from boxcal.detect.alignment.registration.finish import KURTOSIS_PRIOR
from boxcal.detect.alignment.registration.misfit_sums import MisfitSums
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Batch


def misfit_sums(batch: Batch, tags: TagAlignments, cluster_px: NDArray[np.int64]) -> MisfitSums:
    """Return what :func:`boxcal.detect.alignment.registration.misfit_sums.misfit_sums` does."""
    out = MisfitSums(observed=np.empty(len(tags)), expected=np.empty(len(tags)), motion=np.zeros((len(tags), 3)))
    corners, noise2 = np.ascontiguousarray(tags.corners_px), tags.noise**2
    _misfit_sums(batch.arrays(), cluster_px, corners, noise2, KURTOSIS_PRIOR, out)
    return out


@kernel()
def _misfit_sums(batch: Any, cluster_px: Any, corners: Any, noise2: Any, prior: Any, out: Any) -> None:  # noqa: PLR0917
    stats = np.zeros(6)
    for k in range(len(batch.rows)):
        pixels = room(batch.bounding_boxes[k])
        n = collect(batch, k, pixels)
        jac = differentiate(batch, k, pixels, n, stats)
        out.observed[k], out.expected[k] = clusters_of_tag(
            batch, k, pixels, n, jac, cluster_px[k], corners[k], noise2[k], prior
        )
        motion_of_tag(batch, k, pixels, n, jac, noise2[k], out.motion[k])
