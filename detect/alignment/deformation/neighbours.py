"""Corners of neighbouring tags that are close together: paper that is not flat displaces them alike.

Nothing of this is used to predict a deformation from blocks of each tag, so it tells whether there is one: aliasing,
resampling and filters displace blocks of tags, too, but not the corners that these blocks seem to ask for.
"""

from functools import lru_cache

import numpy as np

from boxcal.detect.alignment.tag_patterns import Index
from boxcal.target.arrays import Array
from boxcal.target.box import Target

CLOSE = 0.5
"""Sides of a tag, between corners that are displaced alike."""
NEAREST = 1.05
"""Of the distances between corners of two tags, those are used that exceed a face's least by no more than this."""


@lru_cache(maxsize=16)
def close_corners(target: Target) -> Index:
    """Return pairs (P, 2) of corners of neighbouring tags of a face, numbered ``4 row + corner``."""
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for face in np.unique(target.tag_faces):
        rows = np.flatnonzero(target.tag_faces == face)
        corners = target.tag_corners[rows].reshape(-1, 3)
        side = np.median(np.linalg.norm(corners[1::4] - corners[::4], axis=1))
        apart = np.linalg.norm(corners[:, None] - corners[None], axis=2)
        tag = np.repeat(rows, 4)
        apart[tag[:, None] >= tag] = np.inf
        near = apart <= min(NEAREST * apart.min(), CLOSE * side)
        pairs.append(np.stack([4 * tag[k] + k % 4 for k in np.nonzero(near)], axis=1))
    return np.concatenate(pairs)


def nearer_to_neighbours(target: Target, rows: Index, flat_px: Array, deformed_px: Array) -> bool:
    """Return whether corners of neighbouring tags are displaced more alike on deformed paper than on flat paper.

    Parameters
    ----------
    target, rows
        Which tags (N,).
    flat_px, deformed_px : (N, 4, 2), px
        Their corners' displacements from a box, if the paper is flat and if it is deformed; of tags that are to be
        left out, NaN.
    """
    at = np.full(4 * len(target.tag_ids), -1)
    at.reshape(-1, 4)[rows] = np.arange(4 * len(rows)).reshape(-1, 4)
    a, b = at[close_corners(target)].T
    seen = (a >= 0) & (b >= 0)
    flat, deformed = (d.reshape(-1, 2)[a[seen]] - d.reshape(-1, 2)[b[seen]] for d in (flat_px, deformed_px))
    return bool(np.nansum(deformed**2) < np.nansum(flat**2))
