"""The preview: tags that stand out by themselves, their edges fitted with straight lines."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.candidates import TagCandidates, find_candidates
from boxcal.detect.alignment.face_agreement import consistent_candidates
from boxcal.detect.alignment.face_scatter import ENOUGH, scatter
from boxcal.detect.alignment.homography import least_squares_homography, map_points
from boxcal.detect.alignment.pyramid_search import FEW_TAGS, shrinkings
from boxcal.detect.alignment.tag_patterns import Index, target_patterns
from boxcal.detect.image.response_curve import Response
from boxcal.detect.tags.line_fit import CornerSettings, refine, systematic_px
from boxcal.detect.tags.tag_growth import TagGrowth, tag_growth
from boxcal.target.arrays import Array
from boxcal.target.box import Target

MIN_SCORE = 0.85
"""Nothing else vouches for a previewed tag."""
UNKNOWN_SIGMA_PX, LEAST_SIGMA_PX = 0.25, 0.005
"""Deviation per axis of corners that are too few to estimate it from, and the least."""
ODD = 3.0
"""Tags that lie beside their face's homography by this many times more than most, as in a highlight, are judged
apart."""
GROWN_PX = 0.08
"""Tags that grow or shrink by more under a linear response are measured under sRGB's as well."""
_LINES: dict[str, CornerSettings] = {
    response: CornerSettings(response=response, profiles=12, samples=13, rounds=1) for response in ("linear", "srgb")
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Preview:
    """Tags that are easily seen.

    Attributes
    ----------
    rows : (N,)
        In the target's table.
    corners_px : (N, 4, 2), px
    sigma_px : (N,), px
        Deviation per axis of a tag's corners.
    response
        Response curve under which their edges were fitted.
    """

    rows: Index
    corners_px: Array
    sigma_px: Array
    response: str


def preview(grey8: NDArray[np.uint8], target: Target, response: Response, window_px: int) -> Preview:
    """Return the tags that are easily seen in an image (H, W).

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
    first = _fitted(grey8, target, candidates, "linear" if response == "auto" else response)
    if response != "auto" or not abs(first[0].growth_px) > GROWN_PX:
        return first[1]
    other = _fitted(grey8, target, candidates, "srgb")
    return other[1] if abs(other[0].growth_px) < abs(first[0].growth_px) else first[1]


def _fitted(
    grey8: NDArray[np.uint8], target: Target, candidates: TagCandidates, response: str
) -> tuple[TagGrowth, Preview]:
    """Return tags with lines fitted to their edges under a response curve, and how they grew."""
    corners, good = refine(grey8, candidates.corners_px, _LINES[response])
    rows, corners = candidates.rows[good], corners[good]
    growth = tag_growth(target, rows, corners, (np.array(grey8.shape[::-1]) - 1) / 2)
    sigma = _deviations(target, rows, corners)
    return growth, Preview(rows=rows, corners_px=corners, sigma_px=sigma, response=response)


def _deviations(target: Target, rows: Index, corners_px: Array) -> Array:
    """Return the deviation per axis (N,), px, of tags' corners by their scatter on their faces, growth included."""
    apart, usual = np.zeros_like(corners_px), systematic_px(corners_px)
    for face in np.unique(target.tag_faces[rows]):
        on = target.tag_faces[rows] == face
        T = target.T_box_face(int(face))
        p_face = ((target.tag_corners[rows[on]] - T[:3, 3]) @ T[:3, :3])[..., :2]
        H = least_squares_homography(p_face.reshape(-1, 2), corners_px[on].reshape(-1, 2))
        apart[on] = corners_px[on] - map_points(H, p_face)
    shape = apart - apart.mean(axis=1, keepdims=True)
    off = np.sqrt(np.mean(shape**2, axis=(1, 2))) / usual
    cov = usual[:, None, None, None] ** 2 * np.broadcast_to(np.eye(2), (len(rows), 4, 2, 2))
    factor, freedom = scatter(target, rows, apart, cov, off > ODD * np.median(off) if len(off) else off > 0)
    if freedom < ENOUGH:
        return np.full(len(rows), UNKNOWN_SIGMA_PX)
    return np.maximum(usual * np.sqrt(factor), LEAST_SIGMA_PX)
