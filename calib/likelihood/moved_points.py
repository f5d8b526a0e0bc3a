"""Points moved by one of several rigid motions each."""

import numpy as np

from boxcal.target.arrays import Array, Ids


def moved_points(R: Array, t: Array, number: Ids, p: Array) -> Array:
    """Return points ``R p + t``, (L, 3), m.

    Parameters
    ----------
    R, t : (K, 3, 3), (K, 3), m
        Motions.
    number : (L,)
        Which of them moves each point.
    p : (L, 3), m
        The points.
    """
    return np.asarray((R[number] @ p[:, :, None])[:, :, 0] + t[number])
