"""Residuals of legs with their derivatives, gathered into normal equations."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.leg_model import LegModel, leg_model
from boxcal.calib.likelihood.normal_equations import Normal
from boxcal.calib.likelihood.problem import PER_STOP, Problem
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.stop_elimination import Bordered
from boxcal.target.arrays import Array

LEG_UNKNOWNS = 3 + 2 * PER_STOP
"""A leg depends on rR, rL, b and on the unknowns of its two stops."""
FIRST_STOP, SECOND_STOP = slice(3, 3 + PER_STOP), slice(3 + PER_STOP, 3 + 2 * PER_STOP)


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
    J_explained : (N, 3, k)
        The same by the explanations' unknowns.
    """

    model: LegModel
    residual: Array
    jacobian: Array
    J_explained: Array


def leg_residuals(problem: Problem, state: State, columns: Columns) -> LegResiduals:
    """Return the legs' residuals and derivatives."""
    i = problem.leg_stop
    unit = problem.step / np.sqrt(12)
    errors = unit * state.encoder_errors
    added = None if columns.travel is None else columns.travel @ state.explained
    model = leg_model(problem.path, state.wheels, errors[i], errors[i + 1], added)
    theta = state.poses[i, 2]
    c, s = np.cos(theta), np.sin(theta)
    d = state.poses[i + 1] - state.poses[i]
    qx, qy = c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]
    r = model.displacement - np.stack([qx, qy, d[:, 2]], axis=1)
    if columns.legs is not None:
        r = r + columns.legs @ state.explained
    r[:, 2] = wrap(r[:, 2])
    J = np.zeros((len(i), 3, LEG_UNKNOWNS))
    J[:, :, :3] = -model.d_wheels
    J[:, 0, 8], J[:, 0, 9], J[:, 1, 8], J[:, 1, 9] = c, s, -s, c
    J[:, :2, 3:5] = -J[:, :2, 8:10]
    J[:, 0, 5], J[:, 1, 5], J[:, 2, 5], J[:, 2, 10] = qy, -qx, -1.0, 1.0
    J[:, :, 6:8], J[:, :, 11:13] = -unit * model.d_start, -unit * model.d_end
    return LegResiduals(model=model, residual=r, jacobian=J, J_explained=-leg_columns(problem, model, columns))


def leg_columns(problem: Problem, model: LegModel, columns: Columns) -> Array:
    """Return what explanations change of the wheels' displacement on each leg, (N, 3, k)."""
    k = next((part.shape[2] for part in (columns.travel, columns.legs, columns.corners) if part is not None), 0)
    out = np.zeros((len(problem.leg_stop), 3, k))
    if columns.travel is not None and len(out):
        out += backend().travelled(model.by_travel, columns.travel, problem.path.starts)
    if columns.legs is not None:
        out += columns.legs
    return out


def leg_covariance(problem: Problem, model: LegModel, slip: Array) -> Array:
    """Return the legs' covariances, (..., N, 3, 3), for slip (...), m/sqrt(m).

    Readings at the legs' ends are not in it: they are unknowns. What is never known better than ``_NEGLIGIBLE`` (a leg
    on which nothing turned, say) keeps it invertible.
    """
    cov = np.square(slip)[..., None, None, None] * model.slip + problem.step**2 * model.quantisation
    return np.asarray(cov + _NEGLIGIBLE * np.eye(3))


_NEGLIGIBLE = 1e-20
"""m^2 and rad^2: below what any exact data resolve."""


def leg_equations(problem: Problem, legs: LegResiduals, information: Array) -> Normal:
    """Return the legs' normal equations for information matrices (..., N, 3, 3)."""
    batch, n, P = information.shape[:-3], len(problem.names), len(problem.drive)
    A, a, right = np.zeros((*batch, n, n)), np.zeros((*batch, n)), np.zeros((*batch, P, PER_STOP, n + 1))
    D = np.zeros((*batch, P, PER_STOP, PER_STOP))
    E = np.zeros_like(D)
    K = int(np.prod(batch, dtype=np.int64))
    _add(
        problem,
        legs,
        information.reshape(K, -1, 3, 3),
        tuple(x.reshape(K, *x.shape[len(batch) :]) for x in (A, a, D, E, right)),
    )
    return Normal(A=A, B=np.swapaxes(right[..., :n], -1, -2), D=D, E=E, a=a, c=right[..., n])


def with_legs(problem: Problem, others: Normal, legs: LegResiduals, information: Array) -> Bordered:
    """Return equations with those of the legs for K information matrices, (K, N, 3, 3).

    Of the others, whose local unknowns are eliminated, any part may differ among the K, too.
    """
    K, (P, n) = len(information), others.B.shape[-3:-1]

    def many(part: Array, *shape: int) -> Array:
        return np.array(np.broadcast_to(part, (K, *shape)), order="C")

    right = np.empty((K, P, PER_STOP, n + 1))
    right[..., :n], right[..., n] = np.swapaxes(others.B, -1, -2), others.c
    A, a = many(others.A, n, n), many(others.a, n)
    D, E = many(others.D, P, PER_STOP, PER_STOP), many(others.E, P, PER_STOP, PER_STOP)
    _add(problem, legs, information, (A, a, D, E, right))
    return Bordered(A=A, a=a, D=D, E=E, right=right)


def leg_squares(legs: LegResiduals, information: Array) -> Array:
    """Return the legs' weighted sums of squares, (...), for information matrices (..., N, 3, 3)."""
    return np.asarray(np.einsum("...ni,...nij,...nj->...", legs.residual, information, legs.residual))


def _add(problem: Problem, legs: LegResiduals, information: Array, to: tuple[Array, ...]) -> None:
    """Add legs' equations to A, a, D, E of K systems, and to their stops by shared unknowns, in place."""
    J, shared = legs.jacobian, np.arange(WHEELS.start, WHEELS.stop)
    if legs.J_explained.shape[2]:
        J = np.concatenate([J, legs.J_explained], axis=2)
        shared = np.append(shared, np.arange(problem.explained.start, problem.explained.stop))
    backend().add_legs(J, legs.residual, information, problem.leg_stop, shared, to)
