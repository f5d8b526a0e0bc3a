"""Array operations as loops, which compile faster than slices and calls."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel, loops

_LINE = 64
"""Bytes of a cache line, and of the longest vectors: a vector that lies across two lines is read and written twice."""


@kernel(inner=True)
def aligned(n: Any) -> Any:
    """Return an array (n,) in single precision that begins where a cache line does."""
    room = np.empty(n + _LINE // 4, np.float32)
    start = (_LINE - room.ctypes.data % _LINE) % _LINE // 4
    return room[start : start + n]


@loops()
def clear(a: Any) -> None:
    """Set all entries of an array (n,) to zero."""
    for k in range(len(a)):
        a[k] = 0.0


@loops()
def clear_rows(a: Any) -> None:
    """Set all entries of an array (n, m) to zero."""
    for k in range(len(a)):
        clear(a[k])


@loops()
def put(a: Any, b: Any) -> None:
    """Copy b into a, (n,) each."""
    for k in range(len(a)):
        a[k] = b[k]


@loops()
def put_rows(a: Any, b: Any) -> None:
    """Copy b into a, (n, m) each."""
    for k in range(len(a)):
        put(a[k], b[k])


@loops()
def finite(a: Any) -> bool:
    """Return whether all entries of an array (n,) are finite."""
    good = True
    for k in range(len(a)):
        good = good and np.isfinite(a[k])
    return good


@loops()
def median(a: Any, room: Any) -> Any:
    """Return the median of a (n,), which is put into room (n,) and parted there by Hoare's method."""
    n = len(a)
    put(room, a)
    middle, low, high = n // 2, 0, n - 1
    while low < high:
        pivot, i, j = room[(low + high) // 2], low, high
        while i <= j:
            while room[i] < pivot:
                i += 1
            while room[j] > pivot:
                j -= 1
            if i <= j:
                room[i], room[j] = room[j], room[i]
                i, j = i + 1, j - 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    upper = room[middle]
    if n % 2 == 1:
        return upper
    lower = room[0]
    for k in range(1, middle):
        lower = max(lower, room[k])
    return 0.5 * (lower + upper)
