"""Tags aligned on shrunken copies of the image: few pixels each, and a catch of about a module."""

import cv2
import numpy as np

from detect.align.model import LOG_SIGMA, Frame
from detect.align.pattern import Array, Index, Patterns
from detect.align.solve import Aligned, align
from detect.align.verify import module_px

LEAST_MODULE_PX = 1.2
"""A copy is halved again while modules stay wider than this, px."""
STOP_PX = 0.15
SIDE_PX = 12.0
MAX_LEVEL = 6


class Pyramid:
    """An image and its copies of half, a quarter ... of the size, made when they are asked for."""

    def __init__(self, frame: Frame) -> None:
        self._levels = [frame]

    @property
    def frame(self) -> Frame:
        """The image itself."""
        return self._levels[0]

    def level(self, level: int) -> Frame:
        """Return the copy shrunk by ``2**level``."""
        while len(self._levels) <= level:
            last = self._levels[-1]
            height, width = (max(s // 2, 1) for s in last.grey.shape)
            even = np.ascontiguousarray(last.grey[: 2 * height, : 2 * width])
            grey = np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)
            lens = last.lens.copy()
            lens[:2] = (lens[:2] + 0.5) / 2 - 0.5
            lens[4] *= 2
            self._levels.append(Frame(grey=grey, tone=last.tone, lens=lens))
        return self._levels[level]


def align_coarsely(
    pyramid: Pyramid, patterns: Patterns, rows: Index, corners_px: Array, side_px: float = SIDE_PX
) -> Aligned:
    """Return tags (N,) aligned to about a tenth of a shrunken pixel, in their order; for the rest see :func:`align`."""
    module = np.maximum(np.nan_to_num(module_px(patterns, corners_px)), 1e-3)
    levels = np.clip(np.floor(np.log2(module / LEAST_MODULE_PX)), 0, MAX_LEVEL).astype(np.int64)
    parts, order = [], []
    for level in np.unique(levels) if len(levels) else [0]:
        at = np.flatnonzero(levels == level)
        factor = 2.0**level
        small = (corners_px[at] + 0.5) / factor - 0.5
        frame = pyramid.level(int(level))
        tags = align(frame, patterns, rows[at], small, stop_px=STOP_PX, side_px=side_px, covariance=False)
        parts.append(_enlarged(tags, factor))
        order.append(at)
    joined = parts[0]
    for part in parts[1:]:
        joined = joined.joined(part)
    return joined.take(np.argsort(np.concatenate(order)))


def _enlarged(tags: Aligned, factor: float) -> Aligned:
    """Return tags of a shrunken image as they stand in the whole one."""
    figures = {name: getattr(tags, name) for name in tags.__dataclass_fields__}
    theta, place = tags.theta.copy(), tags.place.copy()
    # the pixels' own share of the blur does not grow: a deviation of 0.29 px stays that at any size
    sigma = np.sqrt(np.maximum((tags.sigma_px**2 - 1 / 12) * factor**2, 0) + 1 / 12)
    theta[:, LOG_SIGMA] = np.log(sigma)
    place[:, :2] = (place[:, :2] + 0.5) * factor - 0.5
    place[:, 2] /= factor
    figures.update(
        corners_px=(tags.corners_px + 0.5) * factor - 0.5,
        cov_px2=tags.cov_px2 * factor**2,
        sigma_px=sigma,
        theta=theta,
        place=place,
    )
    return Aligned(**figures)
