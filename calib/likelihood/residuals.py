"""Residuals of corners and legs, with their derivatives, gathered into normal equations."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.likelihood.leg_model import LegModel, leg_model
from boxcal.calib.likelihood.normal_equations import Normal
from boxcal.calib.likelihood.problem import MOUNTING, PER_STOP, WHEELS, Problem, State, camera_motions
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import project_with_jacobians

LEG_UNKNOWNS = 3 + 2 * PER_STOP
"""A leg depends on rR, rL, b and on the unknowns of its two stops."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corners:
    """Corners at one state.

    Attributes
    ----------
    residual : (L, 2)
        Seen less predicted, whitened by the corners' own covariance (pixel factor 1).
    jacobian : (L, 2, m)
        Of the whitened prediction by (lens, motion of the camera, box).
    maps : (P, m, n), (P, m, 3)
        From the shared unknowns and from the stop's pose to those m.
    valid
        Whether all points lie in front of the camera.
    """

    residual: Array
    jacobian: Array
    maps: tuple[Array, Array]
    valid: bool


def corner_residuals(problem: Problem, state: State) -> Corners:
    """Return the corners' residuals and derivatives."""
    p_box, by_shape = problem.box.landmarks(state.shape)
    R, t, by_pose, by_tilt = camera_motions(problem, state)
    stop = problem.corner_stop
    R_l = R[stop]
    p_cam = np.einsum("lji,lj->li", R_l, p_box - t[stop])
    valid = bool(np.all(p_cam[:, 2] > 1e-6))
    if not valid:
        p_cam = p_cam.copy()
        p_cam[:, 2] = np.maximum(p_cam[:, 2], 1e-6)
    uv, by_lens, by_point = project_with_jacobians(problem.lens, state.lens, p_cam)
    by_point = problem.whiten @ by_point
    n_lens, n_shape = by_lens.shape[2], by_shape.shape[2]
    J = np.empty((len(uv), 2, n_lens + 6 + n_shape))
    J[:, :, :n_lens] = problem.whiten @ by_lens
    x, y, z = p_cam[:, None, 0], p_cam[:, None, 1], p_cam[:, None, 2]
    bx, by, bz = by_point[:, :, 0], by_point[:, :, 1], by_point[:, :, 2]
    # Motion (w, t) of the camera: the point moves by p x w - t.
    J[:, :, n_lens] = by * z - bz * y
    J[:, :, n_lens + 1] = bz * x - bx * z
    J[:, :, n_lens + 2] = bx * y - by * x
    J[:, :, n_lens + 3 : n_lens + 6] = -by_point
    if n_shape:
        J[:, :, n_lens + 6 :] = by_point @ (np.swapaxes(R_l, 1, 2) @ by_shape)
    m, n, P = J.shape[2], len(problem.names), len(R)
    shared, own = np.zeros((P, m, n)), np.zeros((P, m, 3))
    shared[:, np.arange(5), np.arange(5)] = 1.0
    extras = np.arange(problem.extras.start, problem.extras.stop)
    shared[:, 5 + np.arange(len(extras)), extras] = 1.0
    shared[:, n_lens + np.arange(6), np.arange(MOUNTING.start, MOUNTING.stop)] = 1.0
    if problem.tilt_count:
        columns = problem.tilts.start + 2 * problem.drive
        for k in (0, 1):
            shared[np.arange(P)[:, None], n_lens + np.arange(6), (columns + k)[:, None]] = by_tilt[:, :, k]
    shapes = np.arange(problem.shapes.start, problem.shapes.stop)
    shared[:, n_lens + 6 + np.arange(n_shape), shapes] = 1.0
    own[:, n_lens : n_lens + 6] = by_pose
    residual = (problem.whiten @ (problem.uv_px - uv)[:, :, None])[:, :, 0]
    return Corners(residual=residual, jacobian=J, maps=(shared, own), valid=valid)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegResiduals:
    """Legs at one state.

    Attributes
    ----------
    model
        What the wheels say.
    residual : (N, 3), m and rad
        Wheels less poses: ``(dx, dy, dtheta)`` in the body frame of the leg's first stop.
    jacobian : (N, 3, 13)
        Of poses less wheels, by (rR, rL, b), the first and the second stop.
    """

    model: LegModel
    residual: Array
    jacobian: Array


def leg_residuals(problem: Problem, state: State) -> LegResiduals:
    """Return the legs' residuals and derivatives."""
    i = problem.leg_stop
    unit = problem.step / np.sqrt(12)
    model = leg_model(problem.path, state.wheels, unit * state.readings[i], unit * state.readings[i + 1])
    theta = state.poses[i, 2]
    c, s = np.cos(theta), np.sin(theta)
    d = state.poses[i + 1] - state.poses[i]
    qx, qy = c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]
    r = model.displacement - np.stack([qx, qy, d[:, 2]], axis=1)
    r[:, 2] = wrap(r[:, 2])
    J = np.zeros((len(i), 3, LEG_UNKNOWNS))
    J[:, :, :3] = -model.d_wheels
    J[:, 0, 8], J[:, 0, 9], J[:, 1, 8], J[:, 1, 9] = c, s, -s, c
    J[:, :2, 3:5] = -J[:, :2, 8:10]
    J[:, 0, 5], J[:, 1, 5], J[:, 2, 5], J[:, 2, 10] = qy, -qx, -1.0, 1.0
    J[:, :, 6:8], J[:, :, 11:13] = -unit * model.d_start, -unit * model.d_end
    return LegResiduals(model=model, residual=r, jacobian=J)


def leg_covariance(problem: Problem, model: LegModel, slip: Array) -> Array:
    """Return the legs' covariances, (..., N, 3, 3), for levels of slip (...), m/sqrt(m).

    Readings at the legs' ends are not in it: they are unknowns.
    """
    return np.asarray(np.square(slip)[..., None, None, None] * model.slip + problem.step**2 * model.shape)


def corner_equations(corners: Corners, starts: Ids, weight: Array) -> tuple[Normal, Array]:
    """Return the corners' normal equations (pixel factor 1), and each stop's weighted sum of squares (P,).

    Parameters
    ----------
    corners
        Residuals and derivatives.
    starts : (P + 1,)
        First corner of each stop.
    weight : (L,)
        Weight of each corner; 0 leaves it out.
    """
    m = corners.jacobian.shape[2]
    rows = np.concatenate([corners.jacobian, corners.residual[:, :, None]], axis=2)
    rows *= np.sqrt(weight)[:, None, None]
    rows = rows.reshape(-1, m + 1)
    N = np.array([rows[2 * i : 2 * j].T @ rows[2 * i : 2 * j] for i, j in pairwise(starts)])
    shared, own = corners.maps
    NK = N[:, :m, :m] @ shared
    P, n = len(N), shared.shape[2]
    B, D, c = np.zeros((P, n, PER_STOP)), np.zeros((P, PER_STOP, PER_STOP)), np.zeros((P, PER_STOP))
    B[:, :, :3] = np.swapaxes(NK, 1, 2) @ own
    own_t = np.swapaxes(own, 1, 2)
    D[:, :3, :3] = own_t @ N[:, :m, :m] @ own
    c[:, :3] = (own_t @ N[:, :m, m:])[:, :, 0]
    A = np.tensordot(shared, NK, axes=([0, 1], [0, 1]))
    a = np.einsum("pmi,pm->i", shared, N[:, :m, m])
    return Normal(A=A, B=B, D=D, E=np.zeros_like(D), a=a, c=c), N[:, m, m]


def leg_equations(problem: Problem, legs: LegResiduals, information: Array) -> tuple[Normal, Array]:
    """Return the legs' normal equations and sums of squares, (...), for information matrices (..., N, 3, 3)."""
    J, r = legs.jacobian, legs.residual
    JtN = np.swapaxes(J, 1, 2) @ information
    H, g = JtN @ J, (JtN @ r[:, :, None])[..., 0]
    batch, n, P = information.shape[:-3], len(problem.names), len(problem.drive)
    A, a = np.zeros((*batch, n, n)), np.zeros((*batch, n))
    B, D = np.zeros((*batch, P, n, PER_STOP)), np.zeros((*batch, P, PER_STOP, PER_STOP))
    E, c = np.zeros_like(D), np.zeros((*batch, P, PER_STOP))
    first, second = slice(3, 8), slice(8, 13)
    A[..., WHEELS, WHEELS] = H[..., :3, :3].sum(axis=-3)
    a[..., WHEELS] = g[..., :3].sum(axis=-2)
    for stops, part in ((problem.leg_stop, first), (problem.leg_stop + 1, second)):
        B[..., stops, WHEELS, :] += H[..., :3, part]
        D[..., stops, :, :] += H[..., part, part]
        c[..., stops, :] += g[..., part]
    E[..., problem.leg_stop, :, :] = H[..., first, second]
    return Normal(A=A, B=B, D=D, E=E, a=a, c=c), np.einsum("...ni,...nij,...nj->...", r, information, r)


def prior_equations(problem: Problem, state: State) -> tuple[Normal, float]:
    """Return the priors' normal equations and sum of squares."""
    n, P = len(problem.names), len(problem.drive)
    value = np.zeros(n)
    value[problem.tilts] = state.tilt.ravel() if problem.tilt_count else 0.0
    value[problem.shapes] = state.shape
    weight = problem.prior_information
    D, c = np.zeros((P, PER_STOP, PER_STOP)), np.zeros((P, PER_STOP))
    D[:, 3, 3] = D[:, 4, 4] = 1.0
    c[:, 3:] = -state.readings
    normal = Normal(A=weight, B=np.zeros((P, n, PER_STOP)), D=D, E=np.zeros_like(D), a=-weight @ value, c=c)
    return normal, float(value @ weight @ value + np.sum(state.readings**2))


def combined(corners: Normal, pixel_factor: float, legs: Normal, prior: Normal) -> Normal:
    """Return the sum of all normal equations; the legs' may be a batch."""
    w = pixel_factor**-2
    return Normal(
        A=w * corners.A + prior.A + legs.A,
        B=w * corners.B + prior.B + legs.B,
        D=w * corners.D + prior.D + legs.D,
        E=legs.E,
        a=w * corners.a + prior.a + legs.a,
        c=w * corners.c + prior.c + legs.c,
    )
