"""The beginning of an alignment, tag after tag.

The reference is :func:`boxcal.detect.alignment.registration.begin.begin`.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.arrays import put
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.radial_camera import depth, local_undistortion, square
from boxcal.detect.alignment.radial_camera import CENTRE_X, CENTRE_Y, PER_RADIUS
from boxcal.detect.alignment.registration.begin import (
    EDGE_SIDE_PX,
    FIBONACCI,
    MARGIN_MODULES,
    NEAR,
    NEAR_SIDE_PX,
    START_SIGMA_PX,
    Begun,
)
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

_NOTHING = np.empty((0, PARAMETERS))
_LEAST_NEAR, _MOST_NEAR = NEAR
_LOG_START = float(np.log(START_SIGMA_PX))


def begin(frame: Frame, patterns: Patterns, corners_px: Array, given: Array | None, side_px: float) -> Begun:
    """Return what :func:`boxcal.detect.alignment.registration.begin.begin` does."""
    n = len(corners_px)
    out = Begun(
        theta=np.empty((n, PARAMETERS)),
        normalisation=np.empty((n, 3)),
        normalised=np.empty((n, 4, 2)),
        bounding_boxes=np.empty((n, 4), np.int64),
        margin=np.empty(n),
        stride=np.empty((n, 3), np.int64),
        near=np.empty(n),
        module_px=np.empty(n),
    )
    height, width = frame.grey.shape
    tag = (patterns.modules, float(patterns.gap_modules), width, height)
    given = _NOTHING if given is None else np.ascontiguousarray(given)
    _begin(frame.lens, tag, np.ascontiguousarray(corners_px, dtype=np.float64), given, float(side_px), out)
    return out


@kernel()
def _begin(lens: Any, tag: Any, corners: Any, given: Any, side_px: Any, out: Any) -> None:  # noqa: PLR0917
    modules, gap, width, height = tag
    known = np.empty((4, 2))
    for k in range(len(corners)):
        theta = out.theta[k]
        if len(given) > 0:
            put(theta, given[k])
        else:
            for i in range(BLACK, PARAMETERS):
                theta[i] = 0.0
            theta[BLACK], theta[CONTRAST], theta[LOG_PSF] = 0.2, 0.5, _LOG_START
        _chart(lens, corners[k], out.normalisation[k], out.normalised[k])
        _to_square(out.normalised[k], modules, theta)
        for c in range(4):
            for i in range(2):
                known[c, i] = corners[k, c, i] if np.isfinite(corners[k, c, i]) else 0.0
        shortest, mean, longest = _sides(known)
        blur = np.exp(min(max(theta[LOG_PSF], -2.0), 2.0)) * modules / max(shortest, 1e-3)
        margin = min(max(gap - 2.5 * blur, 0.35), MARGIN_MODULES, 0.9 * gap)
        out.margin[k], out.module_px[k] = margin, longest / modules
        near = min(max(NEAR_SIDE_PX / max(mean, 1e-3), _LEAST_NEAR), _MOST_NEAR)
        out.near[k] = near
        _box(known, 1 + 2.2 * margin / modules, width, height, out.bounding_boxes[k])
        edges = len(given) > 0
        _stride(mean, mean * mean * (_MOST_NEAR / near) if edges else _area(known), side_px, edges, out.stride[k])


@loops()
def _chart(lens: Any, corners: Any, normalisation: Any, normalised: Any) -> None:
    """Fill a tag's centre and scale, and its corners on the chart about the centre."""
    x = 0.25 * (corners[0, 0] + corners[1, 0] + corners[2, 0] + corners[3, 0])
    y = 0.25 * (corners[0, 1] + corners[1, 1] + corners[2, 1] + corners[3, 1])
    reach = 1.0
    for c in range(4):
        reach = max(reach, np.hypot(corners[c, 0] - x, corners[c, 1] - y))
    scale = 1 / reach
    normalisation[0], normalisation[1], normalisation[2] = x, y, scale
    bx, by, D = local_undistortion(lens, normalisation)
    for c in range(4):
        dx, dy = corners[c, 0] - lens[CENTRE_X], corners[c, 1] - lens[CENTRE_Y]
        sx, sy = square(lens, dx, dy)
        g, _, _ = depth(lens, (sx * sx + sy * sy) * lens[PER_RADIUS] ** 2)
        f = D / (g - bx * sx - by * sy)
        normalised[c, 0] = (dx * f - (x - lens[CENTRE_X])) * scale
        normalised[c, 1] = (dy * f - (y - lens[CENTRE_Y])) * scale


@loops()
def _to_square(quad: Any, side: Any, h: Any) -> None:
    """Fill the homography of a quadrilateral to a square, as ``homography.to_square`` does."""
    x0, y0, x1, y1 = quad[0, 0], quad[0, 1], quad[1, 0], quad[1, 1]
    x2, y2, x3, y3 = quad[2, 0], quad[2, 1], quad[3, 0], quad[3, 1]
    ax, ay, bx, by = x1 - x2, y1 - y2, x3 - x2, y3 - y2
    sx, sy = x0 - x1 - bx, y0 - y1 - by
    det = ax * by - bx * ay
    p, q = sx * by - bx * sy, ax * sy - sx * ay
    least = min(abs(det), abs(p + det), abs(q + det), abs(p + q + det))
    p, q = p / det, q / det
    a, b, c = (x1 - x0 + p * x1) / side, (x3 - x0 + q * x3) / side, x0
    d, e, f = (y1 - y0 + p * y1) / side, (y3 - y0 + q * y3) / side, y0
    g, r = p / side, q / side
    last = a * e - b * d
    if not (least > 1e-9 * (abs(ax * by) + abs(bx * ay)) and abs(last) > 0):
        last = np.nan
    h[0], h[1], h[2] = (e - f * r) / last, (c * r - b) / last, (b * f - c * e) / last
    h[3], h[4], h[5] = (f * g - d) / last, (a - c * g) / last, (c * d - a * f) / last
    h[6], h[7] = (d * r - e * g) / last, (b * g - a * r) / last


@loops()
def _sides(corners: Any) -> Any:
    """Return the shortest, the mean and the longest side."""
    shortest, total, longest = np.inf, 0.0, 0.0
    for c in range(4):
        after = (c + 1) % 4
        side = np.hypot(corners[after, 0] - corners[c, 0], corners[after, 1] - corners[c, 1])
        shortest, total, longest = min(shortest, side), total + side, max(longest, side)
    return shortest, 0.25 * total, longest


@loops()
def _box(corners: Any, reach: Any, width: Any, height: Any, out: Any) -> None:
    """Fill first and last column, first and last row of what a tag takes, enlarged about its centre."""
    for i in range(2):
        limit = float(width) if i == 0 else float(height)
        low, high, total = corners[0, i], corners[0, i], 0.0
        for c in range(4):
            low, high, total = min(low, corners[c, i]), max(high, corners[c, i]), total + corners[c, i]
        centre = 0.25 * total
        out[2 * i] = int(min(max(np.floor(centre + reach * (low - centre)), 0.0), limit))
        out[2 * i + 1] = int(min(max(np.ceil(centre + reach * (high - centre)) + 1, 0.0), limit))


@loops()
def _area(corners: Any) -> Any:
    """Return the area of a quadrilateral."""
    ax, ay = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    bx, by = corners[3, 0] - corners[1, 0], corners[3, 1] - corners[1, 1]
    return 0.5 * abs(ax * by - ay * bx)


@loops()
def _stride(side: Any, area: Any, side_px: Any, edges: Any, out: Any) -> None:
    """Fill which pixels of a tag with sides of a mean length and that area are used."""
    at = 1
    while at < len(FIBONACCI) - 1 and FIBONACCI[at + 1] <= area / (side_px * side_px):
        at += 1
    out[0], out[1] = FIBONACCI[at], FIBONACCI[at - 1]
    out[2] = int(min(max(side / EDGE_SIDE_PX, 1.0), 1000.0)) if edges else 1 << 40
