"""Corners of tags to a few hundredths of a pixel: straight lines through the edges of the black square, intersected.

Why not OpenCV's refinements: blur rounds a corner off, so whatever looks for the corner itself finds it inside
(0.2 px at one pixel of blur); the straight parts of an edge stay where they are.

The image is brought back to linear light first. A lens's blur mixes light, so only there does an edge lie half way
between black and white; under a camera's response curve white grows into black and tags shrink by tenths of a pixel.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError
from boxcal.target.arrays import Array
from boxcal.target.render.srgb import linear_from_srgb

RESPONSES = ("srgb", "linear")
MODULES = 8
_REMAP_ROWS = 16_384
_FIT_ROUNDS = 3
_ROBUST_SIGMAS = 3.0
_LEAST_SIGMA_PX = 1e-3
_SYSTEMATIC_PX = 0.03
_SYSTEMATIC_MODULE_PX2 = 0.18


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerSettings:
    """Settings of the refinement of corners.

    Attributes
    ----------
    response
        The camera response function: ``srgb`` (IEC 61966-2-1) or ``linear``.
    reach_modules
        How far to each side of an edge its profile is read, in modules of the tag as seen (beyond one it meets the
        tag's own bits).
    reach_px
        Bounds on that, px.
    profiles, samples
        Profiles along an edge, samples in each.
    inset
        Fraction of an edge left out at each end, where the corner is rounded.
    rounds
        Passes, each from the corners of the one before.
    max_move_modules, max_move_px
        A corner that moves further than both from where the square was found is not believed.
    """

    response: str = "srgb"
    reach_modules: float = 0.5
    reach_px: tuple[float, float] = (1.0, 5.0)
    profiles: int = 30
    samples: int = 25
    inset: float = 0.06
    rounds: int = 3
    max_move_modules: float = 0.75
    max_move_px: float = 1.5

    def __post_init__(self) -> None:
        if self.response not in RESPONSES:
            raise DetectError(f"tone is {self.response!r}, one of {', '.join(RESPONSES)} is needed")
        if not (self.profiles >= 4 and self.samples >= 5 and self.rounds >= 1 and 0 <= self.inset < 0.4):
            raise DetectError("corner settings: profiles >= 4, samples >= 5, rounds >= 1, 0 <= inset < 0.4 are needed")


def refine(image: NDArray[np.uint8], corners_px: Array, settings: CornerSettings) -> tuple[Array, NDArray[np.bool_]]:
    """Return tags' corners, refined from rough ones, and which of the tags can be believed.

    Parameters
    ----------
    image : (H, W)
        Grey.
    corners_px : (N, 4, 2), px
        Clockwise as seen, as OpenCV finds them.
    settings
        How.

    Returns
    -------
    (N, 4, 2) px and (N,); corners of a tag that cannot be believed are the rough ones.
    """
    rough = np.asarray(corners_px, dtype=np.float64)
    if rough.shape[0] == 0:
        return rough, np.zeros(0, dtype=np.bool_)
    light = linear_light(image, settings.response)
    corners, good = rough, np.ones(rough.shape[0], dtype=np.bool_)
    limit = np.maximum(settings.max_move_px, settings.max_move_modules * module_px(rough).mean(axis=1))
    for _ in range(settings.rounds):
        found = _intersections(*_edge_lines(light, corners, settings))
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(found - rough, axis=2).max(axis=1) <= limit
        good &= near
        corners = np.where(good[:, None, None], found, rough)
    return corners, good


def systematic_px(corners_px: Array) -> Array:
    """Return the standard deviation per axis, (N,) px, of what is the same in every image of a tag from one place.

    Pixel grid, compression and the tag's own bits shift an edge, the more the fewer pixels a module has: measured on
    path-traced JPEG images against their truth, 0.13 px where modules are 1.6 px wide, 0.09 at 2.2, 0.05 at 3.5,
    0.04 at 5.
    """
    narrowest = np.maximum(module_px(corners_px).min(axis=1), 0.5)
    return np.asarray(np.hypot(_SYSTEMATIC_PX, _SYSTEMATIC_MODULE_PX2 / narrowest))


def linear_light(image: NDArray[np.uint8], response: str) -> NDArray[np.float32]:
    """Return the light (0..1) of a grey image under a response curve."""
    grey = np.arange(256) / 255
    if response == "srgb":
        grey = np.asarray(linear_from_srgb(grey), dtype=np.float64)
    return np.asarray(cv2.LUT(image, grey.astype(np.float32)), dtype=np.float32)


def edge_normals(corners_px: Array) -> Array:
    """Return the outward unit normals (N, 4, 2) of tags' edges; edge k runs from corner k to corner k + 1."""
    return _left_of(np.roll(corners_px, -1, axis=1) - corners_px)


def module_px(corners_px: Array) -> Array:
    """Return how wide a module is seen across each edge, (N, 4) px."""
    middle = (corners_px + np.roll(corners_px, -1, axis=1)) / 2
    return np.asarray(
        np.abs(np.sum((middle - np.roll(middle, 2, axis=1)) * edge_normals(corners_px), axis=2)) / MODULES
    )


def _edge_lines(light: NDArray[np.float32], corners: Array, settings: CornerSettings) -> tuple[Array, Array]:
    """Return a line for each edge: a point on it and its unit normal, (N, 4, 2) each.

    The edge crosses a profile at the centroid of the profile's gradient, whatever the (symmetric) blur; a line goes
    through the crossings, those off by three deviations left out.
    """
    normal = edge_normals(corners)
    reach = np.clip(settings.reach_modules * module_px(corners), *settings.reach_px)
    along = np.linspace(settings.inset, 1 - settings.inset, settings.profiles)
    across = np.linspace(-1, 1, settings.samples)
    ends = np.roll(corners, -1, axis=1) - corners
    feet = corners[:, :, None] + along[:, None] * ends[:, :, None]
    offsets = (reach[..., None] * across)[:, :, None, :, None] * normal[:, :, None, None]
    profile = _sampled(light, feet[:, :, :, None] + offsets)
    gradient = np.diff(profile, axis=-1)
    rise = gradient.sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = (gradient @ ((across[1:] + across[:-1]) / 2)) / rise
    usable = (rise > 0.3 * np.median(rise, axis=-1, keepdims=True)) & (rise > 0) & (np.abs(crossing) < 1)
    crossing = np.where(usable, crossing, 0.0) * reach[..., None]
    offset, slope = _robust_line(2 * along - 1, crossing, usable)
    first = corners + (offset - slope)[..., None] * normal
    last = corners + ends + (offset + slope)[..., None] * normal
    return (first + last) / 2, _left_of(last - first)


def _left_of(along: Array) -> Array:
    """Return unit normals (..., 2) to the left of directions (..., 2) as the image shows them."""
    unit = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    return np.stack([unit[..., 1], -unit[..., 0]], axis=-1)


def _sampled(light: NDArray[np.float32], at_px: Array) -> Array:
    """Return the light at points (..., 2), interpolated; in batches, as OpenCV bounds the rows of a map."""
    flat = at_px.reshape(-1, at_px.shape[-2], 2).astype(np.float32)
    parts = [
        cv2.remap(light, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for part in (flat[k : k + _REMAP_ROWS] for k in range(0, len(flat), _REMAP_ROWS))
    ]
    return np.concatenate(parts).reshape(at_px.shape[:-1]).astype(np.float64)


def _robust_line(x: Array, y: Array, usable: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return offset and slope of ``y`` (..., A) over ``x`` (A,); NaN where fewer than half the points are usable."""
    weight = usable.astype(np.float64)
    offset = slope = np.zeros(y.shape[:-1])
    for _ in range(_FIT_ROUNDS):
        s0, s1, s2 = weight.sum(-1), weight @ x, weight @ x**2
        t0, t1 = (weight * y).sum(-1), (weight * y) @ x
        with np.errstate(divide="ignore", invalid="ignore"):
            det = s0 * s2 - s1**2
            offset, slope = (s2 * t0 - s1 * t1) / det, (s0 * t1 - s1 * t0) / det
            off = np.abs(y - offset[..., None] - slope[..., None] * x)
            sigma = 1.4826 * np.median(off, axis=-1, keepdims=True) + _LEAST_SIGMA_PX
            weight = (usable & (off < _ROBUST_SIGMAS * sigma)).astype(np.float64)
    enough = weight.sum(-1) >= 0.5 * x.size
    return np.where(enough, offset, np.nan), np.where(enough, slope, np.nan)


def _intersections(points: Array, normals: Array) -> Array:
    """Return corner k of each tag, (N, 4, 2): where edge k - 1 meets edge k."""
    p0, n0 = np.roll(points, 1, axis=1), np.roll(normals, 1, axis=1)
    c0, c1 = np.sum(n0 * p0, axis=-1), np.sum(normals * points, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        det = n0[..., 0] * normals[..., 1] - n0[..., 1] * normals[..., 0]
        u = (c0 * normals[..., 1] - c1 * n0[..., 1]) / det
        v = (n0[..., 0] * c1 - normals[..., 0] * c0) / det
    return np.stack([u, v], axis=-1)
