"""Array operations as loops, which compile faster than slices and calls."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import loops


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
    """Return the median of a (n,), sorted in room (n,) by Shell's method."""
    n = len(a)
    put(room, a)
    gap = n // 2
    while gap > 0:
        for i in range(gap, n):
            value, j = room[i], i
            while j >= gap and room[j - gap] > value:
                room[j] = room[j - gap]
                j -= gap
            room[j] = value
        gap //= 2
    return 0.5 * (room[(n - 1) // 2] + room[n // 2])
