"""The rays of a camera's pixels, kept from frame to frame."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Index, Reals
from boxcal.target.camera.camera_model import CameraModel, unproject

_TAME = 0.02
"""Pixels where the radial distortion stretches by more than 1 / _TAME are left dark."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rays:
    """Directions of all pixels of a camera, row by row.

    Attributes
    ----------
    camera
        Whose rays.
    directions : (3, H * W)
        (xc/zc, yc/zc, 1), undistorted.
    reach : (H * W,)
        An upper bound of how far the direction moves over one pixel.
    dark : (H * W,) or None
        Pixels that no ray reaches (beyond the limit of a negative kr), if there are any.
    """

    camera: CameraModel
    directions: Reals
    reach: Reals
    dark: NDArray[np.bool_] | None

    def jacobian(self, at: Index) -> tuple[Reals, Reals, Reals, Reals]:
        """Return dx/du, dx/dv, dy/du, dy/dv of pixels' directions (x, y, 1), each (N,), 1/px.

        The inverse of the distortion's Jacobian ``(1 + kr rho2) I + 2 kr (x, y)^T (x, y)``, by Sherman and Morrison.
        """
        x, y = self.directions[0].take(at), self.directions[1].take(at)
        kr = np.float32(self.camera.kr)
        rho2 = x * x + y * y
        m = 1 + kr * rho2
        k = 2 * kr / (m * (m + 2 * kr * rho2))
        m = 1 / m
        fu, fv = np.float32(1 / self.camera.fu), np.float32(1 / self.camera.fv)
        mixed = -k * x * y
        return (m - k * x * x) * fu, mixed * fv, mixed * fu, (m - k * y * y) * fv


@lru_cache(maxsize=4)
def pixel_rays(camera: CameraModel, width: int, height: int) -> Rays:
    """Return the rays of all pixels of an image."""
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    xy = unproject(camera, np.stack([u.ravel(), v.ravel()], axis=1)).T
    rho2 = np.sum(xy * xy, axis=0)
    least = np.minimum(1 + camera.kr * rho2, 1 + 3 * camera.kr * rho2)
    dark = ~(least > _TAME)
    directions = np.ones((3, width * height), dtype=np.float32)
    directions[:2] = np.where(dark, 0, xy)
    reach = 1 / (min(camera.fu, camera.fv) * np.where(dark, 1, least))
    return Rays(camera=camera, directions=directions, reach=reach.astype(np.float32), dark=dark if dark.any() else None)
