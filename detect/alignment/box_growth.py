"""From a few tags to all of them: predict where the box's other tags must be, align, accept what is really there."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.detect.alignment.box_pose import BoxFit, fit_box
from boxcal.detect.alignment.box_search import CANDIDATE_SIGMA_PX, BoxDetection, PredictedRegions, consistent
from boxcal.detect.alignment.placed_by_box import ON_FACE, as_placed, placed_surely, spread_over_faces
from boxcal.detect.alignment.predicted_tags import PredictedTags, predicted
from boxcal.detect.alignment.pyramid import SIDE_PX, Pyramid, align_coarsely
from boxcal.detect.alignment.radial_camera import LOG_ASPECT
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.row_sets import among, distinct
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import Limits, doubtful_limits, module_px, verified
from boxcal.detect.image.order_statistics import median
from boxcal.target.arrays import Array
from boxcal.target.box import Target

ALIGNED_SIGMA_PX = 0.05
ROUNDS = 4
TOLD_MODULES = 0.1
"""Median deviation of tags from the box, modules, up to which the box says which other tags ought to be seen."""
PREDICTED_SIDE_PX = 16.0
"""Of tags that the box predicts at least as many pixels are aligned as one with sides of this length has, twice as many
as of those that were read: modules seen at a slant are blurred into each other."""
SQUARE = 0.02
"""Largest log aspect of a pixel that counts as square; cameras with square pixels keep to a few thousandths."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Grown:
    """Tags that were aligned and lie on the box.

    Attributes
    ----------
    tags, fit
        These, and the box through them.
    placed
        Rows of tags that were not aligned, since the box determines their places.
    doubtful
        Predicted tags that may be there, but are not like their pattern everywhere.
    """

    tags: TagAlignments
    fit: BoxFit
    placed: Index
    doubtful: TagAlignments

    @property
    def rows(self) -> Index:
        """Rows of all tags but the doubtful ones."""
        return np.concatenate([self.tags.rows, self.placed])


def grow_from_pose(
    pyramid: Pyramid,
    target: Target,
    patterns: Patterns,
    search: PredictedRegions,
    limits: Limits,
    *,
    others: bool = True,
    on_face: int = ON_FACE,
) -> BoxDetection:
    """Return the tags of a search that are really there, aligned on few pixels, and the box through them.

    With ``others``, whatever the box then predicts beside them is tried too, until nothing new turns up. Some tags are
    where the box has them, as ``on_face`` tags of each face tell, see :mod:`boxcal.detect.alignment.placed_by_box`.
    """
    finder = _Finder(
        pyramid=pyramid.under(search.fit.lens), target=target, patterns=patterns, limits=limits, on_face=on_face
    )
    missing, size = None, pyramid.size
    found = finder.more(None, search.fit, search.rows, search.corners_px)
    for _ in range(ROUNDS):
        if len(found.tags) == 0:
            break
        missing = predicted(target, patterns, found.fit, found.rows, size)
        if not others or not missing.sure.any():
            break
        before = len(found.rows)
        found = finder.more(found, found.fit, missing.rows[missing.sure], missing.corners_px[missing.sure])
        if len(found.rows) <= before:
            break
    tags, fit = found.tags, found.fit
    if len(found.placed):
        tags = tags.joined(as_placed(target, fit, tags, found.placed))
    lost_px, region = _lost(target, patterns, tags, fit, missing, size)
    return BoxDetection(
        tags=tags.joined(found.doubtful.take(~among(found.doubtful.rows, tags.rows))),
        fit=fit,
        lost_module_px=lost_px,
        lost_region_px=region,
        contradicting_faces=search.contradicting_faces,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Finder:
    """Aligner of tags of a box at rough places."""

    pyramid: Pyramid
    target: Target
    patterns: Patterns
    limits: Limits
    on_face: int

    def more(self, before: _Grown | None, fit: BoxFit, rows: Index, corners_px: Array) -> _Grown:
        """Return what was found before and what is there of tags (N,) at places (N, 4, 2), px.

        Those of a fit that goes before, if any, are predicted, and believed only near there; others may be anywhere.
        """
        first, rest = spread_over_faces(self.target, rows, corners_px, self.on_face)
        now = self._with(before, fit, rows[first], corners_px[first], predicted=before is not None)
        sure = placed_surely(
            self.target, self.patterns, now.fit, believed=now.tags.rows, asked=rows[first], rows=rows[rest]
        )
        late, doubtful = rest[~sure], now.doubtful
        if len(late):
            now = self._with(now, now.fit, rows[late], corners_px[late], predicted=before is not None)
            doubtful = doubtful.joined(now.doubtful)
        return replace(now, placed=np.concatenate([now.placed, rows[rest[sure]]]), doubtful=doubtful)

    def _with(self, before: _Grown | None, fit: BoxFit, rows: Index, corners_px: Array, *, predicted: bool) -> _Grown:
        """Return what was found before with tags at places that are really there, and the box through all."""
        side_px, target, patterns = PREDICTED_SIDE_PX if predicted else SIDE_PX, self.target, self.patterns
        new = align_coarsely(self.pyramid, patterns, rows, corners_px, side_px=side_px)
        there, doubtful = verified(patterns, new, self.limits.relaxed()), np.zeros(len(rows), dtype=np.bool_)
        if predicted:
            moved = np.linalg.norm(new.corners_px - corners_px, axis=2).max(axis=1)
            near = moved <= module_px(patterns, corners_px) + 0.5
            doubtful = near & ~there & verified(patterns, new, doubtful_limits(self.limits))
            there &= near
        tags = new.take(there) if before is None else before.tags.joined(new.take(there))
        if there.any():
            fit, kept = fit_aligned(
                target, patterns, tags.rows, tags.corners_px, image_size=self.pyramid.size, start=fit
            )
            if len(kept) < len(tags):
                tags = tags.take(among(tags.rows, kept))
        known = np.zeros(0, dtype=np.int64) if before is None else before.placed
        return _Grown(tags=tags, fit=fit, placed=known, doubtful=new.take(doubtful))


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

    Infinite, and the whole image, where the fit does not determine it: a box that is turned wrongly hides faces that
    the camera sees. Pixels that are not square can stand for that, unless two faces say so.
    """
    whole = np.array([[0, 0], image_size]) - [[0, 0], [1, 1]]
    if missing is None or not median(fit.off_px) < TOLD_MODULES * median(module_px(patterns, tags.corners_px)):
        return np.inf, whole
    if abs(fit.lens[LOG_ASPECT]) >= SQUARE and len(distinct(target.tag_faces[tags.rows])) == 1:
        return np.inf, whole
    return float(missing.module_px.max(initial=0)), missing.region_px(image_size)
