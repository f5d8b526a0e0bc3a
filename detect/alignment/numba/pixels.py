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
def _line(lens: Any, theta: Any, normalisation: Any, first: Any, row: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill x, y, u and v of the pixels of a row, from the first column on."""
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
    for i in range(out.shape[1]):
        dx = np.float64(first + i) - centre_x
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


@kernel(inner=True, fastmath=ORDER)
def collect(batch: Any, k: Any, into: Any) -> int:
    """Write x, y, u, v, grey level, column and row of the pixels of tag k that count; return how many."""
    grey, cells, box, margin = batch.grey, batch.cells[batch.rows[k]], batch.bounding_boxes[k], batch.margin[k]
    theta, normalisation, stride = batch.theta[k], batch.normalisation[k], batch.stride[k]
    wide_u, wide_v = widths(theta, normalisation)
    near_u, near_v = NEAR_SIGMAS * wide_u, NEAR_SIGMAS * wide_v
    modules = cells.shape[0] - 2
    every, shift, every_near = stride[0], stride[1], stride[2]
    line = np.empty((4, max(box[1] - box[0], 1)))
    n = 0
    for row in range(box[2], box[3]):
        _line(batch.lens, theta, normalisation, box[0], row, line)
        to_chosen = (row * shift) % every
        to_near = (every_near - (box[0] + row) % every_near) % every_near
        column = box[0]
        while column < box[1]:
            ahead = min(to_chosen, to_near)
            if ahead > 0:
                column += ahead
                to_chosen -= ahead
                to_near -= ahead
                continue
            chosen = to_chosen == 0
            at = column
            column += 1
            to_chosen = every - 1 if chosen else to_chosen - 1
            to_near = every_near - 1 if to_near == 0 else to_near - 1
            i = at - box[0]
            u, v = line[2, i], line[3, i]
            if not (u > -margin and u < modules + margin and v > -margin and v < modules + margin):
                continue
            if not chosen:
                # beside the lattice only pixels count that an edge between black and white crosses
                at_u, at_v = int(u + 1), int(v + 1)
                edge_u, edge_v = int(u + 1.5) - 1, int(v + 1.5) - 1
                crossed = (
                    abs(u - edge_u) < near_u
                    and edge_u >= 0
                    and edge_u <= modules
                    and cells[at_v, edge_u] != cells[at_v, edge_u + 1]
                ) or (
                    abs(v - edge_v) < near_v
                    and edge_v >= 0
                    and edge_v <= modules
                    and cells[edge_v, at_u] != cells[edge_v + 1, at_u]
                )
                if not crossed:
                    continue
            into[0, n], into[1, n], into[2, n], into[3, n], into[4, n] = line[0, i], line[1, i], u, v, grey[row, at]
            into[5, n], into[6, n] = at, row
            n += 1
    return n


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
