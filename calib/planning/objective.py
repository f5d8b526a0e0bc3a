"""Criteria by which stops are chosen: the worst quantity, their mean square (A) or their product (D)."""

from enum import StrEnum

import numpy as np

from boxcal.target.arrays import Array

_POWER = 6.0


class Criterion(StrEnum):
    """Criterion on the quantities over their goals.

    WORST is close to the largest of them (norm of power 6, so that the others still count a little), MEAN their root
    mean square (A-optimal for what the user cares about), PRODUCT their geometric mean (D-optimal where the quantities
    do not hang together).
    """

    WORST = "worst"
    MEAN = "A"
    PRODUCT = "D"


def score(ratio: Array, criterion: Criterion) -> Array:
    """Return one number for quantities over their goals (..., K): smaller is better."""
    if criterion is Criterion.PRODUCT:
        return np.asarray(np.exp(np.mean(np.log(ratio), axis=-1)))
    power = _POWER if criterion is Criterion.WORST else 2.0
    largest = ratio.max(axis=-1, keepdims=True)
    return np.asarray(largest[..., 0] * np.mean((ratio / largest) ** power, axis=-1) ** (1 / power))
