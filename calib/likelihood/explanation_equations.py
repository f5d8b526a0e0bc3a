"""Equations of explanations that are not part of the model, each by itself beside the unknowns that are.

There are hundreds, and no two are asked for together: of their information only each one's own block is made, and that
with the other unknowns. Nothing is linearized again: what the data do in the base columns of corners and legs is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_residuals import explained_motions
from boxcal.calib.likelihood.corner_sums import by_stop
from boxcal.calib.likelihood.explanation import Explanation, stacked
from boxcal.calib.likelihood.fit import Tested
from boxcal.calib.likelihood.leg_residuals import FIRST_STOP, SECOND_STOP, LegResiduals, leg_columns, leg_equations
from boxcal.calib.likelihood.levenberg_marquardt import leg_information, reduced_picture_equations
from boxcal.calib.likelihood.normal_equations import Normal
from boxcal.calib.likelihood.picture_blocks import group_blocks
from boxcal.calib.likelihood.problem import PER_STOP, Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array, Ids

Pair = tuple[Array, Array]
"""Two factors (..., X, M), whose product summed over X is a part of the information of the new unknowns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NewColumns:
    """Derivatives of the data by the M unknowns of explanations beside the model, about a solution.

    Attributes
    ----------
    corners : (G x c, M), (G x c, M)
        What they do in the groups' base columns, and that times the corners' information there, noise scale 1.
    with_shared : (M, n)
        Information of the corners with the shared unknowns, noise scale 1.
    with_pose, with_local : (P, M, 3), (P, M, 4)
        The same with each stop's pose and its local unknowns.
    right : (M,)
        Right-hand sides from the corners, noise scale 1.
    legs : (N, 3, M)
        Derivatives of the legs' residuals (poses less wheels).
    """

    corners: Pair
    with_shared: Array
    with_pose: Array
    with_local: Array
    right: Array
    legs: Array


def new_columns(fit: Tested, explanations: Sequence[Explanation]) -> NewColumns:
    """Return what the unknowns of explanations would do about a solution without them."""
    problem, at = fit.problem, fit.at
    columns, c = stacked(explanations, problem, fit.state), at.corners
    legs = -leg_columns(problem, at.legs.model, columns)
    k, m, n, P = legs.shape[2], len(fit.state.lens) + 6, len(problem.names), len(problem.drive)
    if columns.corners is None:
        return NewColumns(
            corners=(np.zeros((0, k)), np.zeros((0, k))),
            with_shared=np.zeros((k, n)),
            with_pose=np.zeros((P, k, 3)),
            with_local=np.zeros((P, k, c.J_local.shape[2])),
            right=np.zeros(k),
            legs=legs,
        )
    moved = None if at.columns.corners is None else at.columns.corners @ fit.state.explained
    own = explained_motions(columns.corners, moved)[c.group_stop]  # (G, m, k)
    H, g = group_blocks(c, fit.weights.corners)
    weighted = H[:, :, :m] @ own
    weighted_t = np.swapaxes(weighted, 1, 2)
    return NewColumns(
        corners=(own.reshape(-1, k), weighted[:, :m].reshape(-1, k)),
        with_shared=(c.J_shared.reshape(-1, n).T @ weighted.reshape(-1, k)).T,
        with_pose=by_stop(weighted_t @ c.J_pose, c.group_stop, P),
        with_local=by_stop(weighted_t @ c.J_local, c.group_stop, P),
        right=own.reshape(-1, k).T @ g[:, :m].ravel(),
        legs=legs,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExplanationEquations:
    """Equations of the n shared unknowns and M others at K levels of slip, all else eliminated.

    Priors of the others are not in them.

    Attributes
    ----------
    information, right : (K, n, n), (K, n)
        Of the shared unknowns.
    with_shared : (K, M, n)
        Information of the others with them.
    right_new : (K, M)
        Right-hand sides of the others.
    parts
        Factors of the information of the others, to be added or (the second) taken off.
    """

    information: Array
    right: Array
    with_shared: Array
    right_new: Array
    parts: tuple[tuple[Pair, ...], tuple[Pair, ...]]

    def blocks(self, rows: Ids) -> Array:
        """Return the blocks (E, K, q, q) of the others' information at some of them (E, q)."""
        (E, q), K = rows.shape, len(self.right)
        out = np.zeros((K, E, q, q))
        for sign, pairs in zip((1, -1), self.parts, strict=True):
            for left, right in pairs:
                if left.shape[-2]:
                    a, b = (np.moveaxis(part[..., rows], -3, -2) for part in (left, right))  # (..., E, X, q)
                    out += sign * (np.swapaxes(a, -1, -2) @ b)
        return np.moveaxis(out, 0, 1)


def explanation_equations(
    fit: Tested, components: VarianceComponents, slip: Array, new: NewColumns
) -> ExplanationEquations:
    """Return the equations about a solution for variance components and levels of slip (K,), m/sqrt(m)."""
    problem, at = fit.problem, fit.at
    n, M, P, w = len(problem.names), len(new.right), len(problem.drive), components.noise_scale**-2
    pictures, e, _ = reduced_picture_equations(problem, at, components)
    information = leg_information(problem, at.legs, fit.weights, slip)
    normal = pictures.plus(leg_equations(problem, at.legs, information))
    with_local = w * new.with_local * components.local_sigma
    local = e.inverse @ np.swapaxes(with_local, 1, 2)  # (P, q, M)
    with_stop = np.zeros((P, M, PER_STOP))
    with_stop[:, :, :3] = w * new.with_pose
    with_stop = with_stop - with_local @ e.by_chain
    weighted = information @ new.legs  # (K, N, 3, M)
    right_new = w * new.right - np.einsum("pmq,pq->m", with_local, e.c)
    right_new = right_new + np.einsum("knim,ni->km", weighted, at.legs.residual)
    with_shared = w * new.with_shared - np.tensordot(with_local, e.by_shared, axes=([0, 2], [0, 1]))
    with_shared, with_stop = _with_legs(problem, at.legs, weighted, with_shared, with_stop)
    right, back = _swept(normal, with_stop)
    known = back[..., [*range(n), -1]]
    reduced, reduced_new = (np.swapaxes(right[..., part], 1, 2) @ known for part in (slice(n), slice(n, -1)))
    corners = new.corners[0], w * new.corners[1]
    return ExplanationEquations(
        information=normal.A - reduced[..., :n],
        right=normal.a - reduced[..., n],
        with_shared=with_shared - reduced_new[..., :n],
        right_new=right_new - reduced_new[..., n],
        parts=(
            (corners, (new.legs.reshape(-1, M), weighted.reshape(len(slip), -1, M)))
            if np.any(new.legs)
            else (corners,),
            (
                (np.swapaxes(with_local, 1, 2).reshape(-1, M), local.reshape(-1, M)),
                (right[..., n:-1], back[..., n:-1]),
            ),
        ),
    )


def _with_legs(
    problem: Problem, legs: LegResiduals, weighted: Array, with_shared: Array, with_stop: Array
) -> tuple[Array, Array]:
    """Return the information with shared unknowns (K, M, n) and stops (K, P, M, 5), that of the legs added."""
    J, weighted_t = legs.jacobian, np.swapaxes(weighted, 2, 3)  # (K, N, M, 3)
    shared = np.broadcast_to(with_shared, (len(weighted), *with_shared.shape)).copy()
    shared[..., WHEELS] += (weighted_t @ J[:, :, :3]).sum(axis=1)
    if legs.J_explained.shape[2]:
        shared[..., problem.explained] += (weighted_t @ legs.J_explained).sum(axis=1)
    stops = np.broadcast_to(with_stop, (len(weighted), *with_stop.shape)).copy()
    stops[:, problem.leg_stop] += weighted_t @ J[:, :, FIRST_STOP]
    stops[:, problem.leg_stop + 1] += weighted_t @ J[:, :, SECOND_STOP]
    return shared, stops


def _swept(normal: Normal, with_stop: Array) -> tuple[Array, Array]:
    """Return the stops' blocks by all unknowns and their right-hand sides, (K, 5 P, n + M + 1), and half solved for."""
    n, M = normal.A.shape[-1], with_stop.shape[-2]
    right = np.empty((*normal.c.shape, n + M + 1))  # contiguous, as compiled code was made for
    right[..., :n], right[..., n:-1] = np.swapaxes(normal.B, -1, -2), np.swapaxes(with_stop, -1, -2)
    right[..., -1] = normal.c
    _, _, back, _ = backend().eliminate_stops(normal.D, normal.E, right)
    K, columns = len(right), right.shape[-1]
    return right.reshape(K, -1, columns), back.reshape(K, -1, columns)


def extended(problem: Problem, state: State, explanations: Sequence[Explanation]) -> tuple[Problem, State]:
    """Return problem and state with more explanations, their unknowns at zero and last among the shared ones."""
    names = tuple(name for e in explanations for name in e.names)
    if len({*problem.names, *names}) < len(problem.names) + len(names):
        raise ValueError(f"explanations with unknowns {names}: a name stands twice")
    n, k = len(problem.names), len(names)
    information = np.zeros((n + k, n + k))
    information[:n, :n] = problem.information
    wider = replace(
        problem,
        names=problem.names + names,
        prior=np.concatenate([problem.prior, *(np.asarray(e.prior, dtype=np.float64) for e in explanations)]),
        component=problem.component + ("",) * k,
        unit=np.append(problem.unit, np.ones(k)),
        information=information,
        explanations=problem.explanations + tuple(explanations),
    )
    return wider, replace(state, explained=np.concatenate([state.explained, np.zeros(k)]))
