"""Verification of aligned tags: the image must resemble the pattern everywhere, not only on the whole."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.backend import backend
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits that an aligned tag must keep to.

    Attributes
    ----------
    correlation
        Of the image with the aligned pattern, at least.
    worst_block
        Mean residual of two by two modules over the tag's contrast, at most: a finger, a glare.
    worst_module
        The same of one module: a wrong bit.
    contrast
        White less black, fraction of full scale, at least.
    psf_modules
        Deviation of the blur in modules, at most; beyond it, bits melt together.
    spread_modules
        Deviation of each corner in modules, at most.
    """

    correlation: float = 0.92
    worst_block: float = 0.22
    worst_module: float = 0.35
    contrast: float = 0.02
    psf_modules: float = 0.9
    spread_modules: float = 0.2

    def relaxed(self) -> "Limits":
        """Return what a tag must keep to before it is aligned on all its pixels under the right response curve."""
        return Limits(
            correlation=self.correlation - 0.05,
            worst_block=self.worst_block * 1.3,
            worst_module=self.worst_module * 1.5,
            contrast=self.contrast / 2,
            psf_modules=self.psf_modules * 1.2,
            spread_modules=self.spread_modules * 2,
        )


HOPELESS = 0.75
"""Mean residual of two by two modules, over the contrast, beyond which no light explains a tag."""


def doubtful_limits(limits: Limits) -> Limits:
    """Return what a tag must keep to that the box has there, but that a shadow's edge or a highlight may cross."""
    return replace(limits.relaxed(), worst_block=HOPELESS, worst_module=2.0, correlation=0.6)


def verified(patterns: Patterns, tags: TagAlignments, limits: Limits) -> NDArray[np.bool_]:
    """Return which aligned tags (N,) can be believed."""
    module = module_px(patterns, tags.corners_px)
    spread = np.sqrt(np.maximum((tags.cov_px2[..., 0, 0] + tags.cov_px2[..., 1, 1]).max(axis=1), 0))
    return np.asarray(
        (tags.correlation >= limits.correlation)
        & (tags.worst_block <= limits.worst_block)
        & (tags.worst_module <= limits.worst_module)
        & (tags.contrast >= limits.contrast)
        & (tags.psf_sigma_px <= limits.psf_modules * module)
        & (spread <= limits.spread_modules * module)
        & convex(tags.corners_px)
    )


def module_px(patterns: Patterns, corners_px: Array) -> Array:
    """Return how wide a module is seen, (N,) px: across the tag's shorter side."""
    return np.asarray(backend().widths(corners_px) / patterns.modules)


def convex(corners_px: Array) -> NDArray[np.bool_]:
    """Return which quadrilaterals (N, 4, 2) run clockwise as seen, without dents."""
    return np.asarray(backend().convex(corners_px))
