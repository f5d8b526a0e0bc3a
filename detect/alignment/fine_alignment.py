"""Fine alignment of the tags of a box, on the pixels of the image itself: which of them are there, and where."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.detect.alignment.box_pose import BoxFit
from boxcal.detect.alignment.box_search import RIGID_TOLERANCE_MODULES, RIGID_TOLERANCE_PX
from boxcal.detect.alignment.covariance import asked
from boxcal.detect.alignment.radial_camera import P1, P2
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST, KURTOSIS
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_curvature import under_lens
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.uneven_light import align_unevenly_lit, box_distance2, crossed
from boxcal.detect.alignment.verification import Limits, module_px, verified
from boxcal.detect.image.response_curve import ResponseEstimate, response_table, with_response
from boxcal.target.box import Target

STOP_PX = 0.05
"""Tags that a step moves less are left: the error shrinks with its square, to a tenth of a corner's sigma."""
FINE_SIDE_PX = 26.0
"""Tags twice as large are aligned on every second pixel both ways, and so on, beside those that are near to edges."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Believed:
    """Tags that are really there.

    Attributes
    ----------
    tags
        All of them.
    uneven
        Rows of tags that may be unevenly lit.
    own_light
        Rows of those that are: they were aligned with levels of their own for each module.
    """

    tags: TagAlignments
    uneven: Index
    own_light: Index


def align_finely(
    frame: Frame, patterns: Patterns, tags: TagAlignments, taken: ResponseEstimate
) -> tuple[Frame, TagAlignments]:
    """Return an image under the right response curve, and tags, aligned coarsely before, aligned on its pixels."""
    under = replace(frame, response=response_table(taken.imaging.response))
    changed = under.response is not frame.response
    start = with_response(tags, frame.response, under.response)
    if changed and taken.darkness is not None:
        white = start.theta[:, BLACK] + start.theta[:, CONTRAST]
        start.theta[:, BLACK], start.theta[:, CONTRAST] = taken.darkness * white, (1 - taken.darkness) * white
    start.theta[:, KURTOSIS] = taken.imaging.kurtosis
    aligned = align(
        under,
        patterns,
        tags.rows,
        tags.corners_px,
        start=start,
        intensity_unknown=changed,
        side_px=FINE_SIDE_PX,
        stop_px=STOP_PX,
        thinned=True,
        asked=asked(tags.corners_px),
    )
    return under, aligned


def believed(  # noqa: PLR0917
    frame: Frame, target: Target, patterns: Patterns, tags: TagAlignments, fit: BoxFit, limits: Limits
) -> Believed:
    """Return those of finely aligned tags that are really there, the unevenly lit ones aligned anew."""
    good, again = verified(patterns, tags, limits), crossed(tags, patterns, limits)
    if not again.any():
        return Believed(tags=tags.take(good), uneven=tags.rows[again], own_light=tags.rows[again])
    own, sound = align_unevenly_lit(
        frame, patterns, tags.take(again), side_px=FINE_SIDE_PX, stop_px=STOP_PX, limits=limits
    )
    # of a tag that can be believed either way that stays which lies nearer to where the box has it
    nearer = box_distance2(target, own, fit) < box_distance2(target, tags.take(again), fit)
    replaced = own.take(sound & (nearer | ~good[again]))
    kept = tags.take(good & ~among(tags.rows, replaced.rows))
    return Believed(tags=kept.joined(replaced), uneven=tags.rows[again], own_light=replaced.rows)


def aligned_again(  # noqa: PLR0917
    frame: Frame,
    better: Frame,
    target: Target,
    patterns: Patterns,
    tags: TagAlignments,
    own_light: Index,
    fit: BoxFit,
    *,
    every: bool = False,
) -> tuple[TagAlignments, TagAlignments]:
    """Return tags of a frame aligned under a better PSF or lens, those that lie on the box, with sums of some or all.

    Tags with levels of their own (rows ``own_light``) are returned apart: they keep their alignment, under the better
    lens.
    """
    apart = among(tags.rows, own_light)
    some = tags.take(~apart)
    again = align(
        better,
        patterns,
        some.rows,
        some.corners_px,
        start=some,
        side_px=FINE_SIDE_PX,
        stop_px=STOP_PX,
        asked=np.ones(len(some), dtype=np.bool_) if every else asked(some.corners_px),
    )
    return on_the_box(target, patterns, again, fit), _carried(frame, better, tags.take(apart))


def _carried(frame: Frame, better: Frame, tags: TagAlignments) -> TagAlignments:
    """Return tags aligned in a frame as they would be under the lens of a better one, without sums of residuals.

    Tangential terms, which alignment does not know, are left to those who carry all tags to the lens of the box.
    """
    lens = better.lens.copy()
    lens[[P1, P2]] = 0.0
    return replace(
        tags,
        corners_px=under_lens(frame.lens, lens, tags.corners_px),
        sandwich_sums=np.full_like(tags.sandwich_sums, np.nan),
        block_sums=np.full_like(tags.block_sums, np.nan),
    )


def on_the_box(target: Target, patterns: Patterns, tags: TagAlignments, fit: BoxFit) -> TagAlignments:
    """Return the tags that lie on the rigid box."""
    uv = fit.places(target.tag_corners[tags.rows].reshape(-1, 3))
    apart = uv.reshape(-1, 4, 2) - tags.corners_px
    off = np.hypot(apart[..., 0], apart[..., 1]).max(axis=1)
    return tags.take(off <= RIGID_TOLERANCE_MODULES * module_px(patterns, tags.corners_px) + RIGID_TOLERANCE_PX)
