"""Tags looked for where they are expected: from wheels and a calibration, or from the image before.

An alignment catches a tag from about a module away, so that no candidates need to be found where that much is known.
Expectations only say where alignments start: what is found must resemble its pattern and lie on one rigid box as ever,
and no corner is drawn to where it was expected.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_growth import grow_from_pose
from boxcal.detect.alignment.box_pose import CameraPrior, fit_box
from boxcal.detect.alignment.box_search import CANDIDATE_SIGMA_PX, BoxDetection, PredictedRegions
from boxcal.detect.alignment.placed_by_box import first_on_face
from boxcal.detect.alignment.predicted_tags import MIN_MODULE_PX
from boxcal.detect.alignment.pyramid import Pyramid, align_coarsely
from boxcal.detect.alignment.pyramid_search import FEW_TAGS
from boxcal.detect.alignment.resemblance import resemblance
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import Limits, convex, module_px, verified
from boxcal.target.arrays import Array
from boxcal.target.box import Target

ASKED = 4
"""Expected tags that are aligned first."""
LEAST_FOUND, MOST_FOUND = 0.5, 0.8
"""Fraction of the tags, of those and of all, that must be there, or else the whole image is searched; where fewer
than the second are, the box through them must also predict which others ought to be seen."""
LIKENED, ALIKE = 8, 0.3
"""Number of tags that are compared with the image at all places where they may be, and how much (a correlation) it must
resemble them at one: by chance it is .05."""
SPARE = 1.25
"""Factor by which more tags are aligned roughly than are measured, as some will not be believed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedTags:
    """Tags of the target with the places where an image should show them.

    Attributes
    ----------
    ids : (N,)
        Tags that face the camera, each once; those of other targets are passed over.
    corners_px : (N, 4, 2), px
        Where their corners should be, in any camera model; about a module's error is allowed.
    blur : (2,)
        How the image should be blurred: c and s of :mod:`boxcal.detect.alignment.motion_blur`; 0 where it is round.
    alone
        Whether the rest of the image is not searched where they are not there.
    most
        Number of the tags found that are measured, spread evenly over the box; all if not given.
    places_px : (S, N, 4, 2), px
        Where they may be instead, all together: they are asked where the image resembles them most.
    """

    ids: Index
    corners_px: Array
    blur: Array = field(default_factory=lambda: np.zeros(2))
    alone: bool = False
    most: int | None = None
    places_px: Array = field(default_factory=lambda: np.zeros((0, 0, 4, 2)))

    def within(self, image_size: tuple[int, int]) -> NDArray[np.bool_]:
        """Return which of them (N,) lie wholly within an image (width, height)."""
        with np.errstate(invalid="ignore"):
            inside = (self.corners_px >= -0.5) & (self.corners_px <= np.array(image_size) - 0.5)
        return np.asarray(np.all(inside, axis=(1, 2)))


def find_expected(  # noqa: PLR0917
    pyramid: Pyramid,
    target: Target,
    patterns: Patterns,
    expected: ExpectedTags,
    limits: Limits,
    camera: CameraPrior | None,
) -> BoxDetection | None:
    """Return the tags of one box from where some are expected, roughly aligned; None if too few of them are there.

    A few are aligned first: they show whether the others are there, and how far off the expectation is on the whole.
    """
    size = pyramid.size
    rows, corners = _within_image(target, patterns, _where_alike(pyramid, target, patterns, expected), size)
    if len(rows) < FEW_TAGS:
        return None
    cut = expected.most is not None and len(rows) > SPARE * expected.most
    if cut and expected.most is not None:
        some = _evenly(rows, round(SPARE * expected.most))
        rows, corners = rows[some], corners[some]
    fit = fit_box(target, rows, corners, image_size=size, sigma_px=CANDIDATE_SIGMA_PX, camera=camera)
    first, begun = _largest(patterns, rows, corners)
    asked = align_coarsely(pyramid.under(fit.lens), patterns, first, begun)
    there = verified(patterns, asked, limits.relaxed())
    if there.sum() < LEAST_FOUND * ASKED:
        return None
    moved = np.median((asked.corners_px - begun)[there], axis=(0, 1))
    search = PredictedRegions(rows=rows, corners_px=corners + moved, fit=fit)
    found = grow_from_pose(pyramid, target, patterns, search, limits, others=not cut, on_face=first_on_face(camera))
    told = np.isfinite(found.lost_module_px) or len(found.tags) >= MOST_FOUND * len(rows)
    enough = len(found.tags) >= max(FEW_TAGS, LEAST_FOUND * len(rows)) and told
    return at_most(found, expected.most) if enough else None


def _where_alike(pyramid: Pyramid, target: Target, patterns: Patterns, expected: ExpectedTags) -> ExpectedTags:
    """Return the tags at the one of the places where they may be that the image resembles most, if it does any."""
    inside = [replace(expected, corners_px=corners).within(pyramid.size) for corners in expected.places_px]
    everywhere = np.flatnonzero(np.all([*inside, among(expected.ids, target.tag_ids)], axis=0))
    if not inside or len(everywhere) < FEW_TAGS:
        return expected
    some = everywhere[np.linspace(0, len(everywhere) - 1, min(LIKENED, len(everywhere))).astype(int)]
    rows = np.array([target.row_of(int(tag)) for tag in expected.ids[some]], dtype=np.int64)
    alike = resemblance(pyramid.copy(0), patterns, rows, expected.places_px[:, some])
    best = int(np.argmax(alike))
    return replace(expected, corners_px=expected.places_px[best]) if alike[best] > ALIKE else expected


def _largest(patterns: Patterns, rows: Index, corners: Array) -> tuple[Index, Array]:
    """Return a few of some tags (N,) at corners (N, 4, 2), from the largest to the smallest."""
    order = np.argsort(-module_px(patterns, corners), kind="stable")
    some = order[np.linspace(0, len(rows) - 1, min(ASKED, len(rows))).astype(int)]
    return rows[some], corners[some]


def at_most(found: BoxDetection, most: int | None) -> BoxDetection:
    """Return a detection with at most a number of tags, evenly over the rows of all."""
    if most is None or len(found.tags) <= most:
        return found
    return replace(found, tags=found.tags.take(_evenly(found.tags.rows, most)))


def _evenly(rows: Index, count: int) -> Index:
    """Return which of some tags (N,) to take for a number of them, spread evenly over their rows."""
    order = np.argsort(rows, kind="stable")
    return np.asarray(order[np.linspace(0, len(order) - 1, count).astype(int)])


def _within_image(
    target: Target, patterns: Patterns, expected: ExpectedTags, image_size: tuple[int, int]
) -> tuple[Index, Array]:
    """Return rows (N,) and corners (N, 4, 2) of the expected tags that could be read there."""
    corners, inside = expected.corners_px, expected.within(image_size)
    with np.errstate(invalid="ignore"):
        inside &= convex(corners) & (module_px(patterns, corners) >= MIN_MODULE_PX)
    inside &= among(expected.ids, target.tag_ids)
    rows = np.array([target.row_of(int(tag)) for tag in expected.ids[inside]], dtype=np.int64)
    return rows, corners[inside]
