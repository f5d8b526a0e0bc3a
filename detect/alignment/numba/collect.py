"""The pixels of a tag, collected in blocks: once for several steps, as they stay nearly the same.

First every pixel of the tag's box is written down that the lattice or a diagonal meets; then blocks of them are placed
on the tag and looked at together, as vector instructions, and those that count move up.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.pixels import BLOCK, COLUMN, ROW, fill_up, widths
from boxcal.detect.alignment.numba.radial_camera import depth, local_undistortion, square
from boxcal.detect.alignment.radial_camera import A1, A2, A3, CENTRE_X, CENTRE_Y, LOG_ASPECT, PER_RADIUS, SKEW
from boxcal.detect.alignment.registration.image_model import NEAR_SIGMAS

_Y, _U, _V, _GREY = (k * BLOCK for k in range(1, 5))
"""Where rows of a block begin after the first."""
_IN_PLACE = {"contract", "arcp", "nsz"}
"""What compiled places may change: not the order of sums, so that far from the image's corner none loses digits."""
_F0, _F05, _F1 = np.float32(0), np.float32(0.5), np.float32(1)
_I0, _I1, _I2 = np.int32(0), np.int32(1), np.int32(2)


@kernel(inner=True)
def collect(batch: Any, k: Any, differences: Any, pixels: Any) -> int:
    """Fill blocks with grey levels, columns and rows of the pixels of tag k that count; return how many.

    ``differences`` are the modules', see :func:`boxcal.detect.alignment.numba.edges.module_differences`.
    """
    side, margin, box = batch.cells.shape[1], batch.margin[k], batch.bounding_boxes[k]
    spans = np.empty((max(box[3] - box[2], 0), 2), np.int64)
    _fill_spans(batch.lens, batch.theta[k], batch.normalisation[k], box, -margin, side - 2 + margin, spans)
    on_lattice, met = _meet(box, batch.stride[k], spans, pixels)
    fill_up(pixels, met)
    wide_u, wide_v = widths(batch.theta[k], batch.normalisation[k])
    limits = (
        np.float32(-margin), np.float32(side - 2 + margin), np.float32(NEAR_SIGMAS * wide_u),
        np.float32(NEAR_SIGMAS * wide_v),
    )  # fmt: skip
    counts, by_u, by_v, n = _counting(differences, side), np.empty(BLOCK, np.uint32), np.empty(BLOCK, np.uint32), 0
    for part in range((met + BLOCK - 1) // BLOCK):
        block = pixels[part]
        place(batch.lens, batch.theta[k], batch.normalisation[k], block)
        _look(block, side, limits, on_lattice - part * BLOCK, by_u, by_v)
        for p in range(min(BLOCK, met - part * BLOCK)):
            into, at = pixels[n >> 6], n & 63
            into[COLUMN + at], into[ROW + at] = block[COLUMN + p], block[ROW + p]
            n += counts[by_u[p]] | counts[by_v[p]]
    for p in range(n):
        block, at = pixels[p >> 6], p & 63
        block[_GREY + at] = batch.grey[np.uint32(block[ROW + at]), np.uint32(block[COLUMN + at])]
    fill_up(pixels, n)
    return n


@loops()
def place_all(batch: Any, k: Any, pixels: Any, n: Any) -> None:
    """Fill the places of the first n pixels."""
    for part in range((n + BLOCK - 1) // BLOCK):
        place(batch.lens, batch.theta[k], batch.normalisation[k], pixels[part])


@kernel(inner=True)
def _fill_spans(lens: Any, h: Any, normalisation: Any, box: Any, low: Any, high: Any, spans: Any) -> None:  # noqa: PLR0917
    """Fill from which column to which a tag with a margin can reach in each row of its box."""
    sides = np.empty((4, 3))
    away = _away(lens, normalisation, box) + 0.01
    for side in range(4):
        u, sign, limit = 3 * (side // 2), 1 - 2 * (side % 2), low if side % 2 == 0 else high
        a, b, c = sign * (h[u] - limit * h[6]), sign * (h[u + 1] - limit * h[7]), sign * (h[u + 2] - limit)
        # a column and a row from the tag's centre lie within where the sum of their multiples and this is positive
        sides[side, 0], sides[side, 1] = a, b
        sides[side, 2] = c / normalisation[2] + (abs(a) + abs(b)) * away
    for row in range(len(spans)):
        first, last = float(box[0]), float(box[1])
        for side in range(4):
            a, rest = sides[side, 0], sides[side, 1] * (box[2] + row - normalisation[1]) + sides[side, 2]
            if a > 0:
                first = max(first, normalisation[0] - rest / a)
            elif a < 0:
                last = min(last, normalisation[0] - rest / a + 1)
            elif not rest > 0:
                last = first
        spans[row, 0] = int(np.ceil(min(first, float(box[1]))))
        spans[row, 1] = int(np.floor(max(last, float(box[0]))))


@loops()
def _away(lens: Any, normalisation: Any, box: Any) -> float:
    """Return how far a tag's chart moves its box's corners at most, px."""
    bx, by, D = local_undistortion(lens, normalisation)
    most = 0.0
    for corner in range(4):
        dx, dy = box[corner % 2] - lens[CENTRE_X], box[2 + corner // 2] - lens[CENTRE_Y]
        sx, sy = square(lens, dx, dy)
        g, _, _ = depth(lens, (sx * sx + sy * sy) * lens[PER_RADIUS] ** 2)
        most = max(most, np.hypot(dx, dy) * abs(D / (g - bx * sx - by * sy) - 1))
    return most


@loops()
def _meet(box: Any, stride: Any, spans: Any, pixels: Any) -> Any:
    """Fill where the spans' pixels on the lattice are, then those beside it on diagonals; return how many."""
    every, every_near, n = stride[0], stride[2], 0
    for row in range(box[2], box[3]):
        first, last = spans[row - box[2]]
        for column in range(first + (box[0] + row * stride[1] - first) % every, last, every):
            block, at = pixels[n >> 6], n & 63
            block[COLUMN + at], block[ROW + at] = column, row
            n += 1
    on_lattice, further = n, every_near % every
    for row in range(box[2], box[3] if every > 1 else box[2]):
        first, last = spans[row - box[2]]
        first += (every_near - (first + row) % every_near) % every_near
        beside = (first - box[0] - row * stride[1]) % every
        for column in range(first, last, every_near):
            block, at = pixels[n >> 6], n & 63
            block[COLUMN + at], block[ROW + at] = column, row
            n += beside != 0
            beside += further
            beside -= every if beside >= every else 0
    return on_lattice, n


@loops(fastmath=_IN_PLACE)
def place(lens: Any, theta: Any, normalisation: Any, block: Any) -> None:
    """Fill x, y, u and v of a block of pixels, from the tag's centre so that single precision does."""
    h0, h1, h2, h3 = np.float32(theta[0]), np.float32(theta[1]), np.float32(theta[2]), np.float32(theta[3])
    h4, h5, h6, h7 = np.float32(theta[4]), np.float32(theta[5]), np.float32(theta[6]), np.float32(theta[7])
    tag_x, tag_y, scale = normalisation[0], normalisation[1], np.float32(normalisation[2])
    whole_x, whole_y = np.float32(np.floor(tag_x)), np.float32(np.floor(tag_y))
    rest_x, rest_y = np.float32(tag_x - np.floor(tag_x)), np.float32(tag_y - np.floor(tag_y))
    from_x, from_y = np.float32(tag_x - lens[CENTRE_X]), np.float32(tag_y - lens[CENTRE_Y])
    bx, by, D = local_undistortion(lens, normalisation)
    bx, by, D_1 = np.float32(bx), np.float32(by), np.float32(D - 1)
    a1, a2, a3 = np.float32(lens[A1]), np.float32(lens[A2]), np.float32(lens[A3])
    per_px2, skew = np.float32(lens[PER_RADIUS] * lens[PER_RADIUS]), np.float32(lens[SKEW])
    aspect = np.float32(np.exp(lens[LOG_ASPECT]))
    for p in range(BLOCK):
        ex, ey = (block[COLUMN + p] - whole_x) - rest_x, (block[ROW + p] - whole_y) - rest_y
        dx, dy = ex + from_x, ey + from_y
        sx, sy = dx - skew * dy, aspect * dy
        q = (sx * sx + sy * sy) * per_px2
        # the chart's factor less one, D / (g - b d) - 1
        more = D_1 + bx * sx + by * sy + q * (a1 + q * (a2 + q * a3))
        more /= _F1 + D_1 - more
        x, y = (ex + dx * more) * scale, (ey + dy * more) * scale
        w = _F1 / (h6 * x + h7 * y + _F1)
        block[p] = x
        block[_Y + p] = y
        block[_U + p] = (h0 * x + h1 * y + h2) * w
        block[_V + p] = (h3 * x + h4 * y + h5) * w


@kernel(inner=True)
def _counting(differences: Any, side: Any) -> Any:
    """Return whether pixels count: never, always, and near each edge along u and along v."""
    counts = np.empty(2 + 2 * side * side, np.bool_)
    counts[0], counts[1] = False, True
    for edge in range(side * side):
        counts[2 + edge] = differences[1, edge] != _F0
        counts[2 + side * side + edge] = differences[2, edge] != _F0
    return counts


@loops(fastmath=_IN_PLACE)
def _look(block: Any, side: Any, limits: Any, on_lattice: Any, by_u: Any, by_v: Any) -> None:  # noqa: PLR0917
    """Fill what decides whether pixels of a block count, see :func:`_counting`; on the tag the first few always do."""
    low, high, near_u, near_v = limits
    width, all_edges, first = np.int32(side), np.int32(side * side), np.int32(on_lattice)
    for p in range(BLOCK):
        u, v = block[_U + p], block[_V + p]
        inside = (u > low) & (u < high) & (v > low) & (v < high)
        edge_u, edge_v = np.floor(u + _F05), np.floor(v + _F05)
        # before the white ring and behind it no edge is one between black and white
        column, row = np.int32(np.floor(u) + _F1), np.int32(np.floor(v) + _F1)
        at_u = min(max(row * width + np.int32(edge_u), _I0), all_edges - _I1)
        at_v = min(max(np.int32(edge_v) * width + column, _I0), all_edges - _I1)
        lattice = _I1 if np.int32(p) < first else _I0
        near = _I2 + at_u if abs(u - edge_u) < near_u else lattice
        by_u[p] = (lattice if lattice > _I0 else near) if inside else _I0
        by_v[p] = _I2 + all_edges + at_v if inside & (abs(v - edge_v) < near_v) else _I0
