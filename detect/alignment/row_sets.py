"""Sets of tags by their rows: numpy's own functions for sets take several times as long for as few as an image has."""

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Index


def among(rows: Index, some: Index) -> NDArray[np.bool_]:
    """Return which rows (N,) are among some (M,)."""
    if len(some) == 0:
        return np.zeros(len(rows), dtype=np.bool_)
    return np.asarray((rows[:, None] == some).any(axis=1))


def distinct(values: Index) -> Index:
    """Return each of values (N,), none of them negative, once, ascending."""
    return np.flatnonzero(np.bincount(values))
