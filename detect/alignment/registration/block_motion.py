"""Displacement of blocks of aligned tags from the alignment: a deformation that no homography follows.

A tag is divided into three blocks each way. With ``g`` the picture's gradient at a pixel and ``r`` its residual, a
block lies ``d = A^-1 y`` beside its place, ``A = sum g g^T``, ``y = sum g r`` (Lucas and Kanade 1981).
"""

import numpy as np

from boxcal.detect.alignment.registration.image_model import TagPixels
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array

BLOCKS = 3
"""Blocks each way."""


def block_sums(batch: Batch, k: int, seen: TagPixels) -> Array:
    """Return the entries (0, 0), (0, 1) and (1, 1) of A, then y, of the blocks (9, 5) of tag k with these pixels."""
    h, (u, v), jacobian = batch.theta[k], seen.uv.T, seen.jacobian
    by_u, by_v = jacobian[:, 2] * batch.normalisation[k, 2], jacobian[:, 5] * batch.normalisation[k, 2]
    gx = by_u * (h[0] - u * h[6]) + by_v * (h[3] - v * h[6])
    gy = by_u * (h[1] - u * h[7]) + by_v * (h[4] - v * h[7])
    r = seen.grey - seen.predicted
    modules = batch.cells.shape[1] - 2
    i, j = (np.clip((w * BLOCKS / modules).astype(int), 0, BLOCKS - 1) for w in (u, v))
    out = np.zeros((BLOCKS**2, 5))
    np.add.at(out, j * BLOCKS + i, np.stack([gx * gx, gx * gy, gy * gy, gx * r, gy * r], axis=1))
    return out


def block_motion(blocks: Array, noise2: Array) -> Array:
    """Return for each tag (N, 2) the sum over blocks of ``d^T A d``, and what noise alone makes of it.

    ``blocks`` (N, 9, 5) are sums of :func:`block_sums`, ``noise2`` (N,) is the variance of the residuals.
    """
    xx, xy, yy, x, y = np.moveaxis(blocks, 2, 0)
    det = xx * yy - xy * xy
    good = det > 1e-9 * (xx + yy) ** 2
    moved = np.where(good, yy * x * x - 2 * xy * x * y + xx * y * y, 0.0) / np.where(good, det, 1.0)
    return np.stack([moved.sum(axis=1), 2 * good.sum(axis=1) * noise2], axis=1)
