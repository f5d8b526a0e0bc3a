"""Tags aligned with an image, as every later step takes them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array, Index


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TagAlignments:
    """Tags aligned with an image.

    Attributes
    ----------
    rows : (N,)
        Row of each tag in the patterns.
    corners_px : (N, 4, 2), px
        Corners in the image (distorted, as seen).
    cov_px2 : (N, 4, 2, 2), px^2
        Covariance of each corner from the residuals.
    psf_sigma_px : (N,), px
        Deviation of blur and pixel area together.
    black_level, contrast : (N,)
        Light of black modules, and white less black; 1 is full scale.
    correlation : (N,)
        Of the image with the aligned pattern.
    worst_block : (N,)
        Largest mean residual of a block of two by two modules, as a share of the contrast.
    worst_module : (N,)
        The same of a single module; 0 where modules have too few pixels to say.
    noise : (N,)
        Deviation of the residuals; 1 is full scale.
    theta : (N, 14)
        All parameters (see :mod:`boxcal.detect.alignment.registration.image_model`).
    normalisation : (N, 3)
        Their centres and scales.
    blocks : (N, M + 2, M + 2, 2)
        Sum of residuals and number of pixels in each module, white ring included.
    sandwich_sums : (N, 4)
        Of tags that were asked, by :func:`boxcal.detect.alignment.registration.sandwich_sums.sandwich_sums`; else NaN.
    block_sums : (N, 9, 5)
        Of the same tags, by :func:`boxcal.detect.alignment.registration.block_motion.block_sums`; else NaN.
    """

    rows: Index
    corners_px: Array
    cov_px2: Array
    psf_sigma_px: Array
    black_level: Array
    contrast: Array
    correlation: Array
    worst_block: Array
    worst_module: Array
    noise: Array
    theta: Array
    normalisation: Array
    blocks: Array
    sandwich_sums: Array
    block_sums: Array

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, at: NDArray[np.bool_] | Index) -> "TagAlignments":
        """Return some of the tags; these where it is all of them."""
        if at.dtype == np.bool_ and at.all():
            return self
        return TagAlignments(**{name: getattr(self, name)[at] for name in self.__dataclass_fields__})

    def joined(self, more: "TagAlignments") -> "TagAlignments":
        """Return these tags and others."""
        if len(more) == 0:
            return self
        return TagAlignments(
            **{name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in self.__dataclass_fields__}
        )
