"""Displacement of blocks of aligned tags from the alignment: a deformation that no homography follows.

A tag is divided into three blocks each way. With ``g`` the picture's gradient at a pixel and ``r`` its residual, a
block lies ``d = A^-1 y`` beside its place, ``A = sum g g^T``, ``y = sum g r`` (Lucas and Kanade 1981).
"""

import numpy as np

from boxcal.detect.alignment.registration.image_model import differentiate
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array

BLOCKS = 3
"""Blocks each way."""


def block_motion(batch: Batch, noise2: Array) -> Array:
    """Return for each tag (N, 3) the sum over blocks of ``d^T A d``, what noise alone makes of it, and of ``tr A``.

    ``noise2`` (N,) is the variance of the residuals.
    """
    out = np.zeros((len(batch), 3))
    for k in range(len(batch)):
        seen = differentiate(batch, k)
        if seen is None:
            continue
        h, (u, v), jacobian = batch.theta[k], seen.uv.T, seen.jacobian
        by_u, by_v = jacobian[:, 2] * batch.normalisation[k, 2], jacobian[:, 5] * batch.normalisation[k, 2]
        g = np.stack(
            [by_u * (h[0] - u * h[6]) + by_v * (h[3] - v * h[6]), by_u * (h[1] - u * h[7]) + by_v * (h[4] - v * h[7])],
            1,
        )
        modules = batch.cells.shape[1] - 2
        i, j = (np.clip((w * BLOCKS / modules).astype(int), 0, BLOCKS - 1) for w in (u, v))
        A, y = np.zeros((BLOCKS**2, 2, 2)), np.zeros((BLOCKS**2, 2))
        np.add.at(A, j * BLOCKS + i, g[:, :, None] * g[:, None, :])
        np.add.at(y, j * BLOCKS + i, g * (seen.grey - seen.predicted)[:, None])
        trace = np.trace(A, axis1=1, axis2=2)
        good = np.linalg.det(A) > 1e-9 * trace**2
        d = np.linalg.solve(A[good], y[good][..., None])[..., 0]
        out[k] = np.sum(d * y[good]), 2 * good.sum() * noise2[k], trace[good].sum()
    return out
