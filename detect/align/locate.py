"""Find the tags of a target in an image, their corners at the noise limit: the steps in their order."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.align.coarse import Pyramid, align_coarsely
from detect.align.fast import SIGMA_PX, preview
from detect.align.guided import (
    RIGID_TOLERANCE_MODULES,
    RIGID_TOLERANCE_PX,
    consistent_seeds,
    follow,
    plan,
)
from detect.align.lens import straight_lens
from detect.align.model import KURTOSIS, Frame
from detect.align.pattern import Array, Index, Patterns, target_patterns
from detect.align.rigid import LEAST_SIGMA_PX, BoxFit, fit_box
from detect.align.seeds import Seeds, find_seeds
from detect.align.solve import Aligned, align
from detect.align.tone import TONES, Taking, Tone, probe, relit, tone_table
from detect.align.verify import Limits, module_px, verified
from detect.errors import DetectError
from target.box import Target

MODEL_ERROR_PX = 0.003
"""Deviation per axis of what the model leaves out (lens, print, pixel response); no residual shows it."""
NOISE_SHARE = 0.8
"""Of the residuals' variance: the rest is misfit that alternates within a tag and hardly moves a corner. Chosen so that
normalised errors have a deviation near 1 under the conditions of benchmarks/detector.py."""
SYSTEMATIC_PX, SYSTEMATIC_PX2 = 0.033, 0.38
"""Of tags of any width, and times the inverse of the width."""
MAX_SIDE_PX = 16_384
FEW_TAGS = 4
STOP_PX = 0.03
LARGE_MODULE_PX = 10.0
"""Where modules are wider than this, the lens bends a tag enough to be fitted once more."""
FINE_SIDE_PX = 22.0
"""Tags twice as large are aligned on every second pixel both ways, and so on."""
LEAST_SIDE_PX = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class LocateSettings:
    """How tags are located.

    Attributes
    ----------
    tone
        The camera's tone curve: ``linear``, ``srgb``, or ``auto`` to tell it from the tags.
    fast
        Preview: only tags that stand out, their edges fitted with lines; ``auto`` then means ``linear``.
    limits
        What an aligned tag must keep to.
    windows_px
        Neighbourhoods that tell dark from bright: the first one always, the others where it finds few tags.
    """

    tone: Tone = "auto"
    fast: bool = False
    limits: Limits = field(default_factory=Limits)
    windows_px: tuple[int, ...] = (25, 9)

    def __post_init__(self) -> None:
        if self.tone not in TONES:
            raise DetectError(f"tone is {self.tone!r}, one of {', '.join(TONES)} is needed")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Located:
    """Tags located in one image.

    Attributes
    ----------
    ids : (N,)
        Ascending, each once.
    corners_px : (N, 4, 2), px
        Top-left, top-right, bottom-right, bottom-left as the tag is drawn; pixel (0, 0) is the centre of the top-left
        pixel.
    cov_px2 : (N, 4, 2, 2), px^2
        Covariance of each corner: noise as the residuals have it, and the model's own error.
    correlation : (N,)
        Of the picture with the aligned pattern; NaN in a preview.
    blur_px : (N,), px
        Deviation of blur and pixel area together; NaN in a preview.
    tone
        The tone curve that was used.
    """

    ids: Index
    corners_px: Array
    cov_px2: Array
    correlation: Array
    blur_px: Array
    tone: str

    @property
    def systematic_px(self) -> Array:
        """Deviation per axis (N,), px, of what is the same in every picture of a tag from one place.

        Measured on path-traced sRGB JPEG logs against their truth (docs/detector.md); rendered views show a tenth.
        """
        a, b = self.corners_px[:, 2] - self.corners_px[:, 0], self.corners_px[:, 3] - self.corners_px[:, 1]
        area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        longest = np.linalg.norm(self.corners_px - np.roll(self.corners_px, -1, axis=1), axis=2).max(axis=1, initial=0)
        width = np.maximum(area / np.maximum(longest, 1e-9), 1.0)
        return np.asarray(np.hypot(SYSTEMATIC_PX, SYSTEMATIC_PX2 / width))


def locate_tags(image: NDArray[np.generic], target: Target, settings: LocateSettings | None = None) -> Located:
    """Return the target's tags in an image.

    Every tag is used that lies wholly in the image, on a face turned to the camera, wide enough to be read (about six
    pixels across); tags that are covered, glared, mirrored, out of place on the rigid box, or seen twice are not.

    Parameters
    ----------
    image : (H, W) or (H, W, 3)
        Grey or BGR; uint8, uint16 (full scale 65535; see :func:`to_grey` for 10 and 12 bits) or float (full scale 1).
    target
        The box to look for.
    settings
        The defaults if None.

    Raises
    ------
    DetectError
        If that is no image.
    """
    settings = settings or LocateSettings()
    grey, grey8 = to_grey(image)
    patterns = target_patterns(target)
    if settings.fast:
        tone = "srgb" if settings.tone == "srgb" else "linear"
        return _previewed(patterns, *preview(grey8, target, tone, settings.windows_px[0]), tone)
    size = (grey.shape[1], grey.shape[0])
    seeds = search_seeds(grey8, patterns, settings, lambda found: consistent_seeds(target, found, size))
    if len(seeds) == 0:
        return _located(patterns, _none(patterns), "linear" if settings.tone == "auto" else settings.tone)
    search = plan(target, patterns, seeds, size)
    frame = Frame(grey=grey, tone=tone_table("linear"), lens=search.fit.lens)
    tags, fit = follow(Pyramid(frame), target, patterns, search, settings.limits)
    taking = probe(frame, patterns, tags, settings.tone)
    tags = _finely(frame, fit.lens, patterns, tags, taking)
    tags = tags.take(verified(patterns, tags, settings.limits))
    if len(tags) and module_px(patterns, tags.corners_px).max() > LARGE_MODULE_PX:
        fit = fit_box(target, tags.rows, tags.corners_px, image_size=size, sigma_px=LEAST_SIGMA_PX, start=fit)
        again = Frame(grey=grey, tone=tone_table(taking.tone), lens=fit.lens)
        tags = align(again, patterns, tags.rows, tags.corners_px, start=tags, side_px=FINE_SIDE_PX, stop_px=STOP_PX)
    return _located(patterns, _on_the_box(target, patterns, tags, fit), taking.tone)


def locate_copies(image: NDArray[np.generic], patterns: Patterns, settings: LocateSettings | None = None) -> Located:
    """Return every sighting of some tags in an image, whatever they are stuck on; an id may come back several times.

    There is no box to predict from, so only tags are found that stand out by themselves; nor a sheet that is known to
    be flat and evenly lit, so the limits are relaxed. Arguments and errors as for
    :func:`locate_tags`.
    """
    settings = settings or LocateSettings()
    limits = settings.limits.relaxed()
    grey, grey8 = to_grey(image)
    seeds = search_seeds(grey8, patterns, settings)
    frame = Frame(grey=grey, tone=tone_table("linear"), lens=straight_lens((grey.shape[1], grey.shape[0])))
    tags = align_coarsely(Pyramid(frame), patterns, seeds.rows, seeds.corners_px)
    tags = tags.take(verified(patterns, tags, limits.relaxed()))
    taking = probe(frame, patterns, tags, settings.tone)
    tags = _finely(frame, frame.lens, patterns, tags, taking)
    return _located(patterns, tags.take(verified(patterns, tags, limits)), taking.tone)


def _finely(frame: Frame, lens: Array, patterns: Patterns, tags: Aligned, taking: Taking) -> Aligned:
    """Return tags, aligned coarsely on a frame, aligned on its pixels under the right lens and tone curve."""
    table = tone_table(taking.tone)
    changed = table is not frame.tone
    start = relit(tags, frame.tone, table) if changed else tags
    start.theta[:, KURTOSIS] = taking.kurtosis
    return align(
        Frame(grey=frame.grey, tone=table, lens=lens),
        patterns,
        tags.rows,
        tags.corners_px,
        start=start,
        relight=changed,
        side_px=FINE_SIDE_PX,
        stop_px=STOP_PX,
    )


def to_grey(image: NDArray[np.generic], bits: int | None = None) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return an image as grey levels 0..1 (H, W) and in 8 bits; ``bits`` is what full scale of uint16 has (16)."""
    if image.ndim not in {2, 3} or (image.ndim == 3 and image.shape[2] not in {1, 3, 4}):
        raise DetectError(f"an image of shape {image.shape}: (H, W) or (H, W, 3) is needed; convert it first")
    if not all(LEAST_SIDE_PX <= s <= MAX_SIDE_PX for s in image.shape[:2]):
        raise DetectError(f"an image of {image.shape[1]} x {image.shape[0]} px: 8 to {MAX_SIDE_PX} a side are needed")
    scale = {"uint8": 255.0, "uint16": 2.0 ** (bits or 16) - 1, "float32": 1.0, "float64": 1.0}.get(image.dtype.name)
    if scale is None:
        raise DetectError(f"an image of type {image.dtype}: uint8, uint16 or float is needed; convert it first")
    if image.ndim == 3:
        shrunk = image[..., 0] if image.shape[2] == 1 else None
        plain = image.astype(np.float32) if image.dtype == np.float64 else image
        image = shrunk if shrunk is not None else _luma(plain)
    grey = np.multiply(image, np.float32(1 / scale), dtype=np.float32)
    if image.dtype == np.uint8:
        return grey, np.ascontiguousarray(image, dtype=np.uint8)
    if not np.isfinite(grey).all():
        raise DetectError("an image with values that are not finite: numbers from 0 to 1 are needed; convert it first")
    low, high = np.quantile(grey[::4, ::4], (0.001, 0.999))
    stretched = (grey - low) * np.float32(255 / max(float(high - low), 1e-6))
    return grey, np.asarray(np.clip(stretched, 0, 255), dtype=np.uint8)


def _luma(image: Any) -> NDArray[np.generic]:
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY))


def search_seeds(
    grey8: NDArray[np.uint8],
    patterns: Patterns,
    settings: LocateSettings,
    believed: Callable[[Seeds], Seeds] | None = None,
) -> Seeds:
    """Return seeds that are believed: from the first window, and, if few, from the others and from twice the size.

    Without ``believed`` all count, and everywhere is searched.
    """
    first, *others = settings.windows_px
    if believed is not None:
        seeds = believed(find_seeds(grey8, patterns, (first,)))
        if len(seeds) >= FEW_TAGS:
            return seeds
    found = find_seeds(grey8, patterns, (first, *others))
    seeds = found if believed is None else believed(found)
    if (believed is not None and len(seeds) >= FEW_TAGS) or grey8.size > 4_000_000:
        return seeds
    found = found.merged(find_seeds(grey8, patterns, (first, *others), scale=2.0))
    return found if believed is None else believed(found)


def _on_the_box(target: Target, patterns: Patterns, tags: Aligned, fit: BoxFit) -> Aligned:
    """Return the tags that lie on the rigid box."""
    uv, _ = fit.predict(target.tag_corners[tags.rows].reshape(-1, 3))
    off = np.linalg.norm(uv.reshape(-1, 4, 2) - tags.corners_px, axis=2).max(axis=1)
    return tags.take(off <= RIGID_TOLERANCE_MODULES * module_px(patterns, tags.corners_px) + RIGID_TOLERANCE_PX)


def _previewed(patterns: Patterns, rows: Index, corners_px: Array, tone: str) -> Located:
    order = np.argsort(patterns.tag_ids[rows], kind="stable")
    return Located(
        ids=patterns.tag_ids[rows[order]],
        corners_px=corners_px[order],
        cov_px2=np.broadcast_to(SIGMA_PX**2 * np.eye(2), (len(rows), 4, 2, 2)).copy(),
        correlation=np.full(len(rows), np.nan),
        blur_px=np.full(len(rows), np.nan),
        tone=tone,
    )


def _none(patterns: Patterns) -> Aligned:
    rows = np.zeros(0, dtype=np.int64)
    frame = Frame(grey=np.zeros((8, 8), np.float32), tone=tone_table("linear"), lens=straight_lens((8, 8)))
    return align(frame, patterns, rows, np.zeros((0, 4, 2)))


def _located(patterns: Patterns, tags: Aligned, tone: str) -> Located:
    order = np.argsort(patterns.tag_ids[tags.rows], kind="stable")
    tags = tags.take(order)
    return Located(
        ids=patterns.tag_ids[tags.rows],
        corners_px=tags.corners_px,
        cov_px2=NOISE_SHARE * tags.cov_px2 + MODEL_ERROR_PX**2 * np.eye(2),
        correlation=tags.correlation,
        blur_px=tags.sigma_px,
        tone=tone,
    )
