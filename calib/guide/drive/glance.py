"""A quick look at the newest image: which tags, how large, how sharp, how bright, and where the camera is."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.calib.geometry.so3_se3 import inverse, rigid
from boxcal.detect.image.bit_depth import DeepGrey, eight_bits
from boxcal.detect.tags.detections import TagSettings, find_tags
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraModel, unproject

MOST_SIDE_PX = 1280
"""Larger images are made smaller before tags are looked for."""
SHOWN_SIDE_PX = 800
_JPEG_QUALITY = 72
_LEAST_TAGS = 2
_MARGIN = 0.15
_QUICK = TagSettings(accurate=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Glance:
    """One image, looked at quickly.

    Attributes
    ----------
    t_ns : ns
        Its stamp.
    size : px
        Width and height of the camera's image.
    corners : (N, 4, 2)
        The tags' corners in fractions of width and height.
    faces
        Numbers of the box's faces that are seen.
    side_px : px
        Median side of a tag; 0 without one.
    edge_px : px
        Width of the tags' black edges, median; 2 is as sharp as pixels are. NaN without a tag.
    black, white
        Grey levels (0 to 255) of the tags' black and white; of the whole image's darkest and brightest without a tag.
    T_box_cam : (4, 4), m, optional
        The camera's pose.
    jpeg
        The image made smaller, to be shown.
    """

    t_ns: int
    size: tuple[int, int]
    corners: Array
    faces: tuple[int, ...]
    side_px: float
    edge_px: float
    black: float
    white: float
    T_box_cam: Array | None
    jpeg: bytes


def glance(image: DeepGrey, t_ns: int, target: Target, camera: CameraModel | None) -> Glance:
    """Return what a grey image (H, W) shows at a glance.

    Parameters
    ----------
    image
        The camera's image.
    t_ns : ns
        Its stamp.
    target
        The box.
    camera
        The camera as known so far; without it no pose is given.
    """
    grey = eight_bits(image)
    height, width = grey.shape
    scale = min(1.0, MOST_SIDE_PX / max(width, height))
    small = grey if scale == 1 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    tags = find_tags(np.asarray(small), target, _QUICK)
    uv_px = (tags.corners_px + 0.5) / scale - 0.5
    sides = np.linalg.norm(uv_px - np.roll(uv_px, -1, axis=1), axis=2)
    looks = np.array([_look(grey, uv) for uv in uv_px]).reshape(-1, 3)
    dark, bright = np.percentile(small[::4, ::4], (5, 95))
    black, white, edge = np.median(looks, axis=0) if len(looks) else (dark, bright, np.nan)
    faces = target.faces(4 * tags.ids) if tags.ids.size else np.zeros(0, dtype=np.int64)
    return Glance(
        t_ns=t_ns,
        size=(width, height),
        corners=(uv_px + 0.5) / (width, height),
        faces=tuple(int(f) for f in np.unique(faces)),
        side_px=float(np.median(sides)) if sides.size else 0.0,
        edge_px=float(edge),
        black=float(black),
        white=float(white),
        T_box_cam=_pose(tags.ids, uv_px, target, camera) if camera is not None else None,
        jpeg=_shown(grey),
    )


def _look(grey: NDArray[np.uint8], uv_px: Array) -> tuple[float, float, float]:
    """Return a tag's black, its white, and the width of its edges, px: contrast over the steepest slopes."""
    low = np.maximum(np.floor(uv_px.min(axis=0) - _MARGIN * np.ptp(uv_px, axis=0)), 0).astype(int)
    high = np.ceil(uv_px.max(axis=0) + _MARGIN * np.ptp(uv_px, axis=0)).astype(int) + 1
    part = grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    if min(part.shape) < 4:
        return 0.0, 255.0, float("nan")
    black, white = np.percentile(part, (10, 90))
    slope = np.hypot((part[1:-1, 2:] - part[1:-1, :-2]) / 2, (part[2:, 1:-1] - part[:-2, 1:-1]) / 2)
    steep = float(np.percentile(slope, 97))
    return float(black), float(white), float((white - black) / max(steep, 1e-3))


def _pose(ids: Ids, uv_px: Array, target: Target, camera: CameraModel) -> Array | None:
    """Return the camera's pose in the box's frame from the tags' corners, None if they do not determine it."""
    if len(ids) < _LEAST_TAGS:
        return None
    p_box = target.p_box((4 * ids[:, None] + np.arange(4)).ravel())
    xy = unproject(camera, uv_px.reshape(-1, 2))
    good = np.all(np.isfinite(xy), axis=1)
    if np.count_nonzero(good) < 4 * _LEAST_TAGS:
        return None
    done, rotation, t = cv2.solvePnP(p_box[good], xy[good], np.eye(3), np.zeros(0), flags=cv2.SOLVEPNP_SQPNP)
    if not done or not np.all(np.isfinite(t)):
        return None
    return np.asarray(
        inverse(rigid(np.asarray(cv2.Rodrigues(rotation)[0], dtype=np.float64), np.ravel(t).astype(float)))
    )


def _shown(grey: NDArray[np.uint8]) -> bytes:
    scale = min(1.0, SHOWN_SIDE_PX / max(grey.shape))
    small = grey if scale == 1 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return bytes(data.tobytes())
