"""The rays of a camera's pixels, kept from frame to frame."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from boxcal.target.arrays import Index, Mask, Reals
from boxcal.target.camera.camera_model import CameraModel, unproject
from boxcal.target.camera.distortion import distort

_TAME = 0.02
"""Pixels where the distortion compresses a direction to less than this fraction are left dark: next to a fold."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rays:
    """Directions of all pixels of a camera, row by row.

    Attributes
    ----------
    directions : (3, H * W)
        (xc/zc, yc/zc, 1), undistorted.
    slopes : (4, H * W), 1/px
        dx/du, dx/dv, dy/du, dy/dv of the directions.
    reach : (H * W,)
        An upper bound of how far the direction moves over one pixel.
    dark : (H * W,) or None
        Pixels that no ray reaches (beyond a fold of the distortion), if there are any.
    """

    directions: Reals
    slopes: Reals
    reach: Reals
    dark: Mask | None


@lru_cache(maxsize=8)
def pixel_rays(camera: CameraModel, width: int, height: int) -> Rays:
    """Return the rays of all pixels of an image."""
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    x, y = unproject(camera, np.stack([u.ravel(), v.ravel()], axis=1)).T
    unseen = np.isnan(x)
    x, y = np.where(unseen, 0.0, x), np.where(unseen, 0.0, y)
    _, (a, b, c, d), _ = distort(camera.kind, np.array(camera.distortion), x, y)
    det = a * d - b * c
    largest = np.sqrt(
        (a * a + b * b + c * c + d * d + np.hypot(a * a + b * b - c * c - d * d, 2 * (a * c + b * d))) / 2
    )
    least = det / largest
    dark = unseen | ~(least > _TAME)
    det = np.where(dark, 1.0, det)
    slopes = np.stack([d / camera.fu, -b / camera.fv, -c / camera.fu, a / camera.fv]) / det
    directions = np.ones((3, width * height), dtype=np.float32)
    directions[:2] = np.where(dark, 0, np.stack([x, y]))
    reach = 1 / (min(camera.fu, camera.fv) * np.where(dark, 1, least))
    return Rays(
        directions=directions,
        slopes=slopes.astype(np.float32),
        reach=reach.astype(np.float32),
        dark=dark if dark.any() else None,
    )


def rays_at(rays: Rays, at: Index) -> tuple[Reals, Reals]:
    """Return directions (3, N) and slopes (4, N) of some pixels."""
    return rays.directions[:, at], rays.slopes[:, at]
