"""Corners of tags to a fraction of a pixel.

The image is brought back to linear light first: a lens's blur mixes light, so only there does the edge of a black
square lie half way between black and white; under a camera's tone curve white grows into black and tags shrink.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.errors import DetectError
from detect.wheels import Array

_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-3)
_MODULES = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerSettings:
    """How corners are refined.

    Attributes
    ----------
    window_modules
        Half the search window, in modules of the tag (beyond one it meets the tag's own bits).
    min_window_px, max_window_px
        Bounds on it.
    tone
        The camera's tone curve: ``srgb`` (IEC 61966-2-1) or ``linear``.
    """

    window_modules: float = 1.0
    min_window_px: int = 2
    max_window_px: int = 8
    tone: str = "srgb"

    def __post_init__(self) -> None:
        if self.tone not in {"srgb", "linear"}:
            raise DetectError(f"tone is {self.tone!r}, one of srgb, linear is needed")


def refine(image: NDArray[np.uint8], corners_px: Array, settings: CornerSettings) -> Array:
    """Return tags' corners, (N, 4, 2) px, refined from rough ones."""
    light = _linear_light(image, settings.tone)
    out = np.array(corners_px, dtype=np.float64)
    for k, rough in enumerate(np.asarray(corners_px, dtype=np.float32)):
        side = float(np.linalg.norm(rough - np.roll(rough, 1, axis=0), axis=1).min())
        half = round(settings.window_modules * side / _MODULES)
        half = min(max(half, settings.min_window_px), settings.max_window_px)
        fine = cv2.cornerSubPix(light, rough.reshape(-1, 1, 2).copy(), (half, half), (-1, -1), _STOP)
        out[k] = np.asarray(fine).reshape(4, 2)
    return out


def _linear_light(image: NDArray[np.uint8], tone: str) -> NDArray[np.float32]:
    grey = np.arange(256) / 255
    if tone == "srgb":
        grey = np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)
    return np.asarray(grey.astype(np.float32)[image])
