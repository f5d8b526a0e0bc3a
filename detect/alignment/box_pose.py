"""One rigid box before a camera of unknown calibration: where its tags must be, with covariances.

The camera here is a means to predict tags, never a result: focal length, principal point, three coefficients of the
lens and pose, each held by a weak prior, fitted robustly to the corners of one image. What the corners do not determine
(the focal length, from one face seen head-on) the covariance says, and so does that of every predicted corner.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.backend import backend
from boxcal.detect.alignment.box_refinement import CAMERA, FITTED
from boxcal.detect.alignment.radial_camera import (
    A1,
    P1,
    fisheye_distortion,
    local_undistortion,
    no_distortion,
    undistort_locally,
)
from boxcal.detect.alignment.tag_patterns import Index
from boxcal.detect.image.order_statistics import median
from boxcal.target.arrays import Array
from boxcal.target.box import Target

GOOD, FAIR = 2.2, 5.0
"""Median deviations, in sigmas: of a first fit, to end the competition; of a later one, to need no more iterations."""
PLAIN = 0.05
"""Where a1 is larger, all cameras compete, and again if a later fit is not good."""
FOCAL_LENGTHS = (1.1, 0.6, 2.2)
"""Where fits start, image widths."""
FISHEYES = (0.32, 0.45)
"""Focal lengths of the fisheyes that are tried where no ordinary camera explains the tags, image widths."""
LEAST_SIGMA_PX = 0.05
_ALONG = 1e-18
_PRIORS = np.array([0.7, 0.05, 0.05, 0.15, 0.05, 0.02, 0.03, 0.003, 0.003, 0.003])
"""Deviations of log f, centre (image widths), a1 to a3, log aspect, skew and tangential terms of an unknown camera."""
_TANGENTIAL = 0.001
"""The largest deviation of tangential terms where corners are aligned. Lenses have some thousandths, which such corners
show clearly. With a weaker prior these terms take up what the radial ones leave of a fisheye seen from one side, and
curve its tags' charts: corners err a tenth more."""
_LEAST_PRIORS = np.array([0.003, 0.003, 0.003, 0.003, 0.001, 0.0005, 0.001, 0.001, 0.001, 0.001])
"""The same of a camera that took an earlier image: as well as from that image, and no better."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPrior:
    """Prior knowledge of a camera before its image is searched.

    Attributes
    ----------
    focal_px : px
    lens : (10,)
        See :mod:`boxcal.detect.alignment.radial_camera`.
    deviation : (10,)
        Of log f, centre px, a1, a2, a3, log aspect, skew and two tangential terms.
    """

    focal_px: float
    lens: Array
    deviation: Array

    @property
    def expected(self) -> Array:
        """Log f and what of the lens is fitted, (10,)."""
        return np.array([np.log(self.focal_px), *self.lens[FITTED]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxFit:
    """A box before a roughly known camera.

    Attributes
    ----------
    focal_px : px
    lens : (10,)
        See :mod:`boxcal.detect.alignment.radial_camera`.
    T_cam_box : (4, 4), m
    prior
        What was known of the camera before any tag was seen.
    information : (16, 16)
        Of those ten and the pose (left perturbation, rotation then translation), by px of residual.
    sigma_px : px
        Robust deviation of the corners from the fit.
    off_px : (N,)
        Largest deviation of each tag's corners.
    """

    focal_px: float
    lens: Array
    T_cam_box: Array
    prior: CameraPrior
    information: Array
    sigma_px: float
    off_px: Array

    def predict(self, p_box: Array) -> tuple[Array, Array]:
        """Return where points (P, 3) are seen, (P, 2) px, and how uncertain that is, (P,) px; NaN where out of view."""
        uv, spread = backend().predict(p_box, self.focal_px, self.lens, self.T_cam_box, self.information)
        return uv, self.sigma_px * spread

    def places(self, p_box: Array) -> Array:
        """Return where points (P, 3) are seen, (P, 2) px; NaN where out of view."""
        uv: Array = backend().predict(p_box, self.focal_px, self.lens, self.T_cam_box, None)[0]
        return uv

    def camera(self, width: int) -> CameraPrior:
        """Return what this image, ``width`` px wide, determines of the camera, for the next image that it takes."""
        deviation = 3 * self.sigma_px * np.sqrt(np.diag(np.linalg.inv(self.information))[:CAMERA])
        scale = _widths(width)
        return CameraPrior(
            focal_px=self.focal_px,
            lens=self.lens,
            deviation=np.clip(deviation, _LEAST_PRIORS * scale, _PRIORS * scale),
        )

    def faces_camera(self, target: Target) -> NDArray[np.bool_]:
        """Return which of all tags (T,) turn their printed side to the camera."""
        normal, offset = _planes(target)
        return np.asarray(normal @ (-self.T_cam_box[:3, :3].T @ self.T_cam_box[:3, 3]) > offset)


@lru_cache(maxsize=16)
def _planes(target: Target) -> tuple[Array, Array]:
    """Return outward normals (T, 3) of tags, not of unit length, and how far along them their centres lie (T,)."""
    corners = target.tag_corners
    normal = np.cross(corners[:, 3] - corners[:, 0], corners[:, 1] - corners[:, 0])
    return normal, np.sum(normal * corners.mean(axis=1), axis=1)


def fit_box(
    target: Target,
    rows: Index,
    corners_px: Array,
    *,
    image_size: tuple[int, int],
    sigma_px: float,
    start: BoxFit | None = None,
    camera: CameraPrior | None = None,
) -> BoxFit:
    """Fit box and camera to tags' corners.

    Parameters
    ----------
    target, rows
        Which tags (N,), by their row in the target's table; N >= 1.
    corners_px : (N, 4, 2), px
    image_size
        (width, height), px.
    sigma_px
        How well the corners are known; a tag that is off by much more loses its weight (Cauchy).
    start
        A fit to much the same tags.
    camera
        The camera, if it is known from other images; others compete only where it does not explain the tags.
    """
    refine = partial(_refine, target, rows, corners_px, sigma_px=sigma_px)
    if start is not None:
        prior = _of_aligned(start.prior) if sigma_px <= LEAST_SIGMA_PX else start.prior
        fit = refine(start.focal_px, start.lens, start.T_cam_box, prior=prior, fair=FAIR * sigma_px)
        if median(fit.off_px) < FAIR * sigma_px or abs(fit.lens[A1]) < PLAIN:
            return fit
    faces = target.tag_faces[rows]
    main = faces == np.bincount(faces).argmax()
    fits = [] if start is None else [fit]
    # seen from one side a box fits several focal lengths: they compete, those of ordinary cameras first
    for focal, lens, prior in _cameras(image_size, camera):
        T = _start(target, rows[main], corners_px[main], lens, focal)
        fits.append(refine(focal, lens, T, prior=prior))
        if median(fits[-1].off_px) < GOOD * sigma_px and (prior is camera or abs(fits[-1].lens[A1]) < PLAIN):
            break
    return min(fits, key=lambda fit: median(fit.off_px))


def _of_aligned(prior: CameraPrior) -> CameraPrior:
    """Return the prior for corners that are aligned."""
    deviation, first = prior.deviation.copy(), 1 + FITTED.index(P1)
    if deviation[first] <= _TANGENTIAL:
        return prior
    deviation[first:] = np.minimum(deviation[first:], _TANGENTIAL)
    return replace(prior, deviation=deviation)


def unknown_deviation(image_size: tuple[int, int]) -> Array:
    """Return the standard deviations (10,) of a camera of which nothing is known, as :class:`CameraPrior` has them."""
    return np.asarray(_PRIORS * _widths(max(image_size)))


def _widths(width: int) -> Array:
    scale = np.ones(CAMERA)
    scale[1:3] = width
    return scale


def _cameras(image_size: tuple[int, int], known: CameraPrior | None) -> Iterator[tuple[float, Array, CameraPrior]]:
    """Yield focal length and lens to start from, and the prior, of the cameras that may have taken an image."""
    if known is not None:
        yield known.focal_px, known.lens, known
    width, straight = max(image_size), no_distortion(image_size)
    deviation = unknown_deviation(image_size)
    usual = CameraPrior(focal_px=1.1 * width, lens=straight, deviation=deviation)
    for focal in FOCAL_LENGTHS:
        yield focal * width, straight, usual
    for focal in FISHEYES:
        lens = fisheye_distortion(image_size, focal * width)
        yield focal * width, lens, CameraPrior(focal_px=focal * width, lens=lens, deviation=deviation)


def _start(target: Target, rows: Index, corners_px: Array, lens: Array, focal: float) -> Array:
    """Return the pose (4, 4) that tags of one face have before a camera."""
    face = int(target.tag_faces[rows[0]])
    T_box_face = target.T_box_face(face)
    p_face = (target.tag_corners[rows].reshape(-1, 3) - T_box_face[:3, 3]) @ T_box_face[:3, :3]
    uv = corners_px.reshape(-1, 2)
    # on the chart about their middle they are a homography; from there to rays is linear
    normalisation = np.array([[*uv.mean(axis=0), 1.0]])
    b, D = local_undistortion(lens, normalisation[0, :2])
    normalised = undistort_locally(lens, normalisation, uv[None])[0] + normalisation[0, :2] - lens[:2]
    rays = np.array([[1 / focal, 0, 0], [0, 1 / focal, 0], [*b, D]])
    H = rays @ backend().least_squares_homography(p_face[:, :2], normalised)
    first, second, _ = H.T
    H = H * (2 / (np.sqrt(first @ first) + np.sqrt(second @ second)))
    middle = np.array([*(normalisation[0, :2] - lens[:2]), focal * float(b @ (normalisation[0, :2] - lens[:2]) + D)])
    if H @ [*p_face[:, :2].mean(axis=0), 1] @ middle < 0:
        H = -H
    T_cam_box = np.eye(4)
    R = _nearest_rotation(H[:, 0], H[:, 1]) @ T_box_face[:3, :3].T
    T_cam_box[:3, :3], T_cam_box[:3, 3] = R, H[:, 2] - R @ T_box_face[:3, 3]
    return T_cam_box


def _nearest_rotation(x: Array, y: Array) -> Array:
    """Return the rotation (3, 3) whose first columns are equally near to the directions of two vectors (3,)."""
    x, y = x / np.sqrt(x @ x), y / np.sqrt(y @ y)
    between, apart = x + y, x - y
    if apart @ apart < _ALONG:
        apart = x[[1, 2, 0]] - x[[2, 0, 1]]
    elif between @ between < _ALONG:
        between = x[[1, 2, 0]] - x[[2, 0, 1]]
    between, apart = between / np.sqrt(between @ between), apart / np.sqrt(apart @ apart)
    R = np.empty((3, 3))
    R[:, 0], R[:, 1] = np.sqrt(0.5) * (between + apart), np.sqrt(0.5) * (between - apart)
    (a, b, c), (d, e, f) = R[:, 0], R[:, 1]
    R[:, 2] = b * f - c * e, c * d - a * f, a * e - b * d
    return R


def _refine(  # noqa: PLR0917 - the state by position
    target: Target,
    rows: Index,
    corners_px: Array,
    focal: float,
    lens: Array,
    T_cam_box: Array,
    *,
    sigma_px: float,
    prior: CameraPrior,
    fair: float = np.inf,
) -> BoxFit:
    """Return the fit from a start; longer where the median deviation stays above ``fair``, px."""
    p_box, uv = target.tag_corners[rows].reshape(-1, 3), corners_px.reshape(-1, 2)
    weight = (sigma_px / prior.deviation) ** 2
    focal, lens, T, information, off = backend().levenberg_marquardt(
        p_box, uv, (focal, lens, T_cam_box), weight, prior.expected, sigma_px, fair
    )
    information.flat[:: len(information) + 1] *= 1 + 1e-12  # invertible
    return BoxFit(
        focal_px=focal,
        lens=lens,
        T_cam_box=T,
        prior=prior,
        information=information,
        sigma_px=max(LEAST_SIGMA_PX, sigma_px, 1.2 * median(off)),
        off_px=off.reshape(-1, 4).max(axis=1),
    )
