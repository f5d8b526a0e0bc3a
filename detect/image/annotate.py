"""An image with its tags drawn in: outlines, the first corner, ids, and corners' uncertainty enlarged."""

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError

if TYPE_CHECKING:
    from boxcal.detect.alignment.detection import DetectorOutput

_LEAST_WIDTH_PX = 1200
_ELLIPSE = 100.0
"""How much larger than life one sigma of a corner is drawn."""
_EDGE, _FIRST, _TEXT = (60, 200, 0), (0, 0, 255), (255, 80, 0)


def drawn_png(image: NDArray[np.generic], tags: "DetectorOutput") -> bytes:
    """Return a PNG of an image (H, W) or (H, W, 3), enlarged if it is small, with its tags drawn in."""
    scale = max(1, round(_LEAST_WIDTH_PX / image.shape[1]))
    canvas = _colour(image)
    if scale > 1:
        canvas = np.asarray(cv2.resize(canvas, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST))
    for tag, corners, covs in zip(tags.ids, tags.corners_px, tags.cov_px2, strict=True):
        places = (corners + 0.5) * scale - 0.5
        cv2.polylines(canvas, [np.round(places * 16).astype(np.int32)], True, _EDGE, 1, cv2.LINE_AA, 4)
        cv2.circle(canvas, _sixteenths(places[0]), 3 * 16, _FIRST, -1, cv2.LINE_AA, 4)
        for place, cov in zip(places, covs, strict=True):
            _ellipse(canvas, place, cov * (_ELLIPSE * scale) ** 2)
        size = float(np.clip(np.linalg.norm(places[1] - places[0]) / 60, 0.3, 2.0))
        centre = places.mean(axis=0)
        where = (int(centre[0] - 9 * size * len(str(tag))), int(centre[1] + 9 * size))
        cv2.putText(canvas, str(tag), where, cv2.FONT_HERSHEY_SIMPLEX, size, _TEXT, max(1, round(size)), cv2.LINE_AA)
    done, data = cv2.imencode(".png", canvas)
    if not done:
        raise DetectError(f"a picture of shape {canvas.shape}: cannot be encoded as PNG")
    return bytes(data.tobytes())


def _colour(image: NDArray[np.generic]) -> Any:
    levels = image.astype(np.float64)
    if image.dtype != np.uint8:
        top = float(np.quantile(levels, 0.999)) or 1.0
        levels = np.clip(levels * (255 / top), 0, 255)
    grey = levels.astype(np.uint8)
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR) if grey.ndim == 2 else np.ascontiguousarray(grey[..., :3])


def _ellipse(canvas: Any, centre: NDArray[np.float64], cov: NDArray[np.float64]) -> None:
    values, vectors = np.linalg.eigh(cov)
    long, short = np.sqrt(np.clip(values[::-1], 0.25, 1e6))
    angle = float(np.rad2deg(np.arctan2(vectors[1, 1], vectors[0, 1])))
    axes = (round(float(long) * 16), round(float(short) * 16))
    cv2.ellipse(canvas, _sixteenths(centre), axes, angle, 0, 360, _TEXT, 1, cv2.LINE_AA, 4)


def _sixteenths(place: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(place[0]) * 16), round(float(place[1]) * 16)
