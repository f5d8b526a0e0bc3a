"""From a few tags to all of them: predict where the box's other tags must be, align, accept what is really there."""

import numpy as np

from boxcal.detect.alignment.box_pose import BoxFit, fit_box
from boxcal.detect.alignment.box_search import CANDIDATE_SIGMA_PX, BoxDetection, PredictedRegions, consistent
from boxcal.detect.alignment.predicted_tags import PredictedTags, predicted
from boxcal.detect.alignment.pyramid import Pyramid, align_coarsely
from boxcal.detect.alignment.radial_camera import LOG_ASPECT
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import Limits, doubtful_limits, module_px, verified
from boxcal.detect.image.order_statistics import median
from boxcal.target.arrays import Array
from boxcal.target.box import Target

ALIGNED_SIGMA_PX = 0.05
ROUNDS = 4
TOLD_MODULES = 0.1
"""Median deviation of tags from the box, modules, up to which the box says which other tags ought to be seen."""
PREDICTED_SIDE_PX = 48.0
"""Of tags that the box predicts no more pixels are aligned than one with sides of this length has: sixteen times as
many as of those that were read, since they are mostly seen at a slant. With a quarter of these a near box's second
face was lost."""
SQUARE = 0.02
"""Largest log aspect of a pixel that counts as square; cameras with square pixels keep to a few thousandths."""


def grow_from_pose(
    pyramid: Pyramid,
    target: Target,
    patterns: Patterns,
    search: PredictedRegions,
    limits: Limits,
    *,
    others: bool = True,
) -> BoxDetection:
    """Return the tags of a search that are really there, aligned on few pixels, and the box through them.

    With ``others``, whatever the box then predicts beside them is tried too, until nothing new turns up.
    """
    rough = limits.relaxed()
    fit, doubtful, missing = search.fit, None, None
    pyramid = pyramid.under(fit.lens)
    image_size = pyramid.size
    tags = align_coarsely(pyramid, patterns, search.rows, search.corners_px)
    tags = tags.take(verified(patterns, tags, rough))
    for _ in range(ROUNDS):
        if len(tags) == 0:
            break
        fit, rows = fit_aligned(target, patterns, tags.rows, tags.corners_px, image_size=image_size, start=fit)
        if len(rows) < len(tags):
            tags = tags.take(np.isin(tags.rows, rows))
        missing = predicted(target, patterns, fit, tags.rows, image_size)
        more, corners = missing.rows[missing.sure], missing.corners_px[missing.sure]
        if len(more) == 0 or not others:
            break
        new = align_coarsely(pyramid, patterns, more, corners, side_px=PREDICTED_SIDE_PX)
        moved = np.linalg.norm(new.corners_px - corners, axis=2).max(axis=1)
        near = moved <= module_px(patterns, corners) + 0.5
        believed = verified(patterns, new, rough)
        doubtful = new.take(near & ~believed & verified(patterns, new, doubtful_limits(limits)))
        new = new.take(near & believed)
        if len(new) == 0:
            break
        tags = tags.joined(new)
    lost_px, region = _lost(target, patterns, tags, fit, missing, image_size)
    return BoxDetection(
        tags=tags if doubtful is None else tags.joined(doubtful.take(~np.isin(doubtful.rows, tags.rows))),
        fit=fit,
        lost_module_px=lost_px,
        lost_region_px=region,
        contradicting_faces=search.contradicting_faces,
    )


def fit_aligned(
    target: Target, patterns: Patterns, rows: Index, corners_px: Array, *, image_size: tuple[int, int], start: BoxFit
) -> tuple[BoxFit, Index]:
    """Return the box through aligned tags, and the rows of those that lie on it.

    Rough corners of one tag at a slant can turn the box and its camera so far that, taken as exactly as aligned corners
    are, the tag then counts as off the box for good. Where tags are left out, all are first fitted as rough ones once
    more; that box is taken which leaves out fewer.
    """
    fit = fit_box(target, rows, corners_px, image_size=image_size, sigma_px=ALIGNED_SIGMA_PX, start=start)
    fit, kept, _ = consistent(
        target, patterns, rows, corners_px, image_size=image_size, sigma_px=ALIGNED_SIGMA_PX, fit=fit
    )
    if len(kept) == len(rows):
        return fit, kept
    again = fit_box(target, rows, corners_px, image_size=image_size, sigma_px=CANDIDATE_SIGMA_PX, start=start)
    again = fit_box(target, rows, corners_px, image_size=image_size, sigma_px=ALIGNED_SIGMA_PX, start=again)
    again, more, _ = consistent(
        target, patterns, rows, corners_px, image_size=image_size, sigma_px=ALIGNED_SIGMA_PX, fit=again
    )
    return (again, more) if len(more) > len(kept) else (fit, kept)


def _lost(  # noqa: PLR0917
    target: Target,
    patterns: Patterns,
    tags: TagAlignments,
    fit: BoxFit,
    missing: PredictedTags | None,
    image_size: tuple[int, int],
) -> tuple[float, Array]:
    """Return how wide modules are seen at most of tags that are missing, px, and where those may be seen, (2, 2) px.

    Infinite, and the whole image, where the fit does not tell: a box that is turned wrongly hides faces that the camera
    sees. Pixels that are not square can stand for that, unless two faces say so.
    """
    whole = np.array([[0, 0], image_size]) - [[0, 0], [1, 1]]
    if missing is None or not median(fit.off_px) < TOLD_MODULES * median(module_px(patterns, tags.corners_px)):
        return np.inf, whole
    if abs(fit.lens[LOG_ASPECT]) >= SQUARE and len(np.unique(target.tag_faces[tags.rows])) == 1:
        return np.inf, whole
    return float(missing.module_px.max(initial=0)), missing.region_px(image_size)
