"""Coarse-to-fine search for all tags of a box over the levels of an image pyramid.

Large tags stand out in few pixels. A lower pyramid level is enough where every tag that the box turns to the camera was
found from it, or the whole image would not show the rest either; else larger ones are searched.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_growth import grow_from_pose
from boxcal.detect.alignment.box_pose import CameraPrior
from boxcal.detect.alignment.box_search import CANDIDATE_SIGMA_PX, BoxDetection, predict_regions
from boxcal.detect.alignment.candidates import TagCandidates, find_candidates
from boxcal.detect.alignment.face_agreement import consistent_candidates
from boxcal.detect.alignment.placed_by_box import first_on_face
from boxcal.detect.alignment.pyramid import Pyramid
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.detect.alignment.verification import Limits
from boxcal.detect.image.gray import LEAST_SIDE_PX
from boxcal.target.box import Target

FEW_TAGS = 4
SMALL_PX = 600
"""Images are not shrunk below this, px of the longer side."""
CANDIDATE_MODULE_PX = 0.9
"""Tags with narrower modules make no candidates."""
MOST_ENLARGED, LONGEST_ENLARGED_PX = 4_000_000, 16_000
"""Larger images are not enlarged: pixels, and px a side (OpenCV maps less than 32767)."""


def find_box(
    pyramid: Pyramid,
    grey8: NDArray[np.uint8],
    target: Target,
    patterns: Patterns,
    *,
    windows_px: tuple[int, ...],
    limits: Limits,
    camera: CameraPrior | None = None,
) -> BoxDetection | None:
    """Return the tags of one box, roughly aligned; None if there is no candidate of any.

    Parameters
    ----------
    pyramid, grey8 : (H, W)
        The image, and in 8 bits to look for candidates.
    target, patterns
        The box and what its tags look like.
    windows_px
        Neighbourhoods that tell dark from bright: the first one always, the others where it finds few tags.
    limits
        What an aligned tag must keep to.
    camera
        The camera, if it is known from other images.
    """
    size, found, on_face = pyramid.size, None, first_on_face(camera)
    for factor in shrinkings(size):
        if found is not None and found.lost_module_px < CANDIDATE_MODULE_PX * factor:
            continue
        if found is None:
            read = _in_all(pyramid, grey8, patterns, windows_px[:1], factor)
        else:
            there = _around_lost(grey8, patterns, windows_px[:1], factor, found)
            if among(there.rows, found.tags.rows).all():
                continue
            read = there.merged(_as_candidates(found)).merged(found.read)
        candidates = consistent_candidates(target, read, size)
        if len(candidates) < FEW_TAGS:
            continue
        search = predict_regions(
            target, patterns, candidates, size, sigma_px=CANDIDATE_SIGMA_PX * factor, camera=camera
        )
        now = grow_from_pose(pyramid, target, patterns, search, limits, on_face=on_face)
        if len(now.tags) >= FEW_TAGS or factor == 1:
            found = replace(now, read=read)
        if found is not None and found.lost_module_px < CANDIDATE_MODULE_PX:
            break
    if found is not None:
        return found
    read = find_candidates(grey8, patterns, windows_px)
    candidates = consistent_candidates(target, read, size)
    if len(candidates) < FEW_TAGS and _may_grow(grey8):
        read = find_candidates(grey8, patterns, windows_px, scale=2.0)
        candidates = consistent_candidates(target, candidates.merged(read), size)
    if len(candidates) == 0:
        return None
    search = predict_regions(target, patterns, candidates, size, camera=camera)
    return replace(grow_from_pose(pyramid, target, patterns, search, limits, on_face=on_face), read=read)


def _in_all(
    pyramid: Pyramid, grey8: NDArray[np.uint8], patterns: Patterns, windows_px: tuple[int, ...], factor: int
) -> TagCandidates:
    """Return what resembles a tag in the image shrunk by a factor: in the pyramid's copy, if that is of 8 bits."""
    if pyramid.copy(0) is not grey8:
        return find_candidates(grey8, patterns, windows_px, scale=1 / factor)
    copy = np.asarray(pyramid.copy(factor.bit_length() - 1), dtype=np.uint8)
    there = find_candidates(copy, patterns, windows_px)
    return replace(there, corners_px=(there.corners_px + 0.5) * factor - 0.5)


def _around_lost(
    grey8: NDArray[np.uint8], patterns: Patterns, windows_px: tuple[int, ...], factor: int, found: BoxDetection
) -> TagCandidates:
    """Return what resembles a tag in the image shrunk by a factor, where tags of a box that was found are missing."""
    (x0, y0), (x1, y1) = found.lost_region_px.astype(int) // factor * factor
    part = grey8[y0 : y1 + 1, x0 : x1 + 1]
    if min(part.shape) < LEAST_SIDE_PX * factor:
        return TagCandidates.none()
    there = find_candidates(part, patterns, windows_px, scale=1 / factor)
    return TagCandidates(rows=there.rows, corners_px=there.corners_px + np.array([x0, y0]), score=there.score)


def _as_candidates(found: BoxDetection) -> TagCandidates:
    """Return the tags of a box that was found as places where tags may be."""
    return TagCandidates(rows=found.tags.rows, corners_px=found.tags.corners_px, score=found.tags.correlation)


def search_copies(grey8: NDArray[np.uint8], patterns: Patterns, windows_px: tuple[int, ...]) -> TagCandidates:
    """Return where single tags may be, whatever they are stuck on: under all windows, and at twice the size."""
    candidates = find_candidates(grey8, patterns, windows_px)
    if not _may_grow(grey8):
        return candidates
    return candidates.merged(find_candidates(grey8, patterns, windows_px, scale=2.0))


def _may_grow(grey8: NDArray[np.uint8]) -> bool:
    return grey8.size <= MOST_ENLARGED and max(grey8.shape) <= LONGEST_ENLARGED_PX


def shrinkings(image_size: tuple[int, int]) -> list[int]:
    """Return by how much to shrink an image (width, height) before it is searched: the most first, 1 last."""
    most = max(0, int(np.log2(min(max(image_size) / SMALL_PX, min(image_size) / LEAST_SIDE_PX))))
    return [2**level for level in range(most, -1, -1)]
