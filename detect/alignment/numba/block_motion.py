"""The sums of :mod:`boxcal.detect.alignment.registration.block_motion`, compiled."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.image_model import differentiate
from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.numba.pixels import BLOCK, collect, room
from boxcal.detect.alignment.registration.block_motion import BLOCKS
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array


def block_motion(batch: Batch, noise2: Array) -> Array:
    """Return what :func:`boxcal.detect.alignment.registration.block_motion.block_motion` does."""
    out = np.zeros((len(batch), 3))
    _block_motion(batch.arrays(), noise2, out)
    return out


@kernel()
def _block_motion(batch: Any, noise2: Any, out: Any) -> None:
    stats = np.zeros(6)
    modules = batch.cells.shape[1] - 2
    for k in range(len(batch.rows)):
        pixels = room(batch.bounding_boxes[k])
        n = collect(batch, k, pixels)
        jac = differentiate(batch, k, pixels, n, stats)
        h, scale = batch.theta[k], batch.normalisation[k, 2]
        sums = np.zeros((BLOCKS * BLOCKS, 5))
        for p in range(n):
            u, v = np.float64(pixels[2, p]), np.float64(pixels[3, p])
            i = min(max(int(u * BLOCKS / modules), 0), BLOCKS - 1)
            j = min(max(int(v * BLOCKS / modules), 0), BLOCKS - 1)
            rows = jac[p // BLOCK]
            by_u, by_v, r = rows[2, p % BLOCK] * scale, rows[5, p % BLOCK] * scale, rows[14, p % BLOCK]
            gx = by_u * (h[0] - u * h[6]) + by_v * (h[3] - v * h[6])
            gy = by_u * (h[1] - u * h[7]) + by_v * (h[4] - v * h[7])
            block = sums[j * BLOCKS + i]
            block[0] += gx * gx
            block[1] += gx * gy
            block[2] += gy * gy
            block[3] += gx * r
            block[4] += gy * r
        for b in range(BLOCKS * BLOCKS):
            xx, xy, yy, x, y = sums[b, 0], sums[b, 1], sums[b, 2], sums[b, 3], sums[b, 4]
            det = xx * yy - xy * xy
            if det > 1e-9 * (xx + yy) ** 2:
                out[k, 0] += (yy * x * x - 2 * xy * x * y + xx * y * y) / det
                out[k, 1] += 2 * noise2[k]
                out[k, 2] += xx + yy
