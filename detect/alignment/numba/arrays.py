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
