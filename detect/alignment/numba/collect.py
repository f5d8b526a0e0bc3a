"""The pixels of a tag, collected in blocks: once for several steps, as they stay nearly the same.

First every pixel of the tag's box is written down that the lattice or a diagonal meets; then blocks of them are placed
on the tag and looked at together, as vector instructions, and those that count are written down again. A pixel is
written down as one number, the row from the box's first on times 65536 plus the column from the box's first on.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.numba.arrays import aligned, put
from boxcal.detect.alignment.numba.kernel import kernel, loops
from boxcal.detect.alignment.numba.pixels import BLOCK, COLUMN, GREY, OF_PIXEL, ROW, U, V, widths
from boxcal.detect.alignment.numba.place import COEFFICIENTS, IN_PLACE, fill_coefficients, place
from boxcal.detect.alignment.numba.radial_camera import depth, local_undistortion, square
from boxcal.detect.alignment.radial_camera import CENTRE_X, CENTRE_Y, PER_RADIUS
from boxcal.detect.alignment.registration.gauss_newton import LEAST_THINNED, THINNED
from boxcal.detect.alignment.registration.tag_batch import LEVEL

_PER_LEVEL = np.float32(LEVEL)
_SHORT = 65535
"""What the column takes of a pixel's number."""
_RUN = 16
"""Pixels of a row that are written down together."""
_LEFT, _RIGHT, _ABOVE, _BELOW, _ALWAYS = (np.uint32(1 << k) for k in range(5))
"""Edges of a module at which black and white meet; pixels may count near to one, or always."""
_NEVER = np.uint32(0)
_F0, _F05, _F1 = np.float32(0), np.float32(0.5), np.float32(1)
_I0, _I1 = np.int32(0), np.int32(1)


class Room(NamedTuple):
    """Room to collect the pixels of a tag in, one after the other.

    Attributes
    ----------
    pixels : (B, OF_PIXEL * 64)
        Blocks, see :mod:`boxcal.detect.alignment.numba.pixels`.
    met, kept : (P,)
        Pixels as numbers.
    spans : (R, 2)
        First and last column of each row of a tag's box.
    edges : (S,)
        Edges of each module at which black and white meet.
    at, wanted : (64,)
        Of each pixel of a block a place in a table, and what must be there.
    coefficients : (24,)
        What places on a tag are made of, see :mod:`boxcal.detect.alignment.numba.place`.
    """

    pixels: NDArray[np.float32]
    met: NDArray[np.int32]
    kept: NDArray[np.int32]
    spans: NDArray[np.int64]
    edges: NDArray[np.uint32]
    at: NDArray[np.uint32]
    wanted: NDArray[np.uint32]
    coefficients: NDArray[np.float32]


@kernel(inner=True)
def room_for(boxes: Any, modules: Any) -> Room:
    """Return room for the pixels of any of some tags with bounding boxes (N, 4), of so many modules, ring included."""
    most, rows = 0, 0
    for k in range(len(boxes)):
        width, height = max(boxes[k, 1] - boxes[k, 0], 0), max(boxes[k, 3] - boxes[k, 2], 0)
        most, rows = max(most, width * height), max(rows, height)
    return Room(
        aligned((most // BLOCK + 1) * OF_PIXEL * BLOCK).reshape((most // BLOCK + 1, OF_PIXEL * BLOCK)),
        np.empty(2 * most + BLOCK, np.int32),  # those on the lattice may be met twice
        np.empty(most + BLOCK, np.int32),
        np.empty((rows, 2), np.int64),
        np.empty(modules * modules, np.uint32),
        np.empty(BLOCK, np.uint32),
        np.empty(BLOCK, np.uint32),
        np.empty(COEFFICIENTS, np.float32),
    )


@loops()
def collect(batch: Any, k: Any, thinned: Any, room: Any) -> Any:
    """Fill blocks with grey levels, columns and rows of the pixels of tag k that count, and what places are made of.

    Return how many, and how many of them come first that a thinned step takes: all unless it is to be thinned.
    """
    side, margin, box, stride = batch.cells.shape[1], batch.margin[k], batch.bounding_boxes[k], batch.stride[k]
    theta, normalisation = batch.theta[k], batch.normalisation[k]
    fill_coefficients(batch.lens, theta, normalisation, room.coefficients)
    _fill_spans(batch.lens, theta, normalisation, box, -margin, side - 2 + margin, room.spans)
    _fill_edges(batch.cells[batch.rows[k]], room.edges)
    on_lattice, met = _meet(box, stride, room.spans, room.met)
    wide_u, wide_v = widths(theta, normalisation)
    limits = (
        np.float32(-margin), np.float32(side - 2 + margin), np.float32(batch.near[k] * wide_u),
        np.float32(batch.near[k] * wide_v),
    )  # fmt: skip
    n, block, left, top = 0, room.pixels[0], np.float32(box[0]), np.float32(box[2])
    beside = _NEVER if on_lattice > 0 else _ALWAYS  # where all are met at once, those on the lattice count among them
    every, along, offset = np.float32(stride[0]), np.float32(stride[1]), np.float32(box[2] * stride[1] % stride[0])
    for first in range(0, met, BLOCK):
        numbers = room.met[first : first + BLOCK]
        _unpack(numbers, box, block)
        place(room.coefficients, block)
        lattice = (left, top, every, along, offset, np.int32(on_lattice - first), beside)
        _look(block, side, limits, lattice, room.at, room.wanted)
        for p in range(min(BLOCK, met - first)):
            room.kept[np.uint64(n)] = numbers[p]
            n += (room.edges[room.at[p]] & room.wanted[p]) != _NEVER
    few, kept = n, room.kept
    if thinned and n >= LEAST_THINNED:
        few, kept = _thinned_first(room.kept, n, box, room.met), room.met
    _fill_pixels(batch, kept, n, box, room.pixels)
    return n, few


@loops()
def _fill_spans(lens: Any, h: Any, normalisation: Any, box: Any, low: Any, high: Any, spans: Any) -> None:  # noqa: PLR0917
    """Fill from which column to which a tag with a margin can reach in each row of its box."""
    away = _away(lens, normalisation, box) + 0.01
    for row in range(box[3] - box[2]):
        spans[row, 0], spans[row, 1] = box[0], box[1]
    for side in range(4):
        u, sign, limit = 3 * (side // 2), 1 - 2 * (side % 2), low if side % 2 == 0 else high
        a, b, c = sign * (h[u] - limit * h[6]), sign * (h[u + 1] - limit * h[7]), sign * (h[u + 2] - limit)
        # a column and a row from the tag's centre lie within where the sum of their multiples and this is positive
        rest = c / normalisation[2] + (abs(a) + abs(b)) * away
        first, each = rest + b * (box[2] - normalisation[1]), b
        if a != 0:
            first, each = normalisation[0] - first / a, -b / a
        for row in range(box[3] - box[2]):
            at = min(max(first + each * row, box[0] - 1.0), box[1] + 1.0) if a != 0 else first + each * row
            if a > 0:
                spans[row, 0] = max(spans[row, 0], int(np.ceil(at)))
            elif a < 0:
                spans[row, 1] = min(spans[row, 1], int(np.floor(at)) + 1)
            elif not at > 0:
                spans[row, 1] = spans[row, 0]


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
def _fill_edges(cells: Any, edges: Any) -> None:
    """Fill at which edges of each module black and white meet: none before the white ring and behind it."""
    side = cells.shape[0]
    for j in range(side):
        for i in range(side):
            here, told = cells[j, i], _ALWAYS
            told |= _LEFT if i > 0 and cells[j, i - 1] != here else _NEVER
            told |= _RIGHT if i + 1 < side and cells[j, i + 1] != here else _NEVER
            told |= _ABOVE if j > 0 and cells[j - 1, i] != here else _NEVER
            told |= _BELOW if j + 1 < side and cells[j + 1, i] != here else _NEVER
            edges[j * side + i] = told


@loops()
def _meet(box: Any, stride: Any, spans: Any, met: Any) -> Any:
    """Write down the spans' pixels on the lattice, then those on diagonals; return how many on it, and in all.

    Where diagonals take all pixels, the lattice is left out.
    """
    every, every_near, n = stride[0], stride[2], 0
    for row in range(box[3] - box[2] if every == 1 or every_near > 1 else 0):
        first, last = spans[row, 0] - box[0], spans[row, 1] - box[0]
        first += _modulo((box[2] + row) * stride[1] - first, every)
        n = _write_run(row, first, last, every, met, n)
    on_lattice = n
    for row in range(box[3] - box[2] if every > 1 else 0):
        first, last = spans[row, 0] - box[0], spans[row, 1] - box[0]
        first += _modulo(-(box[0] + first + box[2] + row), every_near)
        n = _write_run(row, first, last, every_near, met, n)
    return on_lattice, n


@loops()
def _modulo(a: Any, b: Any) -> Any:
    """Return a modulo b, both of far fewer than 50 bits: dividing integers takes twice as long."""
    return a - b * int(np.floor((a + 0.5) / b))


@loops(forceinline=True)
def _write_run(row: Any, first: Any, last: Any, every: Any, met: Any, n: Any) -> Any:  # noqa: PLR0917
    """Write down each so-manyth pixel of a row from the first to before the last; return how many there are now.

    Whole runs are written, what is too much is written over by the next.
    """
    if last <= first:
        return n
    count, one = 1 + int((last - first - 0.5) / every), np.int32(every)
    for begin in range(0, count, _RUN):
        run, value = met[n + begin : n + begin + _RUN], np.int32((row << 16) + first + begin * every)
        for i in range(_RUN):
            run[i] = value + np.int32(i) * one
    return n + count


@loops(forceinline=True)
def _unpack(numbers: Any, box: Any, block: Any) -> None:
    """Fill the columns and rows of a block of pixels."""
    left, top = np.float32(box[0]), np.float32(box[2])
    for p in range(BLOCK):
        number = numbers[p]
        block[COLUMN + p] = left + np.float32(np.int32(number & _SHORT))
        block[ROW + p] = top + np.float32(np.int32(number >> 16))


@loops(fastmath=IN_PLACE, forceinline=True)
def _look(block: Any, side: Any, limits: Any, lattice: Any, at: Any, wanted: Any) -> None:  # noqa: PLR0917
    """Fill the modules of a block's pixels, and at which of their edges must be one for them to count.

    The first few of the block are on the lattice and count on the tag; of others on the lattice is said what must be.
    """
    low, high, near_u, near_v = limits
    left, top, every, along, offset, on_lattice, beside = lattice
    width, last, by_every = np.int32(side), np.int32(side * side - 1), _F1 / every
    for p in range(BLOCK):
        u, v = block[U + p], block[V + p]
        whole_u, whole_v = np.floor(u), np.floor(v)
        rest_u, rest_v = u - whole_u, v - whole_v
        at[p] = min(max(np.int32(np.int32(whole_v + _F1) * width + np.int32(whole_u + _F1)), _I0), last)
        by_u, by_v = _LEFT if rest_u < _F05 else _RIGHT, _ABOVE if rest_v < _F05 else _BELOW
        by_u = by_u if min(rest_u, _F1 - rest_u) < near_u else _NEVER
        by_v = by_v if min(rest_v, _F1 - rest_v) < near_v else _NEVER
        step = (block[COLUMN + p] - left) - along * (block[ROW + p] - top) - offset
        near = np.uint32(by_u | by_v) if step != every * np.floor((step + _F05) * by_every) else beside
        told = _ALWAYS if np.int32(p) < on_lattice else near
        inside = (u > low) & (u < high) & (v > low) & (v < high)
        wanted[p] = told if inside else _NEVER


@loops()
def _thinned_first(kept: Any, n: Any, box: Any, into: Any) -> int:
    """Put those of n pixels first of which column and twice the row together ``THINNED`` divides; return how many."""
    shift, few, others = box[0] + 2 * box[2], 0, 0
    for p in range(n):
        number = kept[p]
        into[np.uint64(few)], kept[np.uint64(others)] = number, number
        divided = ((number & _SHORT) + 2 * (number >> 16) + shift) % THINNED == 0
        few += divided
        others += not divided
    put(into[few:n], kept[:others])
    return few


@loops()
def _fill_pixels(batch: Any, kept: Any, n: Any, box: Any, pixels: Any) -> None:
    """Fill grey levels, columns and rows of n pixels, and what is left of the last block as the first pixel."""
    left, top, grey, grey8 = box[0], box[2], batch.grey, batch.grey8
    for p in range(n, (n + BLOCK - 1) // BLOCK * BLOCK):
        kept[p] = kept[0]
    for first in range(0, n, BLOCK):
        block, numbers = pixels[first // BLOCK], kept[first : first + BLOCK]
        _unpack(numbers, box, block)
        for p in range(BLOCK):
            row, column = np.uint64((numbers[p] >> 16) + top), np.uint64((numbers[p] & _SHORT) + left)
            if batch.eight_bits:
                block[GREY + p] = np.float32(grey8[row, column]) * _PER_LEVEL
            else:
                block[GREY + p] = grey[row, column]
