"""Tags that a hard shadow or a highlight crosses: each module at its own level of light.

The alignment's light is black, white and two slopes. Where a shadow's edge crosses a tag, both levels jump along it;
the residuals then stand in whole modules, and edges of modules are taken for displaced. So the pattern of such a tag is
replaced by what the image shows: every module keeps its place, but has the level that its pixels say. Those levels
must still be a tag's: each white module clearly brighter than the black ones beside it. The edge of the shadow itself,
within a module, stays what it is; the rigid box says how far that has displaced a tag.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.backend import backend
from boxcal.detect.alignment.box_pose import BoxFit
from boxcal.detect.alignment.registration.align import align, aligned_batch
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.detect.alignment.verification import Limits, doubtful_limits, verified
from boxcal.detect.image.order_statistics import median, quantile
from boxcal.target.arrays import Array
from boxcal.target.box import Target

ROUNDS = 3
SUSPICIOUS, UNUSUAL = 0.04, 3.0
"""Tags are looked at again whose largest mean residual of two by two modules, over the contrast, is more than this,
and this many times that of the better tags of the image, where noise makes it."""
LEAST_LOCAL_CONTRAST = 0.2
"""Of neighbouring modules, over the tag's contrast: less light than in a deep shadow shows no edge."""
LEAST_EDGES = 0.97
"""Fraction of the edges between black and white modules that must have it: a finger hides many."""


def crossed(tags: TagAlignments, patterns: Patterns, limits: Limits) -> NDArray[np.bool_]:
    """Return which tags (N,) a shadow's edge or a highlight may cross: aligned, but some modules are off."""
    if len(tags) == 0:
        return np.zeros(0, dtype=np.bool_)
    usual = quantile(tags.worst_block, 0.25)
    unusual = tags.worst_block > max(SUSPICIOUS, UNUSUAL * usual)
    return unusual & verified(patterns, tags, doubtful_limits(limits))


def align_unevenly_lit(
    frame: Frame, patterns: Patterns, tags: TagAlignments, *, side_px: float, stop_px: float, limits: Limits
) -> tuple[TagAlignments, NDArray[np.bool_]]:
    """Return tags aligned with modules at their own levels, and which of them (N,) can be believed.

    Arguments as for :func:`boxcal.detect.alignment.registration.align.align`.
    """
    cells = patterns.cells[tags.rows].copy()
    own, rows = tags, np.arange(len(tags), dtype=np.int64)
    for _ in range(ROUNDS):
        cells = _levels(frame, cells, replace(own, rows=rows), side_px)
        modules = Patterns(tag_ids=patterns.tag_ids[tags.rows], cells=cells, gap_modules=patterns.gap_modules)
        own = align(frame, modules, rows, own.corners_px, start=own, side_px=side_px, stop_px=stop_px)
    good = verified(patterns, own, limits) & _readable(patterns.cells[tags.rows], cells)
    return replace(own, rows=tags.rows), good


def _levels(frame: Frame, cells: Array, tags: TagAlignments, side_px: float) -> Array:
    """Return the modules' levels (N, M + 2, M + 2) with what their pixels say beyond the present ones."""
    patterns = Patterns(tag_ids=tags.rows, cells=cells, gap_modules=2.0)
    blocks = backend().accumulate(aligned_batch(frame, patterns, tags, side_px)).blocks
    residual = blocks[..., 0] / np.maximum(blocks[..., 1], 1)
    black, contrast = (tags.theta[:, k, None, None] for k in (BLACK, CONTRAST))
    last = len(frame.response) - 1
    at = np.clip((black + contrast * cells) * last, 0, last - 1e-9).astype(np.int64)
    slope = np.maximum((frame.response[at + 1] - frame.response[at]) * last, 0.3)
    return np.asarray(np.clip(cells + residual / slope / np.maximum(contrast, 1e-3), -0.5, 2.5))


def _readable(pattern: Array, cells: Array) -> NDArray[np.bool_]:
    """Return in which tags (N,) white modules are still brighter than the black ones beside them."""
    told, seen = np.zeros(len(cells)), np.zeros(len(cells))
    for axis in (1, 2):
        sign = np.diff(pattern, axis=axis)
        edges = sign != 0
        told += edges.sum(axis=(1, 2))
        seen += (edges & (sign * np.diff(cells, axis=axis) > LEAST_LOCAL_CONTRAST)).sum(axis=(1, 2))
    return np.asarray(seen >= LEAST_EDGES * told)


def box_distance2(target: Target, tags: TagAlignments, fit: BoxFit) -> Array:
    """Return the mean squared distance per axis (N,) px^2 of tags' corners from where the rigid box has them."""
    uv = fit.places(target.tag_corners[tags.rows].reshape(-1, 3))
    return np.asarray(np.mean((uv.reshape(-1, 4, 2) - tags.corners_px) ** 2, axis=(1, 2)))


def displacement_px2(target: Target, tags: TagAlignments, fit: BoxFit, uneven: NDArray[np.bool_]) -> Array:
    """Return the variance (N,) px^2 per axis by which unevenly lit tags lie further beside the box than the others."""
    off2 = box_distance2(target, tags, fit)
    return np.where(uneven, np.maximum(off2 - median(off2), 0.0), 0.0)
