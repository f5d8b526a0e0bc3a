"""Images of every kind as grey levels: from 0 to 1 to measure in, and in 8 bits to look for tags."""

from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bayer import alternation, even_mosaic, unnamed_mosaic
from boxcal.detect.image.interlaced import averaged_fields

LEAST_SIDE_PX, MAX_SIDE_PX = 8, 16_384
Levels = NDArray[np.float32] | NDArray[np.uint8]
"""Grey levels (H, W), 1 at full scale, or those of an image of 8 bits as they are."""


def to_grey(image: NDArray[np.generic], bits: int | None = None) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return an image as grey levels 0..1 (H, W) and in 8 bits; ``bits`` is what full scale of uint16 has (16)."""
    grey, grey8 = to_levels(image, bits)
    return from_levels(grey), grey8


def to_levels(image: NDArray[np.generic], bits: int | None = None) -> tuple[Levels, NDArray[np.uint8]]:
    """Return an image's grey levels, and in 8 bits, as :func:`to_grey`, but those of 8 bits as they are.

    Of a large image it takes long to make others of them all, and tags fill a part of it.
    """
    single, full = _single(image, bits)
    if single.dtype == np.uint8:
        grey8 = np.require(single, np.uint8, ["C", "W"])  # as compiled code takes it
        return grey8, grey8
    grey = np.multiply(single, np.float32(1 / full), dtype=np.float32)
    return grey, _eight_bits(grey)


def from_levels(levels: Levels) -> NDArray[np.float32]:
    """Return grey levels 0..1."""
    if levels.dtype == np.uint8:
        return np.multiply(levels, np.float32(1 / 255), dtype=np.float32)
    return np.asarray(levels, dtype=np.float32)


def halved(levels: Levels) -> Levels:
    """Return grey levels of half the size each way, means of four pixels; an odd last row or column is left out."""
    height, width = (max(side // 2, 1) for side in levels.shape)
    even = levels[: 2 * height, : 2 * width]
    return cast("Levels", cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA))


def to_grey8(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Return an image as grey levels in 8 bits (H, W), as :func:`to_grey` does."""
    return to_levels(image)[1]


def eight_bit_copy(levels: NDArray[np.float32], full: float) -> NDArray[np.uint8]:
    """Return grey levels (H, W) of images of 8 bits (``full`` 255) rounded, others stretched to 8 bits."""
    if full == 255:
        return np.asarray(cv2.convertScaleAbs(levels), dtype=np.uint8)
    return _eight_bits(np.multiply(levels, np.float32(1 / full), dtype=np.float32))


def _single(image: NDArray[np.generic], bits: int | None) -> tuple[NDArray[Any], float]:
    """Return the one channel (H, W) of an image, and its full scale.

    Colour is mixed to grey, a mosaic evened out, the fields of an interlaced image averaged.
    """
    if image.ndim not in {2, 3} or (image.ndim == 3 and image.shape[2] not in {1, 3, 4}):
        raise DetectError(f"an image of shape {image.shape}: (H, W) or (H, W, 3) is needed; convert it first")
    if not all(LEAST_SIDE_PX <= s <= MAX_SIDE_PX for s in image.shape[:2]):
        raise DetectError(f"an image of {image.shape[1]} x {image.shape[0]} px: 8 to {MAX_SIDE_PX} a side are needed")
    full = {"uint8": 255.0, "uint16": 2.0 ** (bits or 16) - 1, "float32": 1.0, "float64": 1.0}.get(image.dtype.name)
    if full is None:
        raise DetectError(f"an image of type {image.dtype}: uint8, uint16 or float is needed; convert it first")
    if image.ndim == 2:
        single: NDArray[Any] = image
    elif image.shape[2] == 1:
        single = image[..., 0]
    else:
        single = _luma(image.astype(np.float32) if image.dtype == np.float64 else image)
    alternates = alternation(single)
    name = unnamed_mosaic(image, alternates) if image.ndim == 2 else None
    if name is not None:
        return even_mosaic(image, name), full
    return (averaged_fields(single) if alternates == (False, True) else single), full


def _eight_bits(grey: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return grey levels 0..1 in 8 bits, stretched to what there is of black and white."""
    if not np.isfinite(grey).all():
        raise DetectError("an image with values that are not finite: numbers from 0 to 1 are needed; convert it first")
    low, high = np.quantile(grey[::4, ::4], (0.001, 0.999))
    stretched = (grey - low) * np.float32(255 / max(float(high - low), 1e-6))
    return np.asarray(np.clip(stretched, 0, 255), dtype=np.uint8)


def _luma(image: Any) -> NDArray[np.generic]:
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY))
