"""Points moved, compiled: see :mod:`boxcal.calib.likelihood.moved_points`."""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.target.arrays import Array, Ids


def moved_points(R: Array, t: Array, number: Ids, p: Array) -> Array:
    """Return what :func:`boxcal.calib.likelihood.moved_points.moved_points` does."""
    out = np.empty((len(p), 3))
    move(np.ascontiguousarray(R), np.ascontiguousarray(t), number, np.ascontiguousarray(p), out)
    return out


@kernel()
def move(R: Any, t: Any, number: Any, p: Any, out: Any) -> None:
    """Fill out (L, 3) with the moved points."""
    for n in range(len(number)):
        k, x, y, z = number[n], p[n, 0], p[n, 1], p[n, 2]
        for i in range(3):
            out[n, i] = R[k, i, 0] * x + R[k, i, 1] * y + R[k, i, 2] * z + t[k, i]
