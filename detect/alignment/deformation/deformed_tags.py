"""Tags of an image on paper that is not flat, found by the displacements of their blocks."""

import numpy as np

from boxcal.detect.alignment.deformation.edge_model import CONTRASTS
from boxcal.detect.alignment.deformation.kriging import Deformation, krige_corners
from boxcal.detect.alignment.registration.block_motion import BLOCKS
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_patterns import Index, Patterns

SUSPICIOUS = 1.5
"""Blocks that move by this factor (of variance) more than noise makes them: of all tags they are looked at then."""


def blocks_moved(tags: TagAlignments, uneven: Index) -> bool:
    """Return whether blocks of tags, those of which sums were asked for, moved more than noise makes them.

    A lens that is not quite the right one moves them, too. Tags that may be unevenly lit (rows ``uneven``) are no
    evidence.
    """
    moved, noise = np.nansum(tags.sandwich_sums[~among(tags.rows, uneven), 2:], axis=0)
    # the fitted homography takes up eight of the eighteen freedoms of nine blocks
    return bool(moved > SUSPICIOUS * noise * CONTRASTS / (2 * BLOCKS**2))


def deformation(patterns: Patterns, tags: TagAlignments, uneven: Index) -> Deformation | None:
    """Return how the paper displaces the corners of aligned tags; None where it is flat, as far as noise lets see.

    Parameters
    ----------
    patterns, tags
        As :func:`boxcal.detect.alignment.registration.align.align` took and returned them under the right lens, with
        sums of all.
    uneven
        Rows of tags that may be unevenly lit: field and noise are not estimated from them.
    """
    if not blocks_moved(tags, uneven):
        return None
    even = ~among(tags.rows, uneven)
    return krige_corners(patterns, tags.rows, tags.corners_px, tags.block_sums, tags.noise**2, even)
