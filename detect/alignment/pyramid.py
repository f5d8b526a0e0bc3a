"""Tags aligned on shrunken copies of the image: few pixels each, and a catch of about a module."""

from dataclasses import replace

import cv2
import numpy as np

from boxcal.detect.alignment.radial_camera import PER_RADIUS
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.parameters import LOG_PSF
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import module_px
from boxcal.target.arrays import Array

LEAST_MODULE_PX = 2.4
"""A copy is halved again while modules stay wider than this, px."""
STOP_PX = 0.15
SIDE_PX = 12.0
MAX_LEVEL = 6


class Pyramid:
    """An image and its copies of half, a quarter ... of the size, made when they are asked for."""

    def __init__(self, frame: Frame) -> None:
        self._frame, self._greys = frame, [frame.grey]

    @property
    def frame(self) -> Frame:
        """The image itself."""
        return self._frame

    def under(self, lens: Array) -> "Pyramid":
        """Return the same images, taken through another lens."""
        other = Pyramid(replace(self._frame, lens=lens))
        other._greys = self._greys
        return other

    def level(self, level: int) -> Frame:
        """Return the copy shrunk by ``2**level``."""
        while len(self._greys) <= level:
            last = self._greys[-1]
            height, width = (max(s // 2, 1) for s in last.shape)
            even = np.ascontiguousarray(last[: 2 * height, : 2 * width])
            grey = np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)
            self._greys.append(grey)
        lens = self._frame.lens.copy()
        lens[:2] = (lens[:2] + 0.5) / 2**level - 0.5
        lens[PER_RADIUS] *= 2**level
        return Frame(grey=self._greys[level], response=self._frame.response, lens=lens)


def align_coarsely(
    pyramid: Pyramid, patterns: Patterns, rows: Index, corners_px: Array, side_px: float = SIDE_PX
) -> TagAlignments:
    """Return tags (N,) aligned to about a tenth of a shrunken pixel, in their order; for the rest see :func:`align`."""
    levels = _levels(patterns, corners_px)
    parts, order = [], []
    for level in np.unique(levels) if len(levels) else [0]:
        at = np.flatnonzero(levels == level)
        frame, factor = pyramid.level(int(level)), 2.0**level
        small = (corners_px[at] + 0.5) / factor - 0.5
        tags = align(frame, patterns, rows[at], small, stop_px=STOP_PX, side_px=side_px, covariance=False)
        parts.append(_enlarged(tags, factor))
        order.append(at)
    return _in_order(parts, order)


def _levels(patterns: Patterns, corners_px: Array) -> Index:
    """Return how often to halve the image (N,) so that modules stay as wide."""
    module = np.maximum(np.nan_to_num(module_px(patterns, corners_px)), 1e-3)
    return np.clip(np.floor(np.log2(module / LEAST_MODULE_PX)), 0, MAX_LEVEL).astype(np.int64)


def _in_order(parts: list[TagAlignments], order: list[Index]) -> TagAlignments:
    joined = parts[0]
    for part in parts[1:]:
        joined = joined.joined(part)
    return joined if len(parts) == 1 else joined.take(np.argsort(np.concatenate(order)))


def _enlarged(tags: TagAlignments, factor: float) -> TagAlignments:
    """Return tags of an image as they stand in one that is larger by a factor."""
    figures = {name: getattr(tags, name) for name in tags.__dataclass_fields__}
    theta, normalisation = tags.theta.copy(), tags.normalisation.copy()
    # the pixels' own share of the blur does not grow: a deviation of 0.29 px stays that at any size
    sigma = np.sqrt(np.maximum((tags.psf_sigma_px**2 - 1 / 12) * factor**2, 0) + 1 / 12)
    theta[:, LOG_PSF] = np.log(sigma)
    normalisation[:, :2] = (normalisation[:, :2] + 0.5) * factor - 0.5
    normalisation[:, 2] /= factor
    figures.update(
        corners_px=(tags.corners_px + 0.5) * factor - 0.5,
        cov_px2=tags.cov_px2 * factor**2,
        psf_sigma_px=sigma,
        theta=theta,
        normalisation=normalisation,
    )
    return TagAlignments(**figures)
