"""Tags that a box predicts beside those that were found: where, how certainly, and how large."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_pose import BoxFit
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.verification import convex, module_px
from boxcal.target.arrays import Array
from boxcal.target.box import Target

MIN_MODULE_PX = 0.75
"""Narrower modules are not searched for."""
MAX_SPREAD_MODULES = 0.6
"""Deviation of a predicted place beyond which a tag is not searched for."""
REGION_SPREADS, REGION_MODULES = 3.0, 8.0
"""Around where a tag is predicted: deviations of its place, and modules, to be searched too."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedTags:
    """Tags that the camera should see beside known ones.

    Attributes
    ----------
    rows : (N,)
    corners_px : (N, 4, 2), px
    spread_px : (N,), px
        How uncertain that is.
    module_px : (N,), px
        How wide their modules are seen.
    """

    rows: Index
    corners_px: Array
    spread_px: Array
    module_px: Array

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Whether each is predicted well enough to be searched for there."""
        return np.asarray(self.spread_px <= MAX_SPREAD_MODULES * self.module_px)

    def region_px(self, image_size: tuple[int, int]) -> Array:
        """Return first and last (x, y) of where they may be seen, (2, 2) px, within the image."""
        if len(self.rows) == 0:
            return np.zeros((2, 2))
        around = REGION_SPREADS * self.spread_px + REGION_MODULES * self.module_px
        low = (self.corners_px.min(axis=1) - around[:, None]).min(axis=0)
        high = (self.corners_px.max(axis=1) + around[:, None]).max(axis=0)
        return np.asarray(np.clip([low, high], 0, np.array(image_size) - 1))


def predicted(
    target: Target, patterns: Patterns, fit: BoxFit, known: Index, image_size: tuple[int, int]
) -> PredictedTags:
    """Return the tags that the camera should see beside the known ones."""
    turned = fit.faces_camera(target)
    turned[known] = False
    rows = np.flatnonzero(turned)
    if len(rows) == 0:
        none = np.zeros(0)
        return PredictedTags(rows=rows, corners_px=np.zeros((0, 4, 2)), spread_px=none, module_px=none)
    uv, spread = fit.predict(target.tag_corners[rows].reshape(-1, 3))
    uv, spread = uv.reshape(-1, 4, 2), spread.reshape(-1, 4).max(axis=1)
    module = module_px(patterns, uv)
    with np.errstate(invalid="ignore"):
        inside = np.all((uv >= -0.5) & (uv <= np.array(image_size) - 0.5), axis=(1, 2))
        inside &= (module >= MIN_MODULE_PX) & convex(uv)
    return PredictedTags(rows=rows[inside], corners_px=uv[inside], spread_px=spread[inside], module_px=module[inside])
