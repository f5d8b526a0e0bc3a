"""Tags of an image on paper that is not flat, found by the displacements of their blocks."""

from dataclasses import replace

import numpy as np

from boxcal.detect.alignment.box_pose import BoxFit
from boxcal.detect.alignment.deformation.edge_model import CONTRASTS
from boxcal.detect.alignment.deformation.kriging import Deformation, field_of_few, krige_corners, likely_gain
from boxcal.detect.alignment.deformation.neighbours import nearer_to_neighbours
from boxcal.detect.alignment.pyramid_search import FEW_TAGS
from boxcal.detect.alignment.registration.block_motion import BLOCKS
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_curvature import under_lens
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.target.arrays import Array
from boxcal.target.box import Target

HINT = 1.0
"""Gain of the log-likelihood, of some five tags, from which on all tags are looked at: a tenth of what is asked of all
is a hint, as pictures of a camera that displaces blocks in other ways, all of them, would be looked at twice."""
SUSPICIOUS = 1.5
"""Blocks that move by this factor (of variance) more than noise makes them: of all tags they are looked at then."""


def looks_deformed(patterns: Patterns, tags: TagAlignments, uneven: Index) -> bool:
    """Return whether the tags of which sums were asked for hint that paper or lens is not what it is taken for.

    Few tags, of which the sums of all are known, do where their blocks moved; of others a field must also explain that
    a little better than noise does.
    """
    if not blocks_moved(tags, uneven):
        return False
    if len(tags) <= FEW_TAGS:
        return True
    some = tags.take(~among(tags.rows, uneven) & np.isfinite(tags.block_sums).all(axis=(1, 2)))
    return likely_gain(patterns, some.rows, some.corners_px, some.block_sums, some.noise**2) > HINT


def blocks_moved(tags: TagAlignments, uneven: Index) -> bool:
    """Return whether blocks of tags, those of which sums were asked for, moved more than noise makes them.

    A lens that is not quite the right one moves them, too. Tags that may be unevenly lit (rows ``uneven``) are no
    evidence.
    """
    moved, noise = np.nansum(tags.sandwich_sums[~among(tags.rows, uneven), 2:], axis=0)
    # the fitted homography takes up eight of the eighteen freedoms of nine blocks
    return bool(moved > SUSPICIOUS * noise * CONTRASTS / (2 * BLOCKS**2))


def deformation(  # noqa: PLR0917
    target: Target, patterns: Patterns, tags: TagAlignments, uneven: Index, lens: Array, fit: BoxFit
) -> Deformation | None:
    """Return how the paper displaces the corners of aligned tags; None where it is flat, as far as noise lets see.

    It is believed only if corners of neighbouring tags, of which blocks know nothing, are displaced alike by it.

    Parameters
    ----------
    target
        The box.
    patterns, tags
        As :func:`boxcal.detect.alignment.registration.align.align` took and returned them under the right lens, with
        sums of all.
    uneven
        Rows of tags that may be unevenly lit: field and noise are not estimated from them.
    lens : (10,)
        Under which they were aligned.
    fit
        The box, with the lens that the tags tell.
    """
    if len(tags) <= FEW_TAGS or not blocks_moved(tags, uneven):
        return None
    even = ~among(tags.rows, uneven)
    sheets = target.tag_faces[tags.rows]
    found = krige_corners(patterns, tags.rows, sheets, tags.corners_px, tags.block_sums, tags.noise**2, even)
    if found is None:
        return None
    box = fit.places(target.tag_corners[tags.rows].reshape(-1, 3)).reshape(-1, 4, 2)
    flat = under_lens(lens, fit.lens, tags.corners_px) - box
    deformed = tags.corners_px + found.displacement_px - box
    if not nearer_to_neighbours(target, tags.rows[even], flat[even], deformed[even]):
        return None
    return found


def with_field_of_few(patterns: Patterns, tags: TagAlignments) -> TagAlignments:
    """Return tags, if too few to tell lens and paper, as uncertain as what displaces their blocks makes them."""
    if len(tags) > FEW_TAGS:
        return tags
    there = np.asarray(np.isfinite(tags.block_sums).all(axis=(1, 2)))
    some = tags.take(there)
    if len(some) == 0:
        return tags
    cov = tags.cov_px2.copy()
    cov[there] += field_of_few(patterns, some.rows, some.corners_px, some.block_sums, some.noise**2)
    return replace(tags, cov_px2=cov)
