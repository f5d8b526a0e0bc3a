"""Levenberg-Marquardt fit of a rigid box; :mod:`boxcal.detect.alignment.numba.box_refinement` takes the same steps.

Residuals are taken on the chart about each seen corner (:mod:`boxcal.detect.alignment.radial_camera`), which is that
pixel's tangent: exact where they vanish, and of a pinhole everywhere.
"""

import cv2
import numpy as np

from boxcal.detect.alignment.radial_camera import depth, to_pixels
from boxcal.target.arrays import Array

ITERATIONS, MORE_ITERATIONS = 14, 60
CAMERA = 6
"""Log f, centre (2), a1, a2 and a3 stand before the pose."""
FITTED = [0, 1, 2, 3, 5]
"""Which figures of a lens are fitted."""
RANGE = (-0.5, 1.5)
"""Of a1, a2 and a3."""
State = tuple[float, Array, Array]
"""Focal length, px, lens (6,) and T_cam_box (4, 4)."""


def levenberg_marquardt(  # noqa: PLR0917 - as the compiled one
    p_box: Array, uv: Array, start: State, prior: Array, expected: Array, sigma_px: float, fair: float
) -> tuple[float, Array, Array, Array, Array]:
    """Return focal length, lens, T_cam_box, information (12, 12) and deviations (P,), px, by reweighted squares."""
    kept = focal, lens, T = start
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
        r = uv.T - lens[:2, None] - tangent.seen
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
    """Return the state after a step (12,): the pose turned and moved from the left, the focal length by its log."""
    focal, lens, T = state
    lens = lens.copy()
    lens[FITTED] += step[1:CAMERA]
    lens[FITTED[2:]] = np.clip(lens[FITTED[2:]], *RANGE)
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
    before : (P,)
        Whether they lie before the chart.
    """

    def __init__(self, focal: float, lens: Array, p_cam: Array, uv: Array) -> None:
        self._d, self._p = uv.T - lens[:2, None], np.ascontiguousarray(p_cam.T)
        self._focal, self._per_px2 = focal, float(lens[4]) ** 2
        self._q = (self._d[0] ** 2 + self._d[1] ** 2) * self._per_px2
        _, slope, self._D = depth(lens, self._q)
        self._across = np.empty((3, len(uv)))
        self._across[:2], self._across[2] = -slope / self._D * self._d, 1 / (focal * self._D)
        w = (self._across * self._p).sum(axis=0)
        self.before = w > 1e-6 / focal
        self._per_w = 1 / np.where(np.abs(w) > 1e-6 / focal, w, 1e-6 / focal)
        self.seen = self._p[:2] * self._per_w

    def jacobian(self) -> Array:
        """Return how ``seen`` moves with the 12 unknowns, (12, 2, P) px; of the centre, where it is the pixel."""
        p, q, seen = self._p, self._q, self.seen
        J = np.zeros((CAMERA + 6, 2, len(q)))
        along = seen / self._D
        np.multiply(along, p[2] * self._per_w / self._focal, out=J[0])
        J[1, 0] = J[2, 1] = 1
        # of a term a q^k: slope and D change by -2 k q^(k-1) / radius^2 and (2 k - 1) q^k
        toward = (2 * self._per_px2) * (self._d[0] * seen[0] + self._d[1] * seen[1])
        J[3] = along * (q - toward)
        J[4] = along * (q * (3 * q - 2 * toward))
        J[5] = along * (q * q * (5 * q - 3 * toward))
        moved = J[CAMERA + 3 :]
        np.multiply((-self._per_w * self._across)[:, None], seen, out=moved)
        moved[0, 0] += self._per_w
        moved[1, 1] += self._per_w
        # turned: dp = turn x p
        J[6] = p[1] * moved[2] - p[2] * moved[1]
        J[7] = p[2] * moved[0] - p[0] * moved[2]
        J[8] = p[0] * moved[1] - p[1] * moved[0]
        return J


def predict(p_box: Array, focal: float, lens: Array, T_cam_box: Array, information: Array) -> tuple[Array, Array]:
    """Return where points (P, 3) are seen, (P, 2) px, and their deviations (P,) where the fit's is 1 px."""
    p_cam = p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
    uv = to_pixels(lens, p_cam * (1, 1, 1 / focal))
    before = np.isfinite(uv[:, 0])
    p_cam[~before], uv[~before] = (0, 0, 1), lens[:2]
    J = Tangent(focal, lens, p_cam, uv).jacobian()
    half = np.linalg.solve(np.linalg.cholesky(information), J.reshape(len(J), -1))
    spread = np.sqrt((half**2).sum(axis=0).reshape(2, -1).sum(axis=0))
    uv[~before] = np.nan
    return uv, np.where(before, spread, np.inf)
