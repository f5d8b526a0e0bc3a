"""Figures of each tag from sums over its parts: what the alignment leaves out.

The reference is :func:`boxcal.detect.alignment.registration.sandwich_sums.sandwich_sums`. Compiled apart from the
steps, from sums that those leave, so that two processes can share the work of compiling.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.block_motion import motion_of_tag
from boxcal.detect.alignment.numba.cluster_sums import clusters_of_tag
from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.registration.finish import KURTOSIS_PRIOR
from boxcal.detect.alignment.registration.sandwich_sums import PartSums
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array


def sandwich_sums(batch: Batch, parts: PartSums, corners_px: Array, noise2: Array) -> Array:
    """Return what :func:`boxcal.detect.alignment.registration.sandwich_sums.sandwich_sums` does."""
    out = np.empty((len(parts.tags), 4))
    _fill(batch.arrays(), parts, np.ascontiguousarray(corners_px), noise2, KURTOSIS_PRIOR, out)
    return out


@kernel()
def _fill(batch: Any, parts: Any, corners: Any, noise2: Any, prior: Any, out: Any) -> None:  # noqa: PLR0917
    for m in range(len(out)):
        k = parts.tags[m]
        out[m, 0], out[m, 1] = clusters_of_tag(
            batch, k, parts.normals[m], parts.gradients[m], corners[k], noise2[k], prior
        )
        motion_of_tag(parts.blocks[m], noise2[k], out[m, 2:])
