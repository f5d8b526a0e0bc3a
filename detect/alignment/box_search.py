"""The box through candidates, and the regions in which its tags are to be searched for."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_pose import BoxFit, CameraPrior, fit_box
from boxcal.detect.alignment.candidates import TagCandidates
from boxcal.detect.alignment.face_agreement import CANDIDATE_TOLERANCE, FACE_TAGS
from boxcal.detect.alignment.predicted_tags import predicted
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.row_sets import among, distinct
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import module_px
from boxcal.target.arrays import Array
from boxcal.target.box import Target

CANDIDATE_SIGMA_PX = 0.5
RIGID_TOLERANCE_MODULES, RIGID_TOLERANCE_PX = 0.5, 0.75
FACE_KEPT = 0.34
"""A face of which ``FACE_TAGS`` or more were seen, but less than this fraction of them on the box, contradicts it."""
_AROUND = np.array([0, 1, 2, 3, 0])
OFF_CENTRE, OFF_SIGMAS = 0.5, 3.0
"""It lies there whose centre is off by no more than this fraction of its side and this many deviations of its place."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedRegions:
    """Image regions in which tags are predicted, with the source of each prediction.

    Attributes
    ----------
    rows : (N,)
        Each once.
    corners_px : (N, 4, 2), px
    fit
        The box that they lie on.
    contradicting_faces
        Faces of which tags are seen where no such box has them: on another box, or on a print on the wall.
    """

    rows: Index
    corners_px: Array
    fit: BoxFit
    contradicting_faces: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxDetection:
    """Tags that are really there.

    Attributes
    ----------
    tags
        Roughly aligned.
    fit
        The box through them.
    lost_module_px
        How wide the modules are seen at most of tags that the box turns to the camera, but that were not found; 0 if
        there are none, infinite where the fit is too poor to say which those are.
    lost_region_px : (2, 2), px
        First and last (x, y) of where those may be seen; all of the image where the fit is too poor to say.
    contradicting_faces
        See :class:`PredictedRegions`.
    read
        All tags that were read, wherever they lie.
    """

    tags: TagAlignments
    fit: BoxFit
    lost_module_px: float
    lost_region_px: Array
    contradicting_faces: tuple[int, ...] = ()
    read: TagCandidates = field(default_factory=TagCandidates.none)

    def off_the_box(self, target: Target, fit: BoxFit, used: Index, image_size: tuple[int, int]) -> Index:
        """Return the rows of tags that were read, but nowhere near where the box has them, ascending.

        Corners are compared along the tag's own edges: rough ones of a tag seen at a slant are off along its length by
        more than it is wide. Of a tag that the image's border cuts the outline follows that, so only its centre counts.

        Parameters
        ----------
        target
            The box.
        fit
            The box as it was found in the end.
        used
            Rows of the tags on it: they are where they should be, whatever was read elsewhere.
        image_size
            Width and height, px.
        """
        elsewhere = ~among(self.read.rows, used)
        if not elsewhere.any():
            return np.zeros(0, dtype=np.int64)
        read = self.read.take(elsewhere)
        uv = fit.places(target.tag_corners[read.rows].reshape(-1, 3)).reshape(-1, 4, 2)
        # a point without an image is NaN, and near to nothing
        near = _off_by(uv, read.corners_px - uv).max(axis=1) < CANDIDATE_TOLERANCE
        cut = np.isfinite(uv).all(axis=(1, 2)) & ((uv < -0.5) | (uv > np.array(image_size) - 0.5)).any(axis=(1, 2))
        centres = np.mean(read.corners_px[cut] - uv[cut], axis=1, keepdims=True)
        near[cut] |= _off_by(uv[cut], centres)[:, 0] <= OFF_CENTRE
        near &= fit.faces_camera(target)[read.rows]
        return distinct(read.rows[~among(read.rows, read.rows[near])])


def predict_regions(
    target: Target,
    patterns: Patterns,
    candidates: TagCandidates,
    image_size: tuple[int, int],
    *,
    sigma_px: float = CANDIDATE_SIGMA_PX,
    camera: CameraPrior | None = None,
) -> PredictedRegions:
    """Return the regions to search: at the candidates that one rigid box explains, and where it predicts more tags."""
    fit, rows, corners = _fitted(target, patterns, candidates, image_size, sigma_px, camera)
    others = _outvoted(target, candidates, fit)
    if others or candidates.again:
        # faces contradict each other, or are seen twice: several faces that agree are a box, as no print on a wall is;
        # else it is what the largest part of the image shows
        groups = [
            candidates.take(target.tag_faces[candidates.rows] == f) for f in distinct(target.tag_faces[candidates.rows])
        ]
        groups += candidates.again
        fit, rows, corners = max(
            (_grown_from(target, patterns, groups, k, image_size, sigma_px, camera) for k in range(len(groups))),
            key=lambda found: (_faces_of(target, found[1]) > 1, float(np.sum(module_px(patterns, found[2]) ** 2))),
        )
        others = _outvoted(target, candidates, fit)
    # where many candidates agree, the box says better than each of them where its corners are
    uv, spread = fit.predict(target.tag_corners[rows].reshape(-1, 3))
    surer = (spread.reshape(-1, 4).max(axis=1) < sigma_px) & (fit.off_px < 4 * sigma_px)
    corners = np.where(surer[:, None, None], uv.reshape(-1, 4, 2), corners)
    more = predicted(target, patterns, fit, rows, image_size)
    rows, corners = np.concatenate([rows, more.rows[more.sure]]), np.concatenate([corners, more.corners_px[more.sure]])
    return PredictedRegions(
        rows=rows, corners_px=corners, fit=fit, contradicting_faces=tuple(sorted({*others, *candidates.seen_twice}))
    )


def _fitted(  # noqa: PLR0917
    target: Target,
    patterns: Patterns,
    candidates: TagCandidates,
    image_size: tuple[int, int],
    sigma_px: float,
    camera: CameraPrior | None,
) -> tuple[BoxFit, Index, Array]:
    """Return the box through candidates, and which of them lie on it."""
    fit = fit_box(
        target, candidates.rows, candidates.corners_px, image_size=image_size, sigma_px=sigma_px, camera=camera
    )
    return consistent(
        target, patterns, candidates.rows, candidates.corners_px, image_size=image_size, sigma_px=sigma_px, fit=fit
    )


def _faces_of(target: Target, rows: Index) -> int:
    """Return on how many faces tags lie, those with a single one aside."""
    return int(np.sum(np.bincount(target.tag_faces[rows]) > 1))


def _outvoted(target: Target, candidates: TagCandidates, fit: BoxFit) -> tuple[int, ...]:
    """Return the faces of which many tags were seen, but hardly any where the box has them.

    Rough corners of a tag seen at a slant may be off by a module and more; its centre is not.
    """
    uv, spread = fit.predict(0.25 * target.tag_corners[candidates.rows].sum(axis=1))
    apart, along = uv - 0.25 * candidates.corners_px.sum(axis=1), np.diff(candidates.corners_px[:, _AROUND], axis=1)
    side = np.hypot(along[..., 0], along[..., 1]).max(axis=1)
    kept = np.hypot(apart[:, 0], apart[:, 1]) <= OFF_CENTRE * side + OFF_SIGMAS * spread
    kept &= fit.faces_camera(target)[candidates.rows]
    faces = target.tag_faces[candidates.rows]
    seen = np.bincount(faces, minlength=1)
    there = np.bincount(faces[kept], minlength=len(seen))
    return tuple(int(f) for f in np.flatnonzero((seen >= FACE_TAGS) & (there < FACE_KEPT * seen)))


def _off_by(uv: Array, apart: Array) -> Array:
    """Return how far off (N, k), in sides of the tags (N, 4, 2), px, something is that lies (N, k, 2), px, apart."""
    across, down = uv[:, None, 1] - uv[:, None, 0], uv[:, None, 3] - uv[:, None, 0]
    area = np.abs(_cross(across, down))
    return np.asarray(np.maximum(np.abs(_cross(apart, down)), np.abs(_cross(across, apart))) / area)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _grown_from(  # noqa: PLR0917
    target: Target,
    patterns: Patterns,
    groups: list[TagCandidates],
    first: int,
    image_size: tuple[int, int],
    sigma_px: float,
    camera: CameraPrior | None,
) -> tuple[BoxFit, Index, Array]:
    """Return the box through the tags of one face and of those that agree with it."""
    chosen = groups[first]
    found = _fitted(target, patterns, chosen, image_size, sigma_px, camera)
    for group in groups:
        if among(target.tag_faces[group.rows[:1]], target.tag_faces[chosen.rows]).any():
            continue
        both = chosen.merged(group)
        trial = _fitted(target, patterns, both, image_size, sigma_px, camera)
        good = _good(target, patterns, trial[0], trial[1], trial[2], sigma_px)
        if good.sum() >= len(found[1]) + FACE_KEPT * len(group) and not _outvoted(target, both, trial[0]):
            chosen, found = both, trial
    return found


def consistent(
    target: Target,
    patterns: Patterns,
    rows: Index,
    corners_px: Array,
    *,
    image_size: tuple[int, int],
    sigma_px: float,
    fit: BoxFit,
) -> tuple[BoxFit, Index, Array]:
    """Return the box refitted until all its tags lie on it and face the camera, and those tags.

    For ``rows`` (N,), ``corners_px`` (N, 4, 2), px, and ``sigma_px``, px, of the tags that were fitted see
    :func:`boxcal.detect.alignment.box_pose.fit_box`.
    """
    while True:
        good = _good(target, patterns, fit, rows, corners_px, sigma_px)
        if good.all() or not good.any() or len(rows) < 3:
            return fit, rows, corners_px
        rows, corners_px = rows[good], corners_px[good]
        fit = fit_box(target, rows, corners_px, image_size=image_size, sigma_px=sigma_px, start=fit)


def _good(  # noqa: PLR0917
    target: Target, patterns: Patterns, fit: BoxFit, rows: Index, corners_px: Array, sigma_px: float
) -> NDArray[np.bool_]:
    """Return which of the tags (N,) that were fitted lie on the box and face the camera."""
    on_box = fit.off_px <= _tolerance(patterns, corners_px, sigma_px)
    return on_box & fit.faces_camera(target)[rows]


def _tolerance(patterns: Patterns, corners_px: Array, sigma_px: float) -> Array:
    module = module_px(patterns, corners_px)
    return np.asarray(RIGID_TOLERANCE_MODULES * module + RIGID_TOLERANCE_PX + 4 * sigma_px)
