"""The preview: tags that stand out by themselves, their edges fitted with straight lines."""

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_search import consistent_candidates
from boxcal.detect.alignment.candidates import find_candidates
from boxcal.detect.alignment.pyramid_search import FEW_TAGS, shrinkings
from boxcal.detect.alignment.tag_patterns import Index, target_patterns
from boxcal.detect.tags.line_fit import CornerSettings, refine
from boxcal.target.arrays import Array
from boxcal.target.box import Target

MIN_SCORE = 0.85
"""Nothing else vouches for a previewed tag."""
SIGMA_PX = 0.1
"""Deviation per axis that is claimed for a previewed corner; nothing in the picture is asked for it."""
_LINES = {
    response: CornerSettings(response=response, profiles=12, samples=13, rounds=1) for response in ("linear", "srgb")
}


def preview(grey8: NDArray[np.uint8], target: Target, response: str, window_px: int) -> tuple[Index, Array]:
    """Return rows in the target's table (N,) and corners (N, 4, 2) px of the tags that are easily seen.

    No tag is predicted and none is compared with its pattern beyond its decoding; the edges are those of
    :func:`boxcal.detect.tags.line_fit.refine`.
    """
    patterns = target_patterns(target)
    # half as much shrunk as a search that has still to predict what it missed
    size = (grey8.shape[1], grey8.shape[0])
    factor = max(1, shrinkings(size)[0] // 2)
    candidates = consistent_candidates(target, find_candidates(grey8, patterns, (window_px,), scale=1 / factor), size)
    if len(candidates) < FEW_TAGS and factor > 1:
        candidates = consistent_candidates(target, find_candidates(grey8, patterns, (window_px,)), size)
    candidates = candidates.take(candidates.score >= MIN_SCORE)
    corners, good = refine(grey8, candidates.corners_px, _LINES[response])
    return candidates.rows[good], corners[good]
