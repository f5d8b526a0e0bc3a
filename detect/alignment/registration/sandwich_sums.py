"""Sums over the residuals of aligned tags that tell what the alignment's model leaves out.

The last step of an alignment has all that is needed at hand, and sums it over parts of the tags that are asked:
:class:`PartSums`. Once the corners are known, :func:`sandwich_sums` makes of those what is told of each tag.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.registration.block_motion import BLOCKS, block_motion, block_sums
from boxcal.detect.alignment.registration.cluster_sums import cluster_sums
from boxcal.detect.alignment.registration.image_model import CLUSTERS, TagPixels, clusters
from boxcal.detect.alignment.registration.parameters import PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array, Index

CLUSTER_PX = 8
"""Least side of a square: JPEG's blocks have it."""


class PartSums(NamedTuple):
    """Sums over parts of those K of N tags that are asked, residuals to first order as they are after the last step.

    Attributes
    ----------
    at : (N,)
        Which of the K a tag is; -1 of tags that are not asked. Empty if none is.
    tags : (K,)
        Which of the N they are.
    side : (K,), px
        Of clusters.
    normals, gradients : (K, S * S, 14, 14), (K, S * S, 14)
        Normal equations of clusters, :func:`boxcal.detect.alignment.registration.image_model.clusters`.
    blocks : (K, 9, 5)
        Of blocks, :func:`boxcal.detect.alignment.registration.block_motion.block_sums`.
    """

    at: Index
    tags: Index
    side: Index
    normals: Array
    gradients: Array
    blocks: Array


def no_part_sums(asked: NDArray[np.bool_], boxes: NDArray[np.int64]) -> PartSums:
    """Return sums over nothing, of tags (N,) of which some are asked; bounding boxes (N, 4)."""
    tags = np.flatnonzero(asked)
    at = np.full(len(asked), -1)
    at[tags] = np.arange(len(tags))
    left, right, top, bottom = boxes[tags].T
    return PartSums(
        at=at,
        tags=tags,
        side=np.maximum(np.maximum(right - left, bottom - top) // (CLUSTERS - 1) + 1, CLUSTER_PX),
        normals=np.zeros((len(tags), CLUSTERS**2, PARAMETERS, PARAMETERS)),
        gradients=np.zeros((len(tags), CLUSTERS**2, PARAMETERS)),
        blocks=np.zeros((len(tags), BLOCKS**2, 5)),
    )


def sum_parts(batch: Batch, k: int, seen: TagPixels, out: PartSums) -> None:
    """Put into the sums those of tag k, which is asked, with these pixels."""
    m = out.at[k]
    out.normals[m], out.gradients[m] = clusters(seen, batch.bounding_boxes[k], int(out.side[m]))
    out.blocks[m] = block_sums(batch, k, seen)


def sandwich_sums(batch: Batch, parts: PartSums, corners_px: Array, noise2: Array) -> Array:
    """Return of each tag that is asked (K, 4) what its parts tell.

    Observed and expected of clusters (:func:`boxcal.detect.alignment.registration.cluster_sums.cluster_sums`), then
    the two of blocks (:func:`boxcal.detect.alignment.registration.block_motion.block_motion`). The batch has all tags
    at their last parameters, with corners (N, 4, 2) px and residuals' variances (N,).
    """
    some, noise2 = batch.take(parts.tags), noise2[parts.tags]
    observed, expected = cluster_sums(some, parts.normals, parts.gradients, corners_px[parts.tags], noise2)
    return np.column_stack([observed, expected, block_motion(parts.blocks, noise2)])
