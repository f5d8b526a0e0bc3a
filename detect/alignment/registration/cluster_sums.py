"""Residuals summed over clusters of pixels: the corners' variance from these, and from white noise."""

import numpy as np

from boxcal.detect.alignment.registration.finish import corners_by_homography, inverse_normal
from boxcal.detect.alignment.registration.parameters import PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array


def cluster_sums(
    batch: Batch, normals: Array, gradients: Array, corners_px: Array, noise2: Array
) -> tuple[Array, Array]:
    """Return for each tag (N,) the mean square of the squares' sums, and its expectation under white noise.

    Both are in units of the variance that white noise gives to the corners' eight coordinates. For ``normals``
    (N, S * S, 14, 14) and ``gradients`` (N, S * S, 14) see
    :func:`boxcal.detect.alignment.registration.image_model.clusters`; ``corners_px`` are (N, 4, 2), and ``noise2`` (N,)
    is the variance of the residuals.
    """
    normal = normals.sum(axis=1)
    # one pixel more than parameters: their squared sum is then the variance that the prior is weighed by
    inverse = inverse_normal(normal, np.stack([np.full(len(batch), PARAMETERS + 1.0), noise2], axis=1))
    D = corners_by_homography(batch.frame, batch.theta, batch.normalisation, corners_px).reshape(len(batch), 8, 8)
    B = inverse[:, :, :8] @ D.transpose(0, 2, 1)
    white = np.maximum(np.einsum("nie,nij,nje->ne", B, normal, B), 1e-300)
    moved = gradients @ B
    W = normals @ B[:, None]
    fitted = np.sum(W * (inverse[:, None] @ W), axis=(1, 2))
    observed = np.sum(moved**2, axis=1) / np.maximum(noise2, 1e-12)[:, None] / white
    return observed.mean(axis=1), np.maximum((white - fitted) / white, 0).mean(axis=1)
