"""Patterns of a target's tags: their modules and the white margin around them."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array
from boxcal.target.box import Target
from boxcal.target.tags.families import modules_per_side, tag_modules

Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patterns:
    """The patterns of some tags of one family.

    Coordinates on a tag are in modules: (0, 0) is the outer top-left corner of the black border, u to the right,
    v down, so that the corners are (0, 0), (M, 0), (M, M), (0, M).

    Attributes
    ----------
    tag_ids : (T,)
        Ids within the family.
    cells : (T, M + 2, M + 2)
        1 for white and 0 for black modules, with the ring of white modules around the tag.
    gap_modules
        White between neighbouring tags.
    """

    tag_ids: Index
    cells: Array
    gap_modules: float

    @property
    def modules(self) -> int:
        """M, the modules along a tag's side, black border included."""
        return int(self.cells.shape[1]) - 2

    @property
    def corners(self) -> Array:
        """The corners (4, 2) in modules: top-left, top-right, bottom-right, bottom-left."""
        return np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float) * self.modules


def family_patterns(dictionary: str, tag_ids: Index, gap_modules: float = 2.0) -> Patterns:
    """Return the patterns of tags of a family (TargetError where the family or an id does not exist)."""
    side = modules_per_side(dictionary)
    cells = np.ones((len(tag_ids), side + 2, side + 2))
    for row, tag in enumerate(tag_ids):
        cells[row, 1:-1, 1:-1] = tag_modules(dictionary, int(tag))
    return Patterns(tag_ids=np.asarray(tag_ids, dtype=np.int64), cells=cells, gap_modules=gap_modules)


@lru_cache(maxsize=16)
def target_patterns(target: Target) -> Patterns:
    """Return the patterns of a target's tags, in the order of its table."""
    box = target.box
    module = box.tag_size / modules_per_side(box.dictionary)
    return family_patterns(box.dictionary, target.tag_ids, (box.pitch - box.tag_size) / module)
