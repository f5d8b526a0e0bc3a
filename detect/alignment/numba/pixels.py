"""The pixels of a tag, collected into one array: once for several steps, as they stay nearly the same."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.radial_camera import A1, A2, A3, CENTRE_X, CENTRE_Y, LOG_ASPECT, PER_RADIUS, SKEW
from boxcal.detect.alignment.registration.image_model import LEAST_CONTRAST, MIDDLE, NEAR_SIGMAS

BLOCK = 64
"""Pixels that are summed together."""
ORDER = {"reassoc", "contract", "arcp", "nsz"}
"""What compiled sums may change: their order, not what they make of infinite figures, which decide what counts."""
OF_PIXEL = 7
"""x, y, u, v, grey level, column and row of a collected pixel."""


@kernel(inner=True)
def room(box: Any) -> Any:
    """Return an array to collect the pixels of a box in."""
    return np.empty((OF_PIXEL, max(box[1] - box[0], 0) * max(box[3] - box[2], 0)), np.float32)


@kernel(inner=True, fastmath=ORDER)
def widths(theta: Any, normalisation: Any) -> Any:
    """Return the blur's deviations along u and v at the tag's centre, modules."""
    sigma = np.exp(theta[12]) * normalisation[2]
    u0, u1 = theta[0] - theta[2] * theta[6], theta[1] - theta[2] * theta[7]
    v0, v1 = theta[3] - theta[5] * theta[6], theta[4] - theta[5] * theta[7]
    return sigma * np.sqrt(u0 * u0 + u1 * u1), sigma * np.sqrt(v0 * v0 + v1 * v1)


@kernel(inner=True, fastmath=ORDER)
def _line(lens: Any, theta: Any, normalisation: Any, row: Any, columns: Any, n: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill x, y, u and v of the first n of some columns' pixels in a row."""
    h0, h1, h2, h3, h4, h5, h6, h7 = theta[0], theta[1], theta[2], theta[3], theta[4], theta[5], theta[6], theta[7]
    centre_x, centre_y, a1, a2, a3 = lens[CENTRE_X], lens[CENTRE_Y], lens[A1], lens[A2], lens[A3]
    per_px2, skew, aspect = lens[PER_RADIUS] * lens[PER_RADIUS], lens[SKEW], np.exp(lens[LOG_ASPECT])
    tag_x, tag_y, scale = normalisation[0], normalisation[1], normalisation[2]
    # the chart about the tag's centre
    dx, dy = tag_x - centre_x - skew * (tag_y - centre_y), aspect * (tag_y - centre_y)
    q = (dx * dx + dy * dy) * per_px2
    slope = -2 * per_px2 * (a1 + q * (2 * a2 + q * (3 * a3)))
    bx, by, D = slope * dx, slope * dy, 1 + q * (a1 + q * (3 * a2 + q * (5 * a3)))
    dy = row - centre_y
    square_y, skewed = aspect * dy, skew * dy
    rest = 1 - by * square_y
    for i in range(n):
        dx = columns[i] - centre_x
        square_x = dx - skewed
        q = (square_x * square_x + square_y * square_y) * per_px2
        f = D / (rest - bx * square_x - q * (a1 + q * (a2 + q * a3)))
        x = (centre_x + dx * f - tag_x) * scale
        y = (centre_y + dy * f - tag_y) * scale
        w = 1 / (h6 * x + h7 * y + 1)
        out[0, i] = x
        out[1, i] = y
        out[2, i] = (h0 * x + h1 * y + h2) * w
        out[3, i] = (h3 * x + h4 * y + h5) * w


@kernel(inner=True)
def _chosen(first: Any, last: Any, row: Any, stride: Any, columns: Any, on_lattice: Any) -> Any:  # noqa: PLR0917
    """Fill the columns of a row that diagonals or the lattice meet, the rest of the lattice last; return how many."""
    every, every_near = stride[0], stride[2]
    start = first + (every_near - (first + row) % every_near) % every_near
    n = max((last - start + every_near - 1) // every_near, 0)
    for i in range(n):
        columns[i] = start + i * every_near
        on_lattice[i] = False
    for column in range(first + (row * stride[1]) % every, last, every):
        i = (column - start) // every_near
        if column >= start and start + i * every_near == column:
            on_lattice[i] = True
        else:
            columns[n] = column
            on_lattice[n] = True
            n += 1
    return n


@kernel(inner=True, fastmath=ORDER)
def _counting(line: Any, n: Any, on_lattice: Any, limits: Any, counts: Any) -> None:
    """Fill whether pixels lie on the tag, on the lattice or near a line between modules; without a branch."""
    low, high, near_u, near_v = limits
    for i in range(n):
        u, v = line[2, i], line[3, i]
        inside = (u > low) & (u < high) & (v > low) & (v < high)
        near = (abs(u - np.floor(u + 0.5)) < near_u) | (abs(v - np.floor(v + 0.5)) < near_v)
        counts[i] = inside & (near | on_lattice[i])


@kernel(inner=True, fastmath=ORDER)
def _crossed(cells: Any, u: Any, v: Any, near_u: Any, near_v: Any) -> bool:
    """Return whether an edge between black and white blurs a place."""
    last = cells.shape[0] - 1
    at_u, at_v = int(u + 1), int(v + 1)
    edge_u, edge_v = int(u + 1.5) - 1, int(v + 1.5) - 1
    if abs(u - edge_u) < near_u and edge_u >= 0 and edge_u < last and cells[at_v, edge_u] != cells[at_v, edge_u + 1]:
        return True
    across = edge_v >= 0 and edge_v < last and abs(v - edge_v) < near_v
    return across and cells[edge_v, at_u] != cells[edge_v + 1, at_u]


@kernel(inner=True, fastmath=ORDER)
def collect(batch: Any, k: Any, into: Any) -> int:
    """Write x, y, u, v, grey level, column and row of the pixels of tag k that count; return how many."""
    grey, cells, box, margin = batch.grey, batch.cells[batch.rows[k]], batch.bounding_boxes[k], batch.margin[k]
    theta, normalisation = batch.theta[k], batch.normalisation[k]
    wide_u, wide_v = widths(theta, normalisation)
    near_u, near_v = NEAR_SIGMAS * wide_u, NEAR_SIGMAS * wide_v
    limits = (-margin, cells.shape[0] - 2 + margin, near_u, near_v)
    width = max(box[1] - box[0], 1)
    columns, line = np.empty(width), np.empty((4, width))
    on_lattice, counts = np.empty(width, np.bool_), np.empty(width, np.bool_)
    n = 0
    for row in range(box[2], box[3]):
        some = _chosen(box[0], box[1], row, batch.stride[k], columns, on_lattice)
        _line(batch.lens, theta, normalisation, row, columns, some, line)
        _counting(line, some, on_lattice, limits, counts)
        for i in range(some):
            if not counts[i]:
                continue
            u, v = line[2, i], line[3, i]
            # beside the lattice only pixels count that an edge crosses
            if not on_lattice[i] and not _crossed(cells, u, v, near_u, near_v):
                continue
            at = int(columns[i])
            into[0, n], into[1, n], into[2, n], into[3, n], into[4, n] = line[0, i], line[1, i], u, v, grey[row, at]
            into[5, n], into[6, n] = at, row
            n += 1
    return n


@kernel(inner=True)
def thin(pixels: Any, n: Any, every: Any) -> Any:
    """Return those of n collected pixels whose column and twice the row together ``every`` divides, and how many."""
    into, m = np.empty((OF_PIXEL, n), np.float32), 0
    for p in range(n):
        if (int(pixels[5, p]) + 2 * int(pixels[6, p])) % every == 0:
            for row in range(OF_PIXEL):
                into[row, m] = pixels[row, p]
            m += 1
    return into, m


@kernel(inner=True, fastmath=ORDER)
def replace_pixels(theta: Any, pixels: Any, n: Any) -> None:
    """Fill u and v of collected pixels anew."""
    h0, h1, h2, h3, h4, h5, h6, h7 = theta[0], theta[1], theta[2], theta[3], theta[4], theta[5], theta[6], theta[7]
    for p in range(n):
        x, y = np.float64(pixels[0, p]), np.float64(pixels[1, p])
        w = 1 / (h6 * x + h7 * y + 1)
        pixels[2, p] = (h0 * x + h1 * y + h2) * w
        pixels[3, p] = (h3 * x + h4 * y + h5) * w


@kernel(inner=True)
def initial_intensity(batch: Any, k: Any, pixels: Any, n: Any) -> None:
    """Set offset and gain of a tag from its collected pixels.

    The reference is :func:`boxcal.detect.alignment.registration.image_model.initial_intensity`.
    """
    response, cells, theta = batch.response, batch.cells[batch.rows[k]], batch.theta[k]
    total, count = np.zeros(2), np.zeros(2)
    for p in range(n):
        u, v = pixels[2, p] + np.float32(1), pixels[3, p] + np.float32(1)
        i, j = int(u), int(v)
        if abs(u - i - 0.5) < MIDDLE and abs(v - j - 0.5) < MIDDLE:
            kind = 1 if cells[j, i] > 0.5 else 0
            total[kind] += pixels[4, p]
            count[kind] += 1
    if count[0] > 0 and count[1] > 0:
        black, white = _light_of(response, total[0] / count[0]), _light_of(response, total[1] / count[1])
        theta[8], theta[9] = black, max(white - black, LEAST_CONTRAST)


@kernel(inner=True)
def _light_of(response: Any, grey: Any) -> Any:
    """Return the light that a response curve makes a grey level of."""
    last = len(response) - 1
    if grey <= response[0]:
        return 0.0
    if grey >= response[last]:
        return 1.0
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if response[middle] <= grey:
            low = middle
        else:
            high = middle
    return (low + (grey - response[low]) / (response[high] - response[low])) / last


@kernel(inner=True, fastmath=ORDER)
def add_blocks(pixels: Any, n: Any, jac: Any, blocks: Any) -> None:
    """Add the residuals of collected pixels to the sums over modules."""
    side = blocks.shape[0]
    for p in range(n):
        i = min(max(int(pixels[2, p] + 1), 0), side - 1)
        j = min(max(int(pixels[3, p] + 1), 0), side - 1)
        blocks[j, i, 0] += jac[p // BLOCK, 14, p % BLOCK]
        blocks[j, i, 1] += 1
