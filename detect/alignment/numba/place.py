"""Places of pixels on a tag, block by block in single precision, from coefficients that are computed once for a step.

The reference is :func:`boxcal.detect.alignment.radial_camera.undistort_locally` with a homography.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import loops
from boxcal.detect.alignment.numba.pixels import BLOCK, COLUMN, ROW, U, V, Y
from boxcal.detect.alignment.numba.radial_camera import local_undistortion
from boxcal.detect.alignment.radial_camera import A1, A2, A3, CENTRE_X, CENTRE_Y, LOG_ASPECT, PER_RADIUS, SKEW

COEFFICIENTS = 24
"""The homography's 8, whole and rest of the tag's centre (x, y), from the lens's centre to it (x, y), 1 / scale, the
chart's b and D - 1, a1, a2, a3, 1 / radius squared, skew and aspect."""
IN_PLACE = {"contract", "arcp", "nsz"}
"""What compiled places may change: not the order of sums, so that far from the image's corner none loses digits."""
_F1 = np.float32(1)


@loops()
def fill_coefficients(lens: Any, h: Any, normalisation: Any, c: Any) -> None:
    """Fill the coefficients of places on a tag, see :data:`COEFFICIENTS`."""
    for k in range(8):
        c[k] = h[k]
    x, y = normalisation[0], normalisation[1]
    c[8], c[9], c[10], c[11] = np.floor(x), np.floor(y), x - np.floor(x), y - np.floor(y)
    c[12], c[13], c[14] = x - lens[CENTRE_X], y - lens[CENTRE_Y], normalisation[2]
    bx, by, D = local_undistortion(lens, normalisation)
    c[15], c[16], c[17] = bx, by, D - 1
    c[18], c[19], c[20] = lens[A1], lens[A2], lens[A3]
    c[21], c[22] = lens[PER_RADIUS] * lens[PER_RADIUS], lens[SKEW]
    c[23] = np.exp(lens[LOG_ASPECT])


@loops(fastmath=IN_PLACE, forceinline=True)
def place(c: Any, block: Any) -> None:
    """Fill x, y, u and v of a block of pixels, from the tag's centre so that single precision does."""
    h0, h1, h2, h3, h4, h5 = c[0], c[1], c[2], c[3], c[4], c[5]
    h6, h7, whole_x, whole_y, rest_x, rest_y = c[6], c[7], c[8], c[9], c[10], c[11]
    from_x, from_y, scale, bx, by, D_1 = c[12], c[13], c[14], c[15], c[16], c[17]
    a1, a2, a3, per_px2, skew, aspect = c[18], c[19], c[20], c[21], c[22], c[23]
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
def place_all(c: Any, pixels: Any, n: Any) -> None:
    """Fill the places of the first n pixels."""
    for part in range((n + BLOCK - 1) // BLOCK):
        place(c, pixels[part])
