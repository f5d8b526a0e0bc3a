"""One rigid box before a camera of unknown calibration: where its tags must be, and how surely.

The camera here is a means to predict tags, never a result: focal length, principal point, two radial coefficients and
pose, each held by a weak prior, fitted robustly to the corners of one image. What the corners do not determine (the
focal length, from one face seen head-on) the covariance says, and so does that of every predicted corner.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.align.homography import least_squares_homography
from detect.align.model import bend, straighten
from detect.align.pattern import Array, Index
from target.box import Target

ITERATIONS = 14
FOCAL_LENGTHS = (1.1, 0.6, 2.2)
"""Where fits start, image widths."""
LEAST_SIGMA_PX = 0.05
LEAST_DEPTH = 0.02
_PRIORS = np.array([0.7, 0.05, 0.05, 0.15, 0.05])
"""Deviations of log f, centre (image widths), a1 and a2."""
_CAMERA = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxFit:
    """A box before a roughly known camera.

    Attributes
    ----------
    focal_px : px
    lens : (5,)
        See :class:`detect.align.model.Frame`.
    T_cam_box : (4, 4), m
    information : (11, 11)
        Of log f, centre px, a1, a2 and the pose (left perturbation, rotation then translation), by px of residual.
    sigma_px : px
        Robust deviation of the corners from the fit.
    off_px : (N,)
        Largest deviation of each tag's corners.
    """

    focal_px: float
    lens: Array
    T_cam_box: Array
    information: Array
    sigma_px: float
    off_px: Array

    def predict(self, p_box: Array) -> tuple[Array, Array]:
        """Return where points (P, 3) are seen, (P, 2) px, and how uncertain that is, (P,) px; NaN behind the camera."""
        p_cam = p_box @ self.T_cam_box[:3, :3].T + self.T_cam_box[:3, 3]
        before = p_cam[:, 2] > 1e-6
        p_cam[~before] = (0, 0, 1)
        straight = self.focal_px * p_cam[:, :2] / p_cam[:, 2:] + self.lens[:2]
        uv = bend(self.lens, straight)
        J = _jacobian(self.focal_px, self.lens, p_cam, uv)
        half = np.linalg.solve(np.linalg.cholesky(self.information), J.reshape(-1, J.shape[2]).T)
        sd = self.sigma_px * np.sqrt((half**2).sum(axis=0).reshape(-1, 2).sum(axis=1))
        uv[~before] = np.nan
        return uv, np.where(before, sd, np.inf)

    def faces_camera(self, corners_box: Array) -> NDArray[np.bool_]:
        """Return which tags (T, 4, 3) turn their printed side to the camera."""
        centre = -self.T_cam_box[:3, :3].T @ self.T_cam_box[:3, 3]
        down, right = corners_box[:, 3] - corners_box[:, 0], corners_box[:, 1] - corners_box[:, 0]
        outward = np.cross(down, right)
        return np.asarray(np.einsum("ti,ti->t", outward, centre - corners_box.mean(axis=1)) > 0)


def fit_box(
    target: Target,
    rows: Index,
    corners_px: Array,
    *,
    image_size: tuple[int, int],
    sigma_px: float,
    start: BoxFit | None = None,
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
    """
    if start is not None:
        state = (start.focal_px, start.lens, start.T_cam_box)
        return _refine(target, rows, corners_px, image_size=image_size, sigma_px=sigma_px, start=state)
    faces, counts = np.unique(target.tag_faces[rows], return_counts=True)
    main = target.tag_faces[rows] == faces[counts.argmax()]
    fits = []
    # seen from one side a box fits several focal lengths: they compete, those of ordinary cameras first
    for focal in FOCAL_LENGTHS:
        first = _start(target, rows[main], corners_px[main], image_size, focal * max(image_size))
        fits.append(_refine(target, rows, corners_px, image_size=image_size, sigma_px=sigma_px, start=first))
        if np.median(fits[-1].off_px) < 3 * sigma_px:
            break
    return min(fits, key=lambda fit: float(np.median(fit.off_px)))


def _start(
    target: Target, rows: Index, corners_px: Array, image_size: tuple[int, int], focal: float
) -> tuple[float, Array, Array]:
    face = int(target.tag_faces[rows[0]])
    T_box_face = target.T_box_face(face)
    p_face = (target.tag_corners[rows].reshape(-1, 3) - T_box_face[:3, 3]) @ T_box_face[:3, :3]
    centre = np.array([(image_size[0] - 1) / 2, (image_size[1] - 1) / 2])
    H = least_squares_homography(p_face[:, :2], (corners_px.reshape(-1, 2) - centre) / focal)
    H = H / np.linalg.norm(H[:, :2], axis=0).mean()
    if H[2, 2] < 0:
        H = -H
    u, _, vt = np.linalg.svd(np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])]))
    R = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    T_cam_face = np.eye(4)
    T_cam_face[:3, :3], T_cam_face[:3, 3] = R, H[:, 2]
    lens = np.array([*centre, 0.0, 0.0, 2 / max(image_size)])
    return focal, lens, T_cam_face @ np.linalg.inv(T_box_face)


def _refine(
    target: Target,
    rows: Index,
    corners_px: Array,
    *,
    image_size: tuple[int, int],
    sigma_px: float,
    start: tuple[float, Array, Array],
) -> BoxFit:
    """Levenberg-Marquardt on reweighted squares; the residuals are those of undistorted corners."""
    focal, lens, T = start[0], start[1].copy(), start[2].copy()
    p_box, uv = target.tag_corners[rows].reshape(-1, 3), corners_px.reshape(-1, 2)
    # a start from tags that are not on one plane may have corners behind the camera
    T[2, 3] += max(0.0, LEAST_DEPTH - float((p_box @ T[2, :3] + T[2, 3]).min()))
    reference = np.array([np.log(1.1 * max(image_size)), (image_size[0] - 1) / 2, (image_size[1] - 1) / 2, 0, 0])
    prior = np.zeros(_CAMERA + 6)
    prior[:_CAMERA] = (sigma_px / (_PRIORS * (1, max(image_size), max(image_size), 1, 1))) ** 2
    damping, cost = 1e-4, np.inf
    kept = (focal, lens, T)
    information, gradient = np.eye(_CAMERA + 6), np.zeros(_CAMERA + 6)
    off = np.zeros(len(uv))
    for _ in range(ITERATIONS):
        p_cam = p_box @ T[:3, :3].T + T[:3, 3]
        p_cam[:, 2] = np.where(np.abs(p_cam[:, 2]) > 1e-6, p_cam[:, 2], 1e-6)
        r = straighten(lens, uv) - (focal * p_cam[:, :2] / p_cam[:, 2:] + lens[:2])
        now_off = np.linalg.norm(r, axis=1)
        scale = 3 * max(sigma_px, 1.2 * float(np.median(now_off)))
        camera = np.array([np.log(focal), *lens[:4]])
        now = float(np.sum(scale**2 * np.log1p((now_off / scale) ** 2)) + prior[:_CAMERA] @ (camera - reference) ** 2)
        if not now <= cost * (1 + 1e-9) + 1e-12 or not np.all(p_cam[:, 2] > 0):
            damping *= 10
            if damping > 1e6:
                break
        else:
            done = cost - now < 1e-3 * now + 1e-9
            kept, cost, off = (focal, lens.copy(), T.copy()), now, now_off
            weight = np.repeat(1 / (1 + (now_off / scale) ** 2), 2)
            J = _jacobian(focal, lens, p_cam, uv).reshape(len(uv) * 2, -1)
            information = (J * weight[:, None]).T @ J + np.diag(prior)
            gradient = J.T @ (weight * r.ravel())
            gradient[:_CAMERA] -= prior[:_CAMERA] * (camera - reference)
            damping = max(damping * 0.2, 1e-9)
            if done:
                break
        step = np.linalg.solve(information + damping * np.diag(np.diag(information) + 1e-9), gradient)
        focal, lens, T = _moved(kept, np.clip(step, -1e3, 1e3))
    focal, lens, T = kept
    return BoxFit(
        focal_px=focal,
        lens=lens,
        T_cam_box=T,
        information=information + 1e-12 * np.diag(np.diag(information)),
        sigma_px=max(LEAST_SIGMA_PX, sigma_px, 1.2 * float(np.median(off))),
        off_px=off.reshape(-1, 4).max(axis=1),
    )


def _moved(state: tuple[float, Array, Array], step: Array) -> tuple[float, Array, Array]:
    focal, lens, T = state
    lens = lens.copy()
    lens[:4] += step[1:5]
    lens[2:4] = np.clip(lens[2:4], -0.5, 1.0)
    dT = np.eye(4)
    dT[:3, :3] = cv2.Rodrigues(np.clip(step[5:8], -0.5, 0.5))[0]
    moved = dT @ T
    moved[:3, 3] += step[8:11]
    return float(focal * np.exp(np.clip(step[0], -0.4, 0.4))), lens, np.asarray(moved)


def _jacobian(focal: float, lens: Array, p_cam: Array, uv: Array) -> Array:
    """Return how the residual's prediction moves with the 11 unknowns, (P, 2, 11) px."""
    d = uv - lens[:2]
    q = np.sum(d * d, axis=1, keepdims=True) * lens[4] ** 2
    depth = focal / p_cam[:, 2]
    x, y = p_cam[:, 0] / p_cam[:, 2], p_cam[:, 1] / p_cam[:, 2]
    J = np.zeros((len(uv), 2, _CAMERA + 6))
    J[:, 0, 0], J[:, 1, 0] = focal * x, focal * y
    J[:, 0, 1] = J[:, 1, 2] = 1
    J[:, :, 3], J[:, :, 4] = -d * q, -d * q * q
    # d(x, y) of a turned and moved point: [[-xy, 1 + xx, -y], [-1 - yy, xy, x]] and [[1, 0, -x], [0, 1, -y]] / z
    J[:, 0, 5], J[:, 0, 6], J[:, 0, 7] = -focal * x * y, focal * (1 + x * x), -focal * y
    J[:, 1, 5], J[:, 1, 6], J[:, 1, 7] = -focal * (1 + y * y), focal * x * y, focal * x
    J[:, 0, 8] = J[:, 1, 9] = depth
    J[:, 0, 10], J[:, 1, 10] = -depth * x, -depth * y
    return J
