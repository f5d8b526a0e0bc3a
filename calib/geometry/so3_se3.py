"""Rotations and rigid motions: exponentials, logarithms, angles.

``T_a_b`` maps points of frame b into frame a, so adjacent names match: ``T_box_cam = T_box_body @ T_body_cam``.
"""

import numpy as np
from numpy.typing import ArrayLike

from boxcal.target.arrays import Array

_SMALL = 1e-4
"""Below this angle (rad) series replace quotients that would cancel; their error is under 1e-16 there."""


def wrap(angle: ArrayLike) -> Array:
    """Return angles in [-pi, pi), rad."""
    angle = np.asarray(angle, dtype=np.float64)
    return np.asarray(angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi)))


def rot2(angle: float) -> Array:
    """Return the plane rotation by an angle (rad), (2, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def rot_y(angle: float) -> Array:
    """Return the rotation about y by an angle (rad), (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rot_z(angle: float) -> Array:
    """Return the rotation about z by an angle (rad), (3, 3)."""
    R = np.eye(3)
    R[:2, :2] = rot2(angle)
    return R


def hat(w: Array) -> Array:
    """Return the matrices of the cross product, (..., 3, 3), ``hat(w) @ x = w x x``."""
    out = np.zeros((*w.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -w[..., 2], w[..., 1], -w[..., 0]
    return out - np.swapaxes(out, -1, -2)


def vee(S: Array) -> Array:
    """Return the vectors (..., 3) of the skew parts of matrices (..., 3, 3): the inverse of :func:`hat`."""
    return 0.5 * np.stack(
        [S[..., 2, 1] - S[..., 1, 2], S[..., 0, 2] - S[..., 2, 0], S[..., 1, 0] - S[..., 0, 1]], axis=-1
    )


def exp_so3(w: Array) -> Array:
    """Return the rotations by ``|w|`` about ``w`` (rad), (..., 3, 3) for (..., 3) (Rodrigues)."""
    angle = np.sqrt(np.sum(w * w, axis=-1))[..., None, None]
    W = hat(w)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    return np.asarray(np.eye(3) + a * W + b * (W @ W))


def right_jacobian(w: Array) -> Array:
    """Return J, (..., 3, 3), with ``exp_so3(w + dw) = exp_so3(w) @ exp_so3(J @ dw)`` to first order (rad)."""
    angle = np.sqrt(np.sum(w * w, axis=-1))[..., None, None]
    W = hat(w)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    b = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) - a * W + b * (W @ W))


def log_so3(R: Array) -> Array:
    """Return the rotation vector of R, (3,) rad, its length in [0, pi]."""
    v = vee(R)
    sine, cosine = float(np.linalg.norm(v)), (float(np.trace(R)) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    if cosine > -0.9:
        return np.asarray(v * (1 + sine**2 / 6 if sine < _SMALL else angle / sine))
    # Near half a turn the skew part vanishes: take the axis from the symmetric part.
    S = (R + R.T) / 2 - cosine * np.eye(3)
    column = S[:, int(np.argmax(np.diag(S)))]
    axis = column / np.linalg.norm(column)
    return np.asarray(angle * axis * (-1.0 if axis @ v < 0 else 1.0))


def rigid(R: Array, t: Array) -> Array:
    """Return the (4, 4) motion with rotation R and translation t."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def inverse(T: Array) -> Array:
    """Return the inverse of rigid motions, (..., 4, 4)."""
    out = np.zeros_like(T)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -(R_t @ T[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def planar(x: float, y: float, theta: float) -> Array:
    """Return the (4, 4) pose of a body on the floor: position (m) and heading (rad)."""
    return rigid(rot_z(theta), np.array([x, y, 0.0]))


def exp_se3(xi: Array) -> Array:
    """Return the motions ``[exp_so3(w), t]``, (..., 4, 4), of xi = (w, t), (..., 6): rotation and translation apart.

    As a *right* perturbation ``T @ exp_se3(xi)`` it moves frame b of ``T_a_b`` by t (m) along, and by w (rad)
    about, its own axes; to first order it equals the group exponential.
    """
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = exp_so3(xi[..., :3]), xi[..., 3:], 1.0
    return T


def nearest_rotation(M: Array) -> Array:
    """Return the rotation nearest to a (3, 3) matrix (least squares, by SVD)."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def euler_zyz(R: Array) -> tuple[float, float, float]:
    """Return (a1, a2, a3) with ``R = Rz(a1) Ry(a2) Rz(a3)``, a2 in [0, pi] (eq. 12).

    Where sin a2 is zero (a camera that looks straight up or down) only a1 + a3 or a1 - a3 is determined: a3 = 0 then.
    """
    sine = float(np.hypot(R[2, 0], R[2, 1]))
    a2 = float(np.arctan2(sine, R[2, 2]))
    if sine < 1e-9:
        return float(np.arctan2(-R[0, 1], R[1, 1])), a2, 0.0
    return float(np.arctan2(R[1, 2], R[0, 2])), a2, float(np.arctan2(R[2, 1], -R[2, 0]))
