"""Information of one robot on the shape of the box, all that is its own eliminated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.information_inverse import invert
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Block:
    """A quadratic in the m unknowns of the shape: minus twice a robot's log likelihood, its own unknowns at their best.

    Attributes
    ----------
    about : (m,)
        The shape at which it was made.
    information : (m, m)
        Half of its second derivative.
    score : (m,)
        Minus half of its gradient there.
    left : float
        How much the sum of squares would still fall if the robot's own unknowns moved.
    """

    about: Array
    information: Array
    score: Array
    left: float = 0.0

    def projected(self, free: Array) -> "Block":
        """Return the block of what a projection (m, m) leaves of the shape's moves: of the others it says nothing."""
        information = free.T @ self.information @ free
        return replace(self, information=(information + information.T) / 2, score=free.T @ self.score)

    def score_at(self, shape: Array) -> Array:
        """Return the score at another shape, (m,)."""
        return np.asarray(self.score - self.information @ (shape - self.about))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Total:
    """Information (m, m) and score (m,) of several robots at one shape."""

    information: Array
    score: Array

    def plus(self, other: "Total") -> "Total":
        """Return the sum."""
        return Total(information=self.information + other.information, score=self.score + other.score)

    def less(self, other: "Total") -> "Total":
        """Return the difference."""
        return Total(information=self.information - other.information, score=self.score - other.score)


def at(block: Block, shape: Array) -> Total:
    """Return information and score of a block at a shape, (m,)."""
    return Total(information=block.information, score=block.score_at(shape))


def tree_sum(parts: Sequence[Total]) -> Total:
    """Return the sum by pairs of pairs: rounding grows with the logarithm of the count, and the order is settled."""
    while len(parts) > 1:
        pairs = [a.plus(b) for a, b in zip(parts[::2], parts[1::2], strict=False)]
        parts = [*pairs, parts[-1]] if len(parts) % 2 else pairs
    return parts[0]


def without(information: Array, score: Array, kept: Sequence[int] | Ids) -> tuple[Array, Array]:
    """Return information and score of some unknowns, the others eliminated (Schur complement)."""
    kept = np.asarray(kept, dtype=np.int64)
    rest = np.setdiff1d(np.arange(len(score)), kept)
    across = information[np.ix_(rest, kept)]
    solved = inverse(information[np.ix_(rest, rest)]) @ np.concatenate([across, score[rest, None]], axis=1)
    reduced = information[np.ix_(kept, kept)] - across.T @ solved[:, :-1]
    return (reduced + reduced.T) / 2, np.asarray(score[kept] - across.T @ solved[:, -1])


def inverse(information: Array) -> Array:
    """Return the inverse of an information matrix; directions that are not determined are left out."""
    return invert(information)[0]
