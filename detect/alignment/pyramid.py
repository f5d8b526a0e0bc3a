"""Tags aligned on shrunken copies of the image: few pixels each, and a catch of about a module."""

import numpy as np

from boxcal.detect.alignment.radial_camera import PER_RADIUS
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.parameters import LOG_PSF
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.row_sets import distinct
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import module_px
from boxcal.detect.image.gray import Levels, halved
from boxcal.target.arrays import Array

LEAST_MODULE_PX = 2.4
"""A copy is halved again while modules stay wider than this, px."""
STOP_PX = 0.15
SIDE_PX = 12.0
MAX_LEVEL = 6


class Pyramid:
    """An image and its copies of half, a quarter ... of the size, made when they are asked for.

    Copies of an image of 8 bits have 8 bits too: rounding adds less than a third of a level to what is aligned roughly.

    Parameters
    ----------
    levels : (H, W)
        The image.
    response : (K,)
        The response curve under which tags are aligned, see :class:`Frame`.
    lens : (10,)
        The lens, see there.
    """

    def __init__(self, levels: Levels, response: Array, lens: Array) -> None:
        self._response, self._lens = response, lens
        self._copies: list[Levels] = [levels]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        height, width = self._copies[0].shape
        return width, height

    def under(self, lens: Array) -> "Pyramid":
        """Return the same images, taken through another lens."""
        other = Pyramid(self._copies[0], self._response, lens)
        other._copies = self._copies
        return other

    def copy(self, level: int) -> Levels:
        """Return the levels of the copy shrunk by ``2**level``; the image itself at level 0."""
        while len(self._copies) <= level:
            self._copies.append(halved(self._copies[-1]))
        return self._copies[level]

    def level(self, level: int) -> Frame:
        """Return the copy shrunk by ``2**level``."""
        lens = self._lens.copy()
        lens[:2] = (lens[:2] + 0.5) / 2**level - 0.5
        lens[PER_RADIUS] *= 2**level
        return Frame(grey=self.copy(level), response=self._response, lens=lens)


def align_coarsely(
    pyramid: Pyramid, patterns: Patterns, rows: Index, corners_px: Array, side_px: float = SIDE_PX
) -> TagAlignments:
    """Return tags (N,) aligned to about a tenth of a shrunken pixel, in their order; for the rest see :func:`align`."""
    levels = _levels(patterns, corners_px)
    parts, order = [], []
    for level in distinct(levels) if len(levels) else [0]:
        at = np.flatnonzero(levels == level)
        factor = 2.0**level
        small = (corners_px[at] + 0.5) / factor - 0.5
        tags = align(
            pyramid.level(int(level)),
            patterns,
            rows[at],
            small,
            stop_px=STOP_PX,
            side_px=side_px,
            covariance=False,
        )
        parts.append(_enlarged(tags, factor))
        order.append(at)
    return _in_order(parts, order)


def _levels(patterns: Patterns, corners_px: Array) -> Index:
    """Return how often to halve the image (N,) so that modules stay as wide."""
    module = module_px(patterns, corners_px)
    known = np.where(module > LEAST_MODULE_PX, module, LEAST_MODULE_PX)  # NaN: of corners that are none
    return np.minimum(np.log2(known / LEAST_MODULE_PX), MAX_LEVEL).astype(np.int64)


def _in_order(parts: list[TagAlignments], order: list[Index]) -> TagAlignments:
    joined = parts[0]
    for part in parts[1:]:
        joined = joined.joined(part)
    return joined if len(parts) == 1 else joined.take(np.argsort(np.concatenate(order)))


def _enlarged(tags: TagAlignments, factor: float) -> TagAlignments:
    """Return tags of an image as they stand in one that is larger by a factor."""
    figures = {name: getattr(tags, name) for name in tags.__dataclass_fields__}
    theta, normalisation = tags.theta.copy(), tags.normalisation.copy()
    # the pixels' own fraction of the blur does not grow: a deviation of 0.29 px stays that at any size
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
