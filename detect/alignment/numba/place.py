"""Places of pixels on a tag, block by block in single precision, from figures that are made once for a step.

The reference is :func:`boxcal.detect.alignment.radial_camera.undistort_locally` with a homography.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import loops
from boxcal.detect.alignment.numba.pixels import BLOCK, COLUMN, ROW, U, V, Y
from boxcal.detect.alignment.numba.radial_camera import local_undistortion
from boxcal.detect.alignment.radial_camera import A1, A2, A3, CENTRE_X, CENTRE_Y, LOG_ASPECT, PER_RADIUS, SKEW

FIGURES = 24
"""The homography's 8, whole and rest of the tag's centre (x, y), from the lens's centre to it (x, y), 1 / scale, the
chart's b and D - 1, a1, a2, a3, 1 / radius squared, skew and aspect."""
IN_PLACE = {"contract", "arcp", "nsz"}
"""What compiled places may change: not the order of sums, so that far from the image's corner none loses digits."""
_F1 = np.float32(1)


@loops()
def fill_figures(lens: Any, h: Any, normalisation: Any, figures: Any) -> None:
    """Fill what places on a tag are made of, see :data:`FIGURES`."""
    for k in range(8):
        figures[k] = h[k]
    x, y = normalisation[0], normalisation[1]
    figures[8], figures[9], figures[10], figures[11] = np.floor(x), np.floor(y), x - np.floor(x), y - np.floor(y)
    figures[12], figures[13], figures[14] = x - lens[CENTRE_X], y - lens[CENTRE_Y], normalisation[2]
    bx, by, D = local_undistortion(lens, normalisation)
    figures[15], figures[16], figures[17] = bx, by, D - 1
    figures[18], figures[19], figures[20] = lens[A1], lens[A2], lens[A3]
    figures[21], figures[22] = lens[PER_RADIUS] * lens[PER_RADIUS], lens[SKEW]
    figures[23] = np.exp(lens[LOG_ASPECT])


@loops(fastmath=IN_PLACE, forceinline=True)
def place(figures: Any, block: Any) -> None:
    """Fill x, y, u and v of a block of pixels, from the tag's centre so that single precision does."""
    h0, h1, h2, h3, h4, h5 = figures[0], figures[1], figures[2], figures[3], figures[4], figures[5]
    h6, h7, whole_x, whole_y, rest_x, rest_y = figures[6], figures[7], figures[8], figures[9], figures[10], figures[11]
    from_x, from_y, scale, bx, by, D_1 = figures[12], figures[13], figures[14], figures[15], figures[16], figures[17]
    a1, a2, a3, per_px2, skew, aspect = figures[18], figures[19], figures[20], figures[21], figures[22], figures[23]
    for p in range(BLOCK):
        ex, ey = (block[COLUMN + p] - whole_x) - rest_x, (block[ROW + p] - whole_y) - rest_y
        dx, dy = ex + from_x, ey + from_y
        sx, sy = dx - skew * dy, aspect * dy
        q = (sx * sx + sy * sy) * per_px2
        # the chart's factor less one, D / (g - b d) - 1
        more = D_1 + bx * sx + by * sy + q * (a1 + q * (a2 + q * a3))
        near = _F1 + D_1 - more
        # both places as fractions, so that one division does
        x, y = (ex * near + dx * more) * scale, (ey * near + dy * more) * scale
        far = h6 * x + h7 * y + near
        inverse = _F1 / (near * far)
        by_near, by_far = far * inverse, near * inverse
        block[p] = x * by_near
        block[Y + p] = y * by_near
        block[U + p] = (h0 * x + h1 * y + h2 * near) * by_far
        block[V + p] = (h3 * x + h4 * y + h5 * near) * by_far


@loops()
def place_all(figures: Any, pixels: Any, n: Any) -> None:
    """Fill the places of the first n pixels."""
    for part in range((n + BLOCK - 1) // BLOCK):
        place(figures, pixels[part])
