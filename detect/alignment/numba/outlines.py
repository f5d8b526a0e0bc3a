"""Outlines of dark places that have four sides, followed pixel by pixel.

The reference is :func:`boxcal.detect.alignment.outlines.four_sided`, which calls OpenCV. This follows borders and
simplifies outlines as OpenCV does, so that the same quadrilaterals come out, but makes no array for each border: nine
in ten are too short or too thin for a tag.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.outlines import LEAST_DEVIATION_PX, LEAST_FULL, MOST_DEVIATION
from boxcal.target.arrays import Array

_WORD = 8
_SEEN, _SEEN_RIGHT = 2, -2
"""Marks of a border's pixels: followed, and followed with what lies right of them found to be bright."""
_BRIGHT, _DARK = np.uint64(0), np.uint64(0x0101010101010101)
"""Eight pixels that are bright, or dark and not marked."""
_X = np.array([1, 1, 0, -1, -1, -1, 0, 1] * 2)
_Y = np.array([0, -1, -1, -1, 0, 1, 1, 1] * 2)
"""The eight neighbours, counterclockwise as seen, from the right one on; twice."""
_FARTHEST = 3
"""So often the pixel farthest from the last one is taken, to begin where the outline has a corner."""


def four_sided(binary: NDArray[np.uint8], least: int, most: int) -> Array:
    """Return what :func:`boxcal.detect.alignment.outlines.four_sided` does."""
    height, width = binary.shape
    marks = np.zeros((height + 2, (width // _WORD + 2) * _WORD), dtype=np.int8)
    marks[1:-1, _WORD : _WORD + width] = binary
    room = np.empty((3, most + 1, 2), dtype=np.int32)
    # each dark place has one outline, which runs through each of its pixels four times at most
    quads = np.empty((binary.size // max(least // 4, 4) + 1, 4, 2), dtype=np.int32)
    ways = _Y * marks.shape[1] + _X
    found = _four_sided(marks.ravel(), marks.view(np.uint64), ways, least, most, room, quads)
    return np.asarray(quads[:found][::-1] - np.array([_WORD, 1.0]))


@kernel()
def _four_sided(  # noqa: PLR0917
    marks: Any, words: Any, ways: Any, least: Any, most: Any, room: Any, quads: Any
) -> Any:
    """Fill quads (N, 4, 2) with the corners of outlines in an image with a bright rim; return how many there are."""
    rows, stride, found = len(words), words.shape[1] * _WORD, 0
    points, polygon, parts = room[0], room[1], room[2]
    for y in range(1, rows - 1):
        before = np.int8(0)
        for k in range(1, words.shape[1]):
            word = words[y, k]
            if word == _BRIGHT and before <= 0:
                before = np.int8(0)
                continue
            if word == _DARK and before != 0:
                before = np.int8(1)
                continue
            for x in range(k * _WORD, (k + 1) * _WORD):
                here = marks[y * stride + x]
                outer = before == 0 and here == 1
                if outer or (here == 0 and before >= 1):
                    length, area = _follow(marks, ways, stride, x if outer else x - 1, y, 4 if outer else 0, points)
                    if least <= length <= most and area >= LEAST_FULL * length * length:
                        deviation = max(MOST_DEVIATION * length, LEAST_DEVIATION_PX)
                        corners = _simplified(points, length, deviation * deviation, polygon, parts)
                        if corners == 4 and _turns_one_way(polygon):
                            for c in range(4):
                                quads[found, c, 0], quads[found, c, 1] = polygon[3 - c, 0], polygon[3 - c, 1]
                            found += 1
                    here = marks[y * stride + x]
                before = here
    return found


@kernel(inner=True)
def _follow(marks: Any, ways: Any, stride: Any, x: Any, y: Any, start: Any, points: Any) -> Any:  # noqa: PLR0917
    """Follow a border from a pixel whose neighbour ``start`` is bright (Suzuki and Abe 1985), marking its pixels.

    Return how many pixels it has and what it encloses, px^2, positive where it runs around dark ones; fill the pixels
    (P, 2), as far as the array has space.
    """
    first, s = y * stride + x, start
    while True:
        s = (s - 1) & 7
        second = first + ways[s]
        if marks[second] != 0 or s == start:
            break
    if marks[second] == 0:
        marks[first] = _SEEN_RIGHT
        points[0, 0], points[0, 1] = x, y
        return 1, 0.0
    here, length, twice = first, 0, 0
    while True:
        end = s
        while True:
            s += 1
            after = here + ways[s]
            if marks[after] != 0:
                break
        s &= 7
        if 0 <= s - 1 < end:
            marks[here] = _SEEN_RIGHT
        elif marks[here] == 1:
            marks[here] = _SEEN
        if length < len(points):
            points[length, 0], points[length, 1] = x, y
        length += 1
        twice += y * _X[s] - x * _Y[s]
        x, y = x + _X[s], y + _Y[s]
        if after == first and here == second:
            return length, 0.5 * twice
        here, s = after, (s + 4) & 7


@kernel(inner=True)
def _simplified(points: Any, count: Any, deviation2: Any, polygon: Any, parts: Any) -> Any:
    """Fill the polygon (N, 2) that stays within a deviation of an outline (Douglas and Peucker 1973); return N."""
    position, farthest, reach2 = 0, 0, 0
    for _ in range(_FARTHEST):
        position = (position + farthest) % count
        x, y = points[position, 0], points[position, 1]
        reach2 = 0
        for j in range(1, count):
            at = position + j if position + j < count else position + j - count
            distance2 = (points[at, 0] - x) ** 2 + (points[at, 1] - y) ** 2
            if distance2 > reach2:
                reach2, farthest = distance2, j
    if reach2 <= deviation2:
        return 1
    other, kept, open_parts = (position + farthest) % count, 0, 2
    parts[0, 0], parts[0, 1], parts[1, 0], parts[1, 1] = other, position, position, other
    while open_parts > 0:
        open_parts -= 1
        start, end = parts[open_parts, 0], parts[open_parts, 1]
        x, y = points[start, 0], points[start, 1]
        dx, dy, most, between = points[end, 0] - x, points[end, 1] - y, 0, start
        at = start + 1 if start + 1 < count else 0
        while at != end:
            off = abs((points[at, 1] - y) * dx - (points[at, 0] - x) * dy)
            if off > most:
                most, between = off, at
            at = at + 1 if at + 1 < count else 0
        if float(most) * most <= deviation2 * (dx * dx + dy * dy):
            polygon[kept, 0], polygon[kept, 1] = x, y
            kept += 1
        else:
            parts[open_parts, 0], parts[open_parts, 1] = between, end
            parts[open_parts + 1, 0], parts[open_parts + 1, 1] = start, between
            open_parts += 2
    return _without_flat(polygon, kept, 0.5 * deviation2)


@kernel(inner=True)
def _without_flat(polygon: Any, count: Any, deviation2: Any) -> Any:
    """Take corners (N, 2) out that lie almost on the line between their neighbours; return how many are left."""
    left, write, i = count, 0, 0
    x, y = polygon[count - 1, 0], polygon[count - 1, 1]
    at_x, at_y = polygon[0, 0], polygon[0, 1]
    read = 1 if count > 1 else 0
    while i < count and left > 2:
        end_x, end_y = polygon[read, 0], polygon[read, 1]
        read = read + 1 if read + 1 < count else 0
        dx, dy = end_x - x, end_y - y
        off = abs((at_x - x) * dy - (at_y - y) * dx)
        onward = (at_x - x) * (end_x - at_x) + (at_y - y) * (end_y - at_y)
        if float(off) * off <= deviation2 * (dx * dx + dy * dy) and dx != 0 and dy != 0 and onward >= 0:
            left -= 1
            x, y = end_x, end_y
            at_x, at_y = polygon[read, 0], polygon[read, 1]
            read = read + 1 if read + 1 < count else 0
            i += 1
        else:
            x, y = at_x, at_y
            at_x, at_y = end_x, end_y
        polygon[write, 0], polygon[write, 1] = x, y
        write = write + 1 if write + 1 < count else 0
        i += 1
    return left


@kernel(inner=True)
def _turns_one_way(polygon: Any) -> Any:
    """Return whether a quadrilateral (4, 2) is convex, without three corners in line."""
    left, right = 0, 0
    for c in range(4):
        b, d = (c + 1) % 4, (c + 2) % 4
        ax, ay = polygon[b, 0] - polygon[c, 0], polygon[b, 1] - polygon[c, 1]
        bx, by = polygon[d, 0] - polygon[b, 0], polygon[d, 1] - polygon[b, 1]
        left += bx * ay < ax * by
        right += bx * ay > ax * by
    return left == 4 or right == 4
