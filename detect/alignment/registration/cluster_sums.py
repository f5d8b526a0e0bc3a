"""Residuals summed over clusters of pixels: the corners' variance as they tell it, and as white noise would."""

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.registration import image_model as model
from boxcal.detect.alignment.registration.finish import corners_by_homography, inverse_normal
from boxcal.detect.alignment.registration.parameters import PARAMETERS
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array


def cluster_sums(batch: Batch, tags: TagAlignments, cluster_px: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return for each tag (N,) the mean square of the squares' sums, and its expectation under white noise.

    Both are in units of the variance that white noise gives to the corners' eight coordinates. The batch holds the same
    tags; for ``cluster_px`` see :func:`boxcal.detect.alignment.registration.image_model.clusters`.
    """
    normals, gradients = model.clusters(batch, cluster_px)
    normal, noise2 = normals.sum(axis=1), tags.noise**2
    # one pixel more than parameters: their squared sum is then the variance that the prior is weighed by
    inverse = inverse_normal(normal, np.stack([np.full(len(tags), PARAMETERS + 1.0), noise2], axis=1))
    D = corners_by_homography(batch.frame, tags.theta, tags.normalisation, tags.corners_px).reshape(len(tags), 8, 8)
    B = inverse[:, :, :8] @ D.transpose(0, 2, 1)
    white = np.maximum(np.einsum("nie,nij,nje->ne", B, normal, B), 1e-300)
    moved = gradients @ B
    W = normals @ B[:, None]
    fitted = np.sum(W * (inverse[:, None] @ W), axis=(1, 2))
    observed = np.sum(moved**2, axis=1) / np.maximum(noise2, 1e-12)[:, None] / white
    return observed.mean(axis=1), np.maximum((white - fitted) / white, 0).mean(axis=1)
