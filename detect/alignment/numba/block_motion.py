"""The sums of :mod:`boxcal.detect.alignment.registration.block_motion`, compiled."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import loops
from boxcal.detect.alignment.numba.pixels import BLOCK
from boxcal.detect.alignment.registration.block_motion import BLOCKS


@loops()
def fill_blocks(batch: Any, k: Any, pixels: Any, n: Any, jac: Any, sums: Any) -> None:  # noqa: PLR0917
    """Add to the sums (9, 5) over blocks of one tag."""
    modules = batch.cells.shape[1] - 2
    h, scale = batch.theta[k], batch.normalisation[k, 2]
    for p in range(n):
        place, at = pixels[p // BLOCK], p % BLOCK
        u, v = np.float64(place[2 * BLOCK + at]), np.float64(place[3 * BLOCK + at])
        i = min(max(int(u * BLOCKS / modules), 0), BLOCKS - 1)
        j = min(max(int(v * BLOCKS / modules), 0), BLOCKS - 1)
        by_u, by_v, r = jac[2, p] * scale, jac[5, p] * scale, jac[14, p]
        gx = by_u * (h[0] - u * h[6]) + by_v * (h[3] - v * h[6])
        gy = by_u * (h[1] - u * h[7]) + by_v * (h[4] - v * h[7])
        block = sums[j * BLOCKS + i]
        block[0] += gx * gx
        block[1] += gx * gy
        block[2] += gy * gy
        block[3] += gx * r
        block[4] += gy * r


@loops()
def motion_of_tag(sums: Any, noise2: Any, out: Any) -> None:
    """Fill the two sums of a tag's blocks (9, 5), whose residuals have the variance ``noise2``."""
    out[0], out[1] = 0.0, 0.0
    for b in range(BLOCKS * BLOCKS):
        xx, xy, yy, x, y = sums[b, 0], sums[b, 1], sums[b, 2], sums[b, 3], sums[b, 4]
        det = xx * yy - xy * xy
        if det > 1e-9 * (xx + yy) ** 2:
            out[0] += (yy * x * x - 2 * xy * x * y + xx * y * y) / det
            out[1] += 2 * noise2
