"""Slip while a frame is read: rows of a rolling shutter see the robot off the course that its wheels measure.

From the middle row on, forwards and backwards in time, each wheel's slip is a random walk over the distance that it
rolls. Its few largest modes (Karhunen-Loeve expansion of the Wiener process) move all corners of a frame at once:
unknowns of the frame with known variances, eliminated where the corners' equations are made.
"""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.corner_residuals import Corners, corner_equations
from boxcal.calib.likelihood.corner_sums import by_stop, groups_of
from boxcal.calib.likelihood.leg_propagation import DRAGGED
from boxcal.calib.likelihood.moving.course import turned
from boxcal.calib.likelihood.moving.rolling import twists_of_wheels
from boxcal.calib.likelihood.normal_equations import Local, Normal
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array

_MODES = 3
"""Of each wheel, in either direction: 93 % of the walk's variance at its end."""
_SHORT_S = 5e-4
"""Readout time, s, up to which nothing slips meanwhile that corners show."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SlipWithin:
    """Slip within the frames about one state, eliminated.

    Attributes
    ----------
    loss : (P, n + 7, n + 7)
        What it takes from the normal equations of each stop's and frame's corners (noise scale 1), by the shared
        unknowns, the pose and the local unknowns.
    freedom : (P,)
        Degrees of freedom that it takes from the corners of each.
    """

    loss: Array
    freedom: Array


def slip_modes(problem: Problem, state: State, corners: Corners, frames: tuple[Array, int], within: float) -> Array:
    """Return how far slip within frames moves whitened corners, (L, 2, q), by modes of variance 1; q may be 0.

    Parameters
    ----------
    problem, state, corners
        The corners about a state, the readout time the last of its explanations' unknowns.
    frames : (P, 3, 2) and px
        How the wheels turn at each stop and frame (:mod:`boxcal.calib.likelihood.moving.course`), and the height of
        the images.
    within : m/sqrt(m)
        Slip, over the corners' noise scale.
    """
    course, height = frames
    readout, stop = float(state.explained[-1]), problem.corner_stop
    if abs(readout) < _SHORT_S or within <= 0:
        return np.zeros((len(stop), 2, 0))
    radius, n = state.wheels[:2], len(state.lens)
    since = readout * (problem.uv_px[:, 1] / height - 0.5)
    half = np.full(len(stop), readout / 2)
    rolled, most = (np.abs(turned(course[stop], t)) * radius for t in (since, np.copysign(half, since)))
    rolled, most = (d + DRAGGED * d[:, ::-1] for d in (rolled, most))
    fraction = np.divide(rolled, most, out=np.zeros_like(rolled), where=most > 0)
    k = np.pi * (np.arange(_MODES) + 0.5)
    walk = within * np.sqrt(2 * most)[:, :, None] * np.sin(k * fraction[:, :, None]) / k  # (L, 2 wheels, modes), m
    by_motion = corners.jacobian[:, :, n : n + 6]
    out = np.zeros((len(stop), 2, 2, 2, _MODES))
    for wheel in (0, 1):
        unit = np.zeros((len(stop), 2))
        unit[:, wheel] = 1 / radius[wheel]
        moved = by_motion @ twists_of_wheels(corners, state, unit)[:, :, None]
        for side, where in enumerate((since < 0, since >= 0)):
            out[where, :, wheel, side] = moved[where] * walk[where, wheel][:, None, :]
    return out.reshape(len(stop), 2, -1)


def equations_with_slip(
    problem: Problem, corners: Corners, weight: Array, modes: Array
) -> tuple[Corners, tuple[Normal, Local, Array], SlipWithin | None]:
    """Return corners less the slip that they show, and their equations with all slip that there may be.

    Parameters
    ----------
    problem, corners, weight
        As of :func:`boxcal.calib.likelihood.corner_residuals.corner_equations`.
    modes : (L, 2, q)
        Of :func:`slip_modes`.
    """
    if not modes.shape[2]:
        return corners, corner_equations(problem, corners, weight), None
    P, stop = len(problem.drive), corners.group_stop[corners.group]
    weighted = np.swapaxes(modes * weight[:, None, None], 1, 2)  # (L, q, 2)
    X = np.concatenate([corners.J_shared, corners.J_pose, corners.J_local], axis=2)
    pulls = weighted @ corners.jacobian  # (L, q, m)
    sums = [(pulls[rows].sum(axis=0), (weighted[rows] @ modes[rows]).sum(axis=0),
             np.einsum("lqi,li->q", weighted[rows], corners.residual[rows]))
            for rows in groups_of(corners.group, len(corners.group_stop))]  # fmt: skip
    M = by_stop(np.array([own for own, _, _ in sums]) @ X, corners.group_stop, P)  # (P, q, n + 7)
    S = by_stop(np.array([own for _, own, _ in sums]), corners.group_stop, P)
    s = by_stop(np.array([own for _, _, own in sums]), corners.group_stop, P)
    K = np.linalg.inv(np.eye(modes.shape[2]) + S)
    slipped = (K @ s[:, :, None])[:, :, 0]
    left = replace(corners, residual=corners.residual - np.einsum("liq,lq->li", modes, slipped[stop]))
    within = SlipWithin(loss=np.swapaxes(M, 1, 2) @ K @ M, freedom=np.einsum("pij,pji->p", S, K))
    normal, local, squares = corner_equations(problem, left, weight)
    return left, (*_less(normal, local, within.loss), squares + np.sum(slipped**2, axis=1)), within


def _less(normal: Normal, local: Local, loss: Array) -> tuple[Normal, Local]:
    """Return the corners' equations less some for each stop, (P, n + 7, n + 7)."""
    n = len(normal.A)
    own = slice(n, n + 3)
    B, D, by_chain = normal.B.copy(), normal.D.copy(), local.by_chain.copy()
    B[:, :, :3] -= loss[:, :n, own]
    D[:, :3, :3] -= loss[:, own, own]
    by_chain[:, :3] -= loss[:, own, n + 3 :]
    return replace(normal, A=normal.A - loss[:, :n, :n].sum(axis=0), B=B, D=D), replace(
        local,
        D=local.D - loss[:, n + 3 :, n + 3 :],
        by_shared=local.by_shared - loss[:, :n, n + 3 :],
        by_chain=by_chain,
    )
