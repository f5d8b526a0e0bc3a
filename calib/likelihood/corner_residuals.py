"""Residuals of corners with their derivatives, gathered into normal equations."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from boxcal.calib.geometry.parameters import MOUNTING
from boxcal.calib.geometry.so3_se3 import exp_so3, hat, right_jacobian
from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.normal_equations import Local, Normal
from boxcal.calib.likelihood.problem import LOCAL, PER_STOP, Problem
from boxcal.calib.likelihood.state import CameraMotions, State, camera_motions
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import FACES
from boxcal.target.camera.camera_model import project_with_jacobians


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corners:
    """Corners at one state. Corners of one stop on one face are a group; groups stand in order of their stops.

    Attributes
    ----------
    residual : (L, 2)
        Seen less predicted, whitened by the corners' own covariance (noise scale 1).
    jacobian : (L, 2, m)
        Of the whitened prediction by (camera model, motion of the camera, growth, direct unknowns of the target).
    group : (L,)
        Group of each corner.
    group_stop : (G,)
        Stop of each group.
    J_shared, J_pose, J_local : (G, m, n), (G, m, 3), (G, m, 4)
        From the shared unknowns, from the stop's pose and from its local unknowns to those m.
    valid
        Whether all points lie in front of the camera.
    """

    residual: Array
    jacobian: Array
    group: Ids
    group_stop: Ids
    J_shared: Array
    J_pose: Array
    J_local: Array
    valid: bool


def corner_residuals(problem: Problem, state: State, columns: Columns, spare: int = 0) -> Corners:
    """Return the corners' residuals and derivatives.

    Parameters
    ----------
    problem, state
        Data, and where.
    columns
        Of the explanations that are part of the model, there.
    spare
        Columns of zeros behind the others, for what differs from corner to corner.
    """
    target, stop = problem.target, problem.corner_stop
    p_box, R_box_face = target.landmarks(state.shape)
    motions = camera_motions(problem, state)
    R, t = motions.R_box_cam, motions.p_box_cam
    lens = np.broadcast_to(state.lens, (len(R), len(state.lens)))
    if columns.corners is not None and np.any(state.explained):
        moved = columns.corners @ state.explained
        lens = lens + moved[:, : len(state.lens)]
        t = t + np.einsum("pij,pj->pi", R, moved[:, -3:])
        R = R @ exp_so3(moved[:, -6:-3])
    R_t = np.swapaxes(R, 1, 2)
    p_cam = backend().moved_points(R_t, -(R_t @ t[:, :, None])[:, :, 0], stop, p_box)
    valid = bool(np.all(p_cam[:, 2] > 1e-6))
    if not valid:
        p_cam = p_cam.copy()
        p_cam[:, 2] = np.maximum(p_cam[:, 2], 1e-6)
    uv, by_lens, by_point = _projected(problem, lens, p_cam)
    uv = uv + problem.outward_px * (state.common_growth + state.growth)[stop, None]
    group, group_stop, group_face = _groups(stop, target.face)
    R_face_cam = np.swapaxes(R_box_face[group_face], 1, 2) @ R[group_stop]
    residual, J = backend().corner_rows(problem, problem.uv_px - uv, by_lens, by_point, p_cam, group, R_face_cam, spare)
    J_shared, J_pose, J_local = _maps(problem, state, (motions, R, t), columns, (group_stop, group_face), spare)
    return Corners(
        residual=residual,
        jacobian=J,
        group=group,
        group_stop=group_stop,
        J_shared=J_shared,
        J_pose=J_pose,
        J_local=J_local,
        valid=valid,
    )


def _projected(problem: Problem, lens: Array, p_cam: Array) -> tuple[Array, Array, Array]:
    """Return pixels and derivatives for coefficients (P, n) that may differ from stop to stop."""
    if np.all(lens == lens[0]):
        return project_with_jacobians(problem.lens, lens[0], p_cam)
    parts = [
        project_with_jacobians(problem.lens, k, p_cam[i:j])
        for k, (i, j) in zip(lens, pairwise(problem.corner_starts), strict=True)
    ]
    uv, by_lens, by_point = (np.concatenate(column) for column in zip(*parts, strict=True))
    return uv, by_lens, by_point


def _groups(stop: Ids, face: Ids) -> tuple[Ids, Ids, Ids]:
    """Return the group of each corner, and the stop and the face of each group."""
    keys, group = np.unique(FACES * stop + face, return_inverse=True)
    return group, keys // FACES, keys % FACES


def _maps(  # noqa: PLR0917 - a state and what is part of it
    problem: Problem,
    state: State,
    camera: tuple[CameraMotions, Array, Array],
    columns: Columns,
    groups: tuple[Ids, Ids],
    spare: int,
) -> tuple[Array, Array, Array]:
    """Return what the shared unknowns, the poses and the local unknowns do in each group: see :class:`Corners`."""
    target, n_lens = problem.target, len(state.lens)
    motions, R_box_cam, p_box_cam = camera
    stop, face = groups
    G, m, n = len(stop), n_lens + 7 + target.direct + spare, len(problem.names)
    motion, growth, direct = slice(n_lens, n_lens + 6), n_lens + 6, n_lens + 7
    shared, own, local = np.zeros((G, m, n)), np.zeros((G, m, 3)), np.zeros((G, m, LOCAL))
    shared[:, np.arange(5), np.arange(5)] = 1.0
    extras = np.arange(problem.extras.start, problem.extras.stop)
    shared[:, 5 + np.arange(len(extras)), extras] = 1.0
    # What acts before an explanation moved the camera reaches it through that motion.
    through = np.eye(6)[None]
    if columns.corners is not None:
        moved = columns.corners @ state.explained
        through = _through(moved[:, -6:])[stop]
        shared[:, : n_lens + 6, problem.explained] = explained_motions(columns.corners, moved)[stop]
    shared[:, motion, MOUNTING] = through
    own[:, motion] = through @ motions.J_pose[stop]
    local[:, motion, :3] = through @ motions.J_lean[stop]
    shared[:, growth, problem.growth] = 1.0
    local[:, growth, 3] = 1.0
    if problem.tilt_count:
        J_tilt = through @ motions.J_tilt[stop]
        at = problem.tilts.start + 2 * problem.drive[stop]
        for k in (0, 1):
            shared[np.arange(G)[:, None], n_lens + np.arange(6), (at + k)[:, None]] = J_tilt[:, :, k]
    if target.names:
        first = problem.shapes.start
        for k, name in enumerate(("scale_x", "scale_y", "ink")):
            column = target.column(name)
            if column is not None:
                shared[:, direct + k, first + column] = 1.0
        if target.column("bow0") is not None:
            shared[np.arange(G), direct + 3, first + target.names.index("bow0") + face] = 1.0
        J_face = _face_motions(problem, state, (R_box_cam[stop], p_box_cam[stop]), face)
        seat = target.column("seat")
        if seat is not None:
            shared[:, motion, first + seat] = J_face[:, :, 1]
        if target.column("face0_tx") is not None:
            at = first + target.names.index("face0_tx") + 6 * face
            shared[
                np.arange(G)[:, None, None], (n_lens + np.arange(6))[:, None], (at[:, None] + np.arange(6))[:, None]
            ] = J_face
    return shared, own, local


def explained_motions(columns: Array, moved: Array | None) -> Array:
    """Return how the camera changes with explanations' unknowns, (P, n_lens + 6, k), where they moved it already.

    Parameters
    ----------
    columns : (P, n_lens + 6, k)
        As of :class:`Columns`.
    moved : (P, n_lens + 6), optional
        What explanations that are part of the model changed; None where nothing.
    """
    if moved is None or not np.any(moved[:, -6:-3]):
        return columns
    out, turn = columns.copy(), moved[:, -6:-3]
    out[:, -6:-3] = right_jacobian(turn) @ columns[:, -6:-3]
    out[:, -3:] = np.swapaxes(exp_so3(turn), 1, 2) @ columns[:, -3:]
    return out


def _through(moved: Array) -> Array:
    """Return how motions before a small motion (P, 6) of the camera look after it, (P, 6, 6): its inverse adjoint."""
    out = np.zeros((len(moved), 6, 6))
    R_t = np.swapaxes(exp_so3(moved[:, :3]), 1, 2)
    out[:, :3, :3] = out[:, 3:, 3:] = R_t
    out[:, 3:, :3] = -R_t @ hat(moved[:, 3:])
    return out


def _face_motions(problem: Problem, state: State, camera: tuple[Array, Array], face: Ids) -> Array:
    """Return the motions of the camera that equal those of the faces, (G, 6, 6), by a face's six unknowns."""
    target = problem.target
    _, _, twist = target.motions(state.shape)
    T_face = target.T_box_face[face]
    R_box_cam, p = camera
    R_t = np.swapaxes(R_box_cam, 1, 2)
    R = R_t @ T_face[:, :3, :3]  # R_cam_face
    t = (R_t @ (T_face[:, :3, 3] - p)[:, :, None])[:, :, 0]
    w, v = R @ twist[face, :3], R @ twist[face, 3:]
    # The points move by w x (p_cam - t) + v; a camera's motion (w', t') moves them by p_cam x w' - t'.
    return np.concatenate([-w, -hat(t) @ w - v], axis=1)


def corner_equations(problem: Problem, corners: Corners, weight: Array) -> tuple[Normal, Local, Array]:
    """Return the corners' normal equations, the local unknowns' and each stop's sum of squares (P,), noise scale 1.

    Parameters
    ----------
    problem, corners
        Residuals and derivatives.
    weight : (L,)
        Weight of each corner; 0 leaves it out.
    """
    own = np.concatenate([corners.J_pose, corners.J_local], axis=2)  # (G, m, 3 + q)
    rows, P = (corners.jacobian, corners.residual, weight), len(problem.drive)
    A, a, BG, DF, cf, squares = backend().corner_sums(rows, corners.group, corners.group_stop, P, corners.J_shared, own)
    n = len(a)
    B, D, c = np.zeros((P, n, PER_STOP)), np.zeros((P, PER_STOP, PER_STOP)), np.zeros((P, PER_STOP))
    B[:, :, :3], D[:, :3, :3], c[:, :3] = BG[:, :, :3], DF[:, :3, :3], cf[:, :3]
    by_chain = np.zeros((P, PER_STOP, corners.J_local.shape[2]))
    by_chain[:, :3] = DF[:, :3, 3:]
    local = Local(D=DF[:, 3:, 3:], by_shared=BG[:, :, 3:], by_chain=by_chain, c=cf[:, 3:])
    return Normal(A=A, B=B, D=D, E=np.zeros_like(D), a=a, c=c), local, squares
