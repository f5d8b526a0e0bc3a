"""Tags that need no rough alignment, since the box through some others predicts where they are.

A few aligned tags, far from each other on every face, fix the box more exactly than the rough alignment of one tag
finds that tag: to a few hundredths of a pixel on a rigid box. So the rest are taken to lie where the box has them, with
the light and the blur of the nearest tag that was aligned. Whether they are really there the fine alignment says.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_pose import BoxFit, CameraPrior
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import module_px
from boxcal.detect.image.order_statistics import median
from boxcal.target.arrays import Array
from boxcal.target.box import Target

ON_FACE, ON_FACE_OF_KNOWN = 8, 4
"""Number of tags of a face that are aligned first, and where the camera is known from other images."""
BELIEVED = 0.75
"""Fraction of them that must be there for the others of that face to be taken to be there, too; and of those of all
faces: through a few tags of one face goes a box that is not as described, too, with other faces elsewhere."""
SPREAD_MODULES, OFF_MODULES = 0.15, 0.1
"""How uncertain such a tag's place may be, and how far from the box the aligned ones may lie, in the middle: in modules
of each, as roughly aligned tags are the further off the larger they are."""


def first_on_face(camera: CameraPrior | None) -> int:
    """Return how many tags of a face to align first: fewer where the camera is known from other images."""
    return ON_FACE if camera is None else ON_FACE_OF_KNOWN


def spread_over_faces(target: Target, rows: Index, corners_px: Array, count: int = ON_FACE) -> tuple[Index, Index]:
    """Return which of some tags (N,) to align first, on each face a few far from each other, and which are the others.

    Parameters
    ----------
    target, rows
        Which tags.
    corners_px : (N, 4, 2), px
        Roughly.
    count
        Number of tags of a face that are aligned first.
    """
    faces, centre = target.tag_faces[rows], 0.25 * corners_px.sum(axis=1)
    first = np.ones(len(rows), dtype=np.bool_)
    for face in np.flatnonzero(np.bincount(faces) > count):
        at = np.flatnonzero(faces == face)
        first[at] = False
        x, y = centre[at].T
        apart = (x - x.sum() / len(x)) ** 2 + (y - y.sum() / len(y)) ** 2
        for _ in range(count):
            k = int(apart.argmax())
            first[at[k]] = True
            apart = np.minimum(apart, (x - x[k]) ** 2 + (y - y[k]) ** 2)
    return np.flatnonzero(first), np.flatnonzero(~first)


def placed_surely(
    target: Target, patterns: Patterns, fit: BoxFit, *, believed: Index, asked: Index, rows: Index
) -> NDArray[np.bool_]:
    """Return which tags (N,) the box predicts so well that they need no rough alignment.

    Parameters
    ----------
    target, patterns, fit
        The box through some tags that were aligned.
    believed, asked
        Rows of those tags, and of the ones that were aligned for those in question.
    rows
        The tags in question.
    """
    if len(rows) == 0 or len(believed) == 0:
        return np.zeros(len(rows), dtype=np.bool_)
    uv, spread = fit.predict(target.tag_corners[rows].reshape(-1, 3))
    module = module_px(patterns, uv.reshape(-1, 4, 2))
    off = fit.off_px / module_px(patterns, fit.places(target.tag_corners[believed].reshape(-1, 3)).reshape(-1, 4, 2))
    if not median(off) < OFF_MODULES:
        return np.zeros(len(rows), dtype=np.bool_)
    faces = target.tag_faces
    tried = np.bincount(faces[asked], minlength=int(faces.max()) + 1)
    there = np.bincount(faces[asked[among(asked, believed)]], minlength=len(tried))
    if there.sum() < BELIEVED * tried.sum():
        return np.zeros(len(rows), dtype=np.bool_)
    sound = (tried > 0) & (there >= BELIEVED * tried)
    return np.asarray(sound[faces[rows]] & (spread.reshape(-1, 4).max(axis=1) < SPREAD_MODULES * module))


def as_placed(target: Target, fit: BoxFit, aligned: TagAlignments, rows: Index) -> TagAlignments:
    """Return tags where the box has them, each with the light and the blur of the nearest aligned one of its face.

    The rest of an alignment's result is that tag's, too, and says nothing of these.
    """
    uv = fit.places(target.tag_corners[rows].reshape(-1, 3)).reshape(-1, 4, 2)
    apart = uv.mean(axis=1)[:, None] - aligned.corners_px.mean(axis=1)[None]
    distance2 = np.sum(apart * apart, axis=2)
    distance2[target.tag_faces[rows][:, None] != target.tag_faces[aligned.rows][None]] += 1e9
    return replace(aligned.take(distance2.argmin(axis=1)), rows=rows, corners_px=uv)
