"""Levenberg-Marquardt fit of a rigid box; :mod:`boxcal.detect.alignment.numba.box_refinement` takes the same steps.

Residuals are taken on the chart about each seen corner (:mod:`boxcal.detect.alignment.radial_camera`), which is that
pixel's tangent: exact where they vanish, and of a pinhole everywhere.
"""

import cv2
import numpy as np

from boxcal.detect.alignment.radial_camera import (
    A1,
    A2,
    A3,
    CENTRE_X,
    CENTRE_Y,
    LOG_ASPECT,
    P1,
    P2,
    PER_RADIUS,
    RADIAL,
    SKEW,
    depth,
    distorted,
    square,
    tangential,
    to_pixels,
)
from boxcal.target.arrays import Array

ITERATIONS, MORE_ITERATIONS = 14, 60
CAMERA = 10
"""Log f, centre (2), a1, a2, a3, log aspect, skew and two tangential terms stand before the pose."""
FITTED = [CENTRE_X, CENTRE_Y, A1, A2, A3, LOG_ASPECT, SKEW, P1, P2]
"""Which entries of a lens are fitted."""
LEAST_DEPTH = 0.02
"""All points of a start lie before the camera by so much, m over the focal length in px."""
RANGE = (-0.5, 1.5)
"""Of a1, a2 and a3; of the logarithm of the aspect, the skew and the tangential terms its limit in both directions."""
State = tuple[float, Array, Array]
"""Focal length, px, lens (6,) and T_cam_box (4, 4)."""


def levenberg_marquardt(  # noqa: PLR0917 - as the compiled one
    p_box: Array, uv: Array, start: State, prior: Array, expected: Array, sigma_px: float, fair: float
) -> tuple[float, Array, Array, Array, Array]:
    """Return focal length, lens, T_cam_box, information (16, 16) and deviations (P,), px, by reweighted squares."""
    focal, lens, T = start
    T = bring_forward(focal, lens, T, p_box, uv)
    kept = focal, lens.copy(), T
    full = np.zeros(CAMERA + 6)
    full[:CAMERA] = prior
    damping, cost = 1e-4, np.inf
    information, gradient = np.eye(CAMERA + 6), np.zeros(CAMERA + 6)
    off = np.zeros(len(uv))
    for iteration in range(MORE_ITERATIONS):
        if iteration >= ITERATIONS and np.median(off) < fair:
            break
        p_cam = p_box @ T[:3, :3].T + T[:3, 3]
        tangent = Tangent(focal, lens, p_cam, uv)
        r = tangent.off
        now_off = np.hypot(r[0], r[1])
        scale = 3 * max(sigma_px, 1.2 * float(np.median(now_off)))
        camera = np.array([np.log(focal), *lens[FITTED]])
        now = float(np.sum(scale**2 * np.log1p((now_off / scale) ** 2)) + prior @ (camera - expected) ** 2)
        if not now <= cost * (1 + 1e-9) + 1e-12 or not tangent.before.all():
            damping *= 10
            if damping > 1e6:
                break
        else:
            done = cost - now < 1e-3 * now + 1e-9
            kept, cost, off = (focal, lens.copy(), T.copy()), now, now_off
            weight = 1 / (1 + (now_off / scale) ** 2)
            J = tangent.jacobian()
            weighted = (J * weight).reshape(len(J), -1)
            information = weighted @ J.reshape(len(J), -1).T + np.diag(full)
            gradient = weighted @ r.ravel()
            gradient[:CAMERA] -= prior * (camera - expected)
            damping = max(damping * 0.2, 1e-9)
            if done:
                break
        step = np.linalg.solve(information + damping * np.diag(np.diag(information) + 1e-9), gradient)
        focal, lens, T = moved_by(kept, np.clip(step, -1e3, 1e3))
    return *kept, information, off


def moved_by(state: State, step: Array) -> State:
    """Return the state after a step (16,): the pose turned and moved from the left, the focal length by its log."""
    focal, lens, T = state
    lens = lens.copy()
    lens[FITTED] += step[1:CAMERA]
    lens[RADIAL] = np.clip(lens[RADIAL], *RANGE)
    lens[FITTED[5:]] = np.clip(lens[FITTED[5:]], RANGE[0], -RANGE[0])
    dT = np.eye(4)
    dT[:3, :3] = cv2.Rodrigues(np.clip(step[CAMERA : CAMERA + 3], -0.5, 0.5))[0]
    moved = dT @ T
    moved[:3, 3] += step[CAMERA + 3 :]
    return float(focal * np.exp(np.clip(step[0], -0.4, 0.4))), lens, np.asarray(moved)


class Tangent:
    """Points of the camera on the chart about the pixel where each is seen, or ought to be.

    Attributes
    ----------
    seen : (2, P), px
        Where they lie there, from the lens's centre; the pixel itself where they are seen exactly there.
    off : (2, P), px
        The pixels less these places, both as a camera with square pixels and without tangential terms has them.
    before : (P,)
        Whether they lie before the chart.
    """

    def __init__(self, focal: float, lens: Array, p_cam: Array, uv: Array) -> None:
        self._raw, self._skew, self._aspect = uv - lens[:2], float(lens[SKEW]), float(np.exp(lens[LOG_ASPECT]))
        self._squared = square(lens, self._raw)
        self._d = np.ascontiguousarray((self._squared + tangential(lens, self._squared)).T)
        self._p = np.ascontiguousarray(p_cam.T)
        self._focal, self._per_px2 = focal, float(lens[PER_RADIUS]) ** 2
        self._q = (self._d[0] ** 2 + self._d[1] ** 2) * self._per_px2
        _, slope, self._D = depth(lens, self._q)
        self._across = np.empty((3, len(uv)))
        self._across[:2], self._across[2] = -slope / self._D * self._d, 1 / (focal * self._D)
        w = (self._across * self._p).sum(axis=0)
        self.before = w > 1e-6 / focal
        self._per_w = 1 / np.where(np.abs(w) > 1e-6 / focal, w, 1e-6 / focal)
        self.seen = self._p[:2] * self._per_w
        self.off = self._d - self.seen

    def jacobian(self) -> Array:
        """Return how ``-off`` moves with the 16 unknowns, (16, 2, P) px."""
        p, q, seen = self._p, self._q, self.seen
        J = np.zeros((CAMERA + 6, 2, len(q)))
        along = seen / self._D
        np.multiply(along, p[2] * self._per_w / self._focal, out=J[0])
        J[1, 0], J[2, 0], J[2, 1] = 1, -self._skew, self._aspect
        # of a term a q^k: slope and D change by -2 k q^(k-1) / radius^2 and (2 k - 1) q^k
        toward = (2 * self._per_px2) * (self._d[0] * seen[0] + self._d[1] * seen[1])
        J[3] = along * (q - toward)
        J[4] = along * (q * (3 * q - 2 * toward))
        J[5] = along * (q * q * (5 * q - 3 * toward))
        x, y = self._squared.T
        J[6, 1] = -y
        J[7, 0] = self._raw[:, 1]
        per_px = np.sqrt(self._per_px2)
        J[8, 0], J[8, 1] = -2 * per_px * x * y, -per_px * (x * x + 3 * y * y)
        J[9, 0], J[9, 1] = -per_px * (3 * x * x + y * y), -2 * per_px * x * y
        moved = J[CAMERA + 3 :]
        np.multiply((-self._per_w * self._across)[:, None], seen, out=moved)
        moved[0, 0] += self._per_w
        moved[1, 1] += self._per_w
        # turned: dp = turn x p
        J[CAMERA] = p[1] * moved[2] - p[2] * moved[1]
        J[CAMERA + 1] = p[2] * moved[0] - p[0] * moved[2]
        J[CAMERA + 2] = p[0] * moved[1] - p[1] * moved[0]
        return J


def predict(
    p_box: Array, focal: float, lens: Array, T_cam_box: Array, information: Array | None
) -> tuple[Array, Array]:
    """Return where points (P, 3) are seen, (P, 2) px, and their deviations (P,) where the fit's is 1 px.

    Without ``information`` there are no deviations, (0,).
    """
    p_cam = p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
    uv = to_pixels(lens, p_cam * (1, 1, 1 / focal))
    before = np.isfinite(uv[:, 0])
    uv = lens[:2] + distorted(lens, uv - lens[:2])
    if information is None:
        uv[~before] = np.nan
        return uv, np.empty(0)
    p_cam[~before], uv[~before] = (0, 0, 1), lens[:2]
    J = Tangent(focal, lens, p_cam, uv).jacobian()
    half = np.linalg.solve(np.linalg.cholesky(information), J.reshape(len(J), -1))
    spread = np.sqrt((half**2).sum(axis=0).reshape(2, -1).sum(axis=0))
    uv[~before] = np.nan
    return uv, np.where(before, spread, np.inf)


def bring_forward(focal: float, lens: Array, T_cam_box: Array, p_box: Array, uv: Array) -> Array:
    """Return the pose of a box with all points before the camera: its start took them to be on one plane."""
    d = uv - lens[:2]
    g, slope, D = depth(lens, np.sum(d * d, axis=1) * lens[PER_RADIUS] ** 2)
    rays = np.column_stack([d, focal * g])
    away = np.mean(rays / np.linalg.norm(rays, axis=1, keepdims=True), axis=0)
    across = np.column_stack([-focal * slope[:, None] * d, np.ones(len(d))]) / D[:, None]
    short = LEAST_DEPTH - np.sum(across * (p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]), axis=1)
    moved = T_cam_box.copy()
    moved[:3, 3] += away * max(0.0, float((short / np.maximum(across @ away, 1e-3)).max()))
    return moved
