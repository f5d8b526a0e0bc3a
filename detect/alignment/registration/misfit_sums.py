"""Sums over the residuals of aligned tags that tell what the alignment's model leaves out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.registration.block_motion import block_motion
from boxcal.detect.alignment.registration.cluster_sums import cluster_sums
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array


class MisfitSums(NamedTuple):
    """Sums over tags' residuals.

    Attributes
    ----------
    observed, expected : (N,)
        Of clusters of pixels, :func:`boxcal.detect.alignment.registration.cluster_sums.cluster_sums`.
    motion : (N, 3)
        Of blocks, :func:`boxcal.detect.alignment.registration.block_motion.block_motion`.
    """

    observed: Array
    expected: Array
    motion: Array


def misfit_sums(batch: Batch, tags: TagAlignments, cluster_px: NDArray[np.int64]) -> MisfitSums:
    """Return the sums of aligned tags; the batch holds the same tags, ``cluster_px`` (N,) is their clusters' side."""
    observed, expected = cluster_sums(batch, tags, cluster_px)
    return MisfitSums(observed=observed, expected=expected, motion=block_motion(batch, tags.noise**2))
