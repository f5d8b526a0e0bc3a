"""The camera model: pixels of points, with derivatives, and directions of pixels. All stages use this one."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.camera.distortion import DISTORTION_NAMES, CameraKind, distort
from boxcal.target.camera.undistort import undistort
from boxcal.target.errors import TargetError

__all__ = ["CameraKind", "CameraModel", "further_names", "project", "project_with_jacobians", "unproject"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraModel:
    """A camera: focal lengths, principal point and distortion; pixel (0, 0) is the centre of the top-left pixel.

    Attributes
    ----------
    fu, fv : px
        Focal lengths.
    cu, cv : px
        Principal point.
    kr
        First radial distortion coefficient: the paper's kr, OpenCV's k1.
    k2, p1, p2, k3, k4, k5, k6
        Further distortion coefficients under OpenCV's names; zero where the kind has none.
    kind
        Which of them count, and how.
    """

    fu: float
    fv: float
    cu: float
    cv: float
    kr: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    kind: CameraKind = CameraKind.RADIAL

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", CameraKind(self.kind))
        stray = [n for n in DISTORTION_NAMES[CameraKind.RATIONAL] if n not in self.names and getattr(self, n) != 0]
        if stray:
            raise TargetError(
                f"{', '.join(stray)} given",
                source="camera",
                needed=f"a {self.kind} model has {', '.join(self.names)}",
                remedy="name the kind that they belong to",
            )

    @classmethod
    def from_values(cls, kind: CameraKind, values: Array) -> Self:
        """Return the camera of an array (4 + n,): fu, fv, cu, cv and the kind's coefficients in OpenCV's order."""
        names = ("fu", "fv", "cu", "cv", *DISTORTION_NAMES[kind])
        return cls(kind=kind, **dict(zip(names, (float(v) for v in values), strict=True)))

    @classmethod
    def from_names(cls, kind: CameraKind, intrinsics: Mapping[str, float], further: Mapping[str, float]) -> Self:
        """Return the camera of fu, fv, cu, cv, kr and the further coefficients by name, whatever their order.

        Raises
        ------
        TargetError
            If a name is missing or does not belong to the kind.
        """
        given = {**intrinsics, **further}
        wanted = {"fu", "fv", "cu", "cv", *DISTORTION_NAMES[kind]}
        if set(given) != wanted:
            found = ", ".join(sorted(set(given) ^ wanted))
            raise TargetError(
                f"{found} missing or too much",
                source="camera",
                needed=f"a {kind} model has {', '.join(sorted(wanted))}",
            )
        return cls(kind=kind, **given)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the distortion coefficients in OpenCV's order, kr for its k1."""
        return DISTORTION_NAMES[self.kind]

    @property
    def distortion(self) -> tuple[float, ...]:
        """Distortion coefficients in OpenCV's order (``cv2.fisheye``'s for a fisheye)."""
        return tuple(getattr(self, name) for name in self.names)

    @property
    def further(self) -> dict[str, float]:
        """Distortion coefficients beyond kr, by name, in OpenCV's order."""
        return {name: getattr(self, name) for name in further_names(self.kind)}

    @property
    def values(self) -> Array:
        """Array of fu, fv, cu, cv and the distortion coefficients in OpenCV's order, (4 + n,)."""
        return np.array([self.fu, self.fv, self.cu, self.cv, *self.distortion])

    @property
    def K(self) -> Array:
        """The camera matrix, (3, 3)."""
        return np.array([[self.fu, 0.0, self.cu], [0.0, self.fv, self.cv], [0.0, 0.0, 1.0]])


def further_names(kind: CameraKind) -> tuple[str, ...]:
    """Return the names of the distortion coefficients after kr, in OpenCV's order."""
    return DISTORTION_NAMES[kind][1:]


def first_values(kind: CameraKind, radial: Array) -> Array:
    """Return where to start from the paper's model: (fu, fv, cu, cv, kr) -> (4 + coefficients,).

    The equidistant fisheye has ``rho (1 + kr rho^2) = theta (1 + k1 theta^2)``, to third order ``k1 = kr + 1/3``.
    """
    values = np.concatenate([radial[:5], np.zeros(len(further_names(kind)))])
    if kind is CameraKind.FISHEYE:
        values[4] += 1 / 3
    return values


def project(camera: CameraModel, p_cam: Array) -> Array:
    """Return the pixels of points; NaN where they do not lie in front of the camera.

    The paper's model is ``pu = fu (1 + kr rho2) xc/zc + cu``, ``pv`` likewise, ``rho2 = (xc/zc)^2 + (yc/zc)^2``
    (Antonelli et al. 2010, section 2.3, DOI 10.1007/s11370-010-0067-2).

    Parameters
    ----------
    camera
        Any kind.
    p_cam : (..., 3), m
        Points in frame ``cam``.

    Returns
    -------
    (..., 2), px
    """
    z = np.where(p_cam[..., 2] > 0, p_cam[..., 2], np.nan)
    x, y = p_cam[..., 0] / z, p_cam[..., 1] / z
    (xd, yd), _, _ = distort(camera.kind, np.array(camera.distortion), x, y)
    return np.stack([camera.fu * xd + camera.cu, camera.fv * yd + camera.cv], axis=-1)


def project_with_jacobians(kind: CameraKind, values: Array, p_cam: Array) -> tuple[Array, Array, Array]:
    """Return pixels of points and their derivatives, on arrays: what solvers call.

    Parameters
    ----------
    kind
        Of camera model.
    values : (n,)
        fu, fv, cu, cv and the kind's distortion coefficients in OpenCV's order.
    p_cam : (L, 3), m
        Points in front of the camera, frame ``cam``.

    Returns
    -------
    uv_px : (L, 2)
    d_values : (L, 2, n)
    d_point : (L, 2, 3), px/m
    """
    z = p_cam[:, 2]
    x, y = p_cam[:, 0] / z, p_cam[:, 1] / z
    (xd, yd), (xdx, xdy, ydx, ydy), dk = distort(kind, values[4:], x, y)
    fu, fv, cu, cv = values[:4]
    uv = np.stack([fu * xd + cu, fv * yd + cv], axis=1)
    d_values = np.zeros((len(z), 2, len(values)))
    d_values[:, 0, 0], d_values[:, 1, 1] = xd, yd
    d_values[:, 0, 2] = d_values[:, 1, 3] = 1.0
    for k, (kx, ky) in enumerate(dk):
        d_values[:, 0, 4 + k], d_values[:, 1, 4 + k] = fu * kx, fv * ky
    d_point = np.empty((len(z), 2, 3))
    for row, f, by_x, by_y in ((0, fu, xdx, xdy), (1, fv, ydx, ydy)):
        d_point[:, row, 0], d_point[:, row, 1] = f * by_x / z, f * by_y / z
        d_point[:, row, 2] = -f * (by_x * x + by_y * y) / z
    return uv, d_values, d_point


def unproject(camera: CameraModel, uv_px: Array) -> Array:
    """Return the normalised coordinates (xc/zc, yc/zc) of pixels: the inverse of :func:`project`.

    A pixel has an answer if a ray in front of the camera leads to it on which the distortion grows steadily from the
    axis outwards (no fold, no pole of a rational model before it). All others come back as NaN; what comes back is
    right to rounding.

    Parameters
    ----------
    camera
        Any kind.
    uv_px : (..., 2), px

    Returns
    -------
    (..., 2)
    """
    uv_px = np.asarray(uv_px, dtype=np.float64)
    xy_d = (uv_px - (camera.cu, camera.cv)) / (camera.fu, camera.fv)
    flat = xy_d.reshape(-1, 2)
    return undistort(camera.kind, np.array(camera.distortion), flat).reshape(uv_px.shape)
