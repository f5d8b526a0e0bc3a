"""Tag candidates: dark quadrilaterals whose inside resembles a pattern, accurate to about a pixel."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.backend import backend
from boxcal.detect.alignment.homography import from_square
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.image.gray import Levels, halved
from boxcal.target.arrays import Array

MIN_SIDE_PX = 7.0
MIN_WIDTH_PX = 4.5
MIN_CONTRAST = 8.0
"""Grey levels between a quadrilateral's rim and what surrounds it."""
MIN_SCORE = 0.72
MIN_LEAD = 0.08
"""How much better a quadrilateral must resemble its pattern than any other, as a correlation."""
MAX_QUADS = 4000
_THRESHOLD_OFFSET = 7
_REMAP_ROWS = 30_000
_NEXT, _BEFORE = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TagCandidates:
    """Places where a tag may be.

    Attributes
    ----------
    rows : (N,)
        Row of the pattern it resembles.
    corners_px : (N, 4, 2), px
        In the order of the tag's corners.
    score : (N,)
        Correlation of the modules with the pattern's.
    seen_twice
        Faces of which many tags were seen in a second place; the larger sighting is kept.
    again
        The smaller sightings of those faces, in their order.
    """

    rows: Index
    corners_px: Array
    score: Array
    seen_twice: tuple[int, ...] = ()
    again: "tuple[TagCandidates, ...]" = ()

    @classmethod
    def none(cls) -> "TagCandidates":
        """Return no candidates."""
        return cls(rows=np.zeros(0, np.int64), corners_px=np.zeros((0, 4, 2)), score=np.zeros(0))

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, at: NDArray[np.bool_] | Index) -> "TagCandidates":
        """Return some of them."""
        return TagCandidates(rows=self.rows[at], corners_px=self.corners_px[at], score=self.score[at])

    def merged(self, more: "TagCandidates") -> "TagCandidates":
        """Return these and others, copies of the same sighting reduced to the best."""
        return _once(
            TagCandidates(
                rows=np.concatenate([self.rows, more.rows]),
                corners_px=np.concatenate([self.corners_px, more.corners_px]),
                score=np.concatenate([self.score, more.score]),
            )
        )


def find_candidates(
    grey: NDArray[np.uint8], patterns: Patterns, windows_px: tuple[int, ...], scale: float = 1.0
) -> TagCandidates:
    """Return the places that resemble one of the patterns; one tag may come back under several windows once only.

    Parameters
    ----------
    grey : (H, W)
        Image to search.
    patterns
        What to look for.
    windows_px
        Sizes (odd) of the neighbourhoods that tell dark from bright.
    scale
        How much larger than the image to search, a power of 2; 2 finds tags whose modules are little more than a pixel.
    """
    image = grey
    if scale > 1:
        image = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    for _ in range(round(-np.log2(scale))):
        image = np.asarray(halved(image), dtype=np.uint8)
    found = [_decoded(image, quads, patterns) for quads in (_quads(image, w) for w in windows_px) if len(quads)]
    if not found:
        return TagCandidates.none()
    rows = np.concatenate([f.rows for f in found])
    corners = np.concatenate([f.corners_px for f in found])
    score = np.concatenate([f.score for f in found])
    corners = (corners + 0.5) / scale - 0.5
    return _once(TagCandidates(rows=rows, corners_px=corners, score=score))


def _quads(image: NDArray[np.uint8], window_px: int) -> Array:
    """Return the outlines of dark quadrilaterals, (N, 4, 2) px, clockwise as seen."""
    dark = _dark(image, window_px)
    corners: Array = backend().four_sided(dark, int(3 * MIN_SIDE_PX), 2 * sum(image.shape))[:MAX_QUADS]
    if len(corners) == 0:
        return corners
    along, across = corners[:, _NEXT] - corners, corners[:, 2:] - corners[:, :2]
    side = np.hypot(along[..., 0], along[..., 1])
    diagonal = np.hypot(across[..., 0], across[..., 1]).max(axis=1)
    area = _area(corners)
    good = (side.min(axis=1) >= MIN_WIDTH_PX) & (side.max(axis=1) >= MIN_SIDE_PX) & (area > MIN_WIDTH_PX * diagonal / 2)
    corners = corners[good]
    # contours run through the centres of dark pixels; the edge lies half a pixel further out
    return _grown(corners, 0.5)


def _dark(image: NDArray[np.uint8], window_px: int) -> NDArray[np.uint8]:
    """Return 1 where an image is darker than its neighbourhood: as ``cv2.adaptiveThreshold``, in half of its time."""
    border = cv2.BORDER_REPLICATE | cv2.BORDER_ISOLATED
    mean = np.asarray(cv2.boxFilter(image, -1, (window_px, window_px), borderType=border), dtype=np.uint8)
    below = cv2.subtract(mean, image, dst=mean)
    return np.asarray(cv2.threshold(below, _THRESHOLD_OFFSET - 1, 1, cv2.THRESH_BINARY, dst=below)[1], dtype=np.uint8)


def _area(corners: Array) -> Array:
    """Return the signed areas of quadrilaterals (N, 4, 2), positive where clockwise as seen."""
    a, b = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return np.asarray(0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))


def _grown(corners: Array, by_px: float) -> Array:
    """Return quadrilaterals with every edge moved outward."""
    along = corners[:, _NEXT] - corners
    per = 1 / np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-9)
    normal = np.empty_like(corners)
    normal[..., 0], normal[..., 1] = along[..., 1] * per, -along[..., 0] * per
    # corner k lies between edges k - 1 and k: the shift that moves both lines by the same distance
    before = normal[:, _BEFORE]
    denominator = 1 + before[..., 0] * normal[..., 0] + before[..., 1] * normal[..., 1]
    return np.asarray(corners + (before + normal) * (by_px / np.maximum(denominator, 0.2))[..., None])


def _decoded(image: NDArray[np.uint8], corners: Array, patterns: Patterns) -> TagCandidates:
    """Return which pattern, turned how, each quadrilateral resembles, where it resembles one."""
    h = from_square(patterns.modules, corners)
    h[~np.isfinite(h).all(axis=1)] = 0  # all in one place: no contrast
    places, ring, rim, within = _modules(patterns.modules)
    x, y, w = (h[:, :3] @ places, h[:, 3:6] @ places, h[:, 6:] @ places[:2] + 1)
    value = sample(image, x / w, y / w)
    on_rim = value[:, rim]
    white, black, rim_mean = _middle(value[:, ring]), _middle(on_rim), on_rim.sum(axis=1) / len(rim)
    inner = value[:, within]
    inner -= (inner.sum(axis=1) / len(within))[:, None]
    norm = np.sqrt((inner * inner).sum(axis=1))
    at = np.flatnonzero((white - black > MIN_CONTRAST) & (rim_mean < black + 0.35 * (white - black)) & (norm > 1e-6))
    score = (inner[at] / norm[at, None]).astype(np.float32) @ _turned(patterns).T
    if score.size == 0:
        return TagCandidates.none()
    every = np.arange(len(at))
    best = score.argmax(axis=1)
    top = score[every, best]
    score[every, best] = -1
    keep = (top >= MIN_SCORE) & (top - score.max(axis=1) >= MIN_LEAD)
    rows, turn = np.divmod(best[keep], 4)
    order = (np.arange(4)[None, :] + turn[:, None]) % 4
    quads = corners[at[keep]]
    return TagCandidates(
        rows=rows.astype(np.int64),
        corners_px=quads[np.arange(len(quads))[:, None], order],
        score=top[keep].astype(np.float64),
    )


@lru_cache(maxsize=4)
def _modules(m: int) -> tuple[Array, Index, Index, Index]:
    """Return the middles (3, P) of modules, as (u, v, 1), and which lie around the tag, on its rim, and within."""
    u, v = (a.ravel() for a in np.meshgrid(np.arange(-1, m + 1), np.arange(-1, m + 1)))
    depth = np.minimum(np.minimum(u, v), m - 1 - np.maximum(u, v))
    ring, rim, within = (np.flatnonzero(some) for some in (depth < 0, depth == 0, depth > 0))
    return np.stack([u + 0.5, v + 0.5, np.ones(len(u))]), ring, rim, within


def _middle(values: Array) -> Array:
    """Return the median of each row (N, P) of an even number of values."""
    half = values.shape[1] // 2
    return np.asarray(np.partition(values, (half - 1, half), axis=1)[:, half - 1 : half + 1].mean(axis=1))


@lru_cache(maxsize=16)
def _turned(patterns: Patterns) -> NDArray[np.float32]:
    """Return all patterns' inner modules in four orientations, (4 T, (M - 2)^2) float32, zero mean and unit length.

    Row ``4 t + k`` is what one sees of tag t with the corners of the quadrilateral numbered from the tag's corner -k:
    the tag's first corner is the quadrilateral's corner k.
    """
    inner = patterns.cells[:, 2:-2, 2:-2]
    turned = np.stack([np.rot90(inner, -k, axes=(1, 2)) for k in range(4)], axis=1)
    flat = turned.reshape(4 * len(inner), -1)
    flat = flat - flat.mean(axis=1, keepdims=True)
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9), dtype=np.float32)


def sample(image: Levels, x: Array, y: Array) -> Array:
    """Return grey levels at places (N, P), interpolated; places outside take the border's."""
    limit = 4.0 * max(image.shape)
    x, y = (np.minimum(np.maximum(at, -limit), limit).astype(np.float32) for at in (x, y))
    parts = [
        cv2.remap(
            image, x[k : k + _REMAP_ROWS], y[k : k + _REMAP_ROWS], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        for k in range(0, len(x), _REMAP_ROWS)
    ]
    return np.concatenate(parts).astype(np.float64)


def _once(candidates: TagCandidates) -> TagCandidates:
    """Return the candidates with copies of the same tag at the same place reduced to the best."""
    order = np.argsort(-candidates.score)
    if np.bincount(candidates.rows, minlength=1).max() <= 1:
        return candidates.take(order)
    rows, centre = candidates.rows[order], candidates.corners_px[order].mean(axis=1)
    size = np.linalg.norm(candidates.corners_px[order] - centre[:, None], axis=2).min(axis=1)
    same = (rows[:, None] == rows[None, :]) & (np.linalg.norm(centre[:, None] - centre[None], axis=2) < size[None, :])
    first = ~np.any(np.tril(same, -1), axis=1)
    return candidates.take(order[first])
