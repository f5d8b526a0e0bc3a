"""The camera model: a pinhole with one radial distortion coefficient."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Intrinsics:
    """A camera's intrinsic parameters; pixel (0, 0) is the centre of the top-left pixel.

    Attributes
    ----------
    fu, fv : px
        Focal lengths.
    cu, cv : px
        Principal point.
    kr
        Radial distortion (OpenCV's k1, its other coefficients zero), in normalised coordinates.
    """

    fu: float
    fv: float
    cu: float
    cv: float
    kr: float

    @property
    def K(self) -> Array:
        """The camera matrix, (3, 3)."""
        return np.array([[self.fu, 0.0, self.cu], [0.0, self.fv, self.cv], [0.0, 0.0, 1.0]])


def project(camera: Intrinsics, p_cam: Array) -> Array:
    """Return the pixels of points in front of the camera.

    ``pu = fu (1 + kr rho2) xc/zc + cu``, ``pv`` likewise, ``rho2 = (xc/zc)^2 + (yc/zc)^2``
    (Antonelli et al. 2010, section 2.3, DOI 10.1007/s11370-010-0067-2).

    Parameters
    ----------
    camera
        Intrinsics.
    p_cam : (..., 3), m
        Points in frame ``cam``; points with zc <= 0 give meaningless pixels and are the caller's to leave out.

    Returns
    -------
    (..., 2), px
    """
    xy = p_cam[..., :2] / p_cam[..., 2:3]
    rho2 = np.sum(xy**2, axis=-1, keepdims=True)
    return np.asarray((1 + camera.kr * rho2) * xy * (camera.fu, camera.fv) + (camera.cu, camera.cv))


def normalise(camera: Intrinsics, uv_px: Array) -> Array:
    """Return the undistorted normalised coordinates (xc/zc, yc/zc) of pixels: the inverse of :func:`project`.

    The radius is found by Newton's method on ``rho (1 + kr rho^2) = rho_d``. With kr < 0 that has a solution only
    up to ``rho = 1/sqrt(-3 kr)``; pixels beyond it were seen by no ray and come back as NaN.

    Parameters
    ----------
    camera
        Intrinsics.
    uv_px : (..., 2), px

    Returns
    -------
    (..., 2)
    """
    xy_d = (uv_px - (camera.cu, camera.cv)) / (camera.fu, camera.fv)
    rho_d = np.linalg.norm(xy_d, axis=-1, keepdims=True)
    rho = rho_d.copy()
    if camera.kr < 0:
        limit = 1 / np.sqrt(-3 * camera.kr)
        rho = np.minimum(rho, 0.999 * limit)
        rho_d = np.where(rho_d <= limit * 2 / 3, rho_d, np.nan)
    for _ in range(50):
        step = (rho * (1 + camera.kr * rho**2) - rho_d) / (1 + 3 * camera.kr * rho**2)
        rho = rho - step
        if camera.kr < 0:
            rho = np.minimum(rho, limit)
        if not np.any(np.abs(step) > 1e-15 * (1 + np.abs(rho))):
            break
    scale = np.where(rho_d == 0, 1.0, rho / np.where(rho_d == 0, 1.0, rho_d))
    return np.asarray(xy_d * scale)
