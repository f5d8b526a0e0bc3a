"""Values of all unknowns, how a step changes them, and where they put the cameras."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.parameters import CAMERA, MOUNTING, WHEELS
from boxcal.calib.geometry.so3_se3 import exp_so3, hat, right_jacobian, rigid, rot_z
from boxcal.calib.likelihood.problem import Problem
from boxcal.target.arrays import Array

POSE, READINGS = slice(0, 3), slice(3, 5)
"""Where x, y, heading and the two encoder errors stand among a stop's unknowns in the chain."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """Values of all unknowns.

    Attributes
    ----------
    lens : (5 + extras,)
        fu, fv, cu, cv (px), kr and the camera model's further coefficients.
    wheels : (3,), m
        rR, rL, b.
    T_body_cam : (4, 4), m
        The camera extrinsics.
    tilt : (D, 2), rad
        Rotation of the floor about the box' x and y, a row for each drive: ``T_box_floor = exp(tilt_x, tilt_y, 0)``.
    shape : (n,)
        Deformation of the target.
    common_growth : px
        By how much the tags' black looks larger than it is in all images, outwards at every edge.
    explained : (k,)
        Unknowns of the explanations that are part of the model.
    poses : (P, 3), m and rad
        x, y and heading of the body on the floor, at each stop.
    lean : (P, 3), rad and m
        Roll, pitch and height of the body against the common floor, at each stop.
    growth : (P,), px
        The same at each stop, besides.
    encoder_errors : (P, 2)
        True wheel angle less reading, right and left, in units of ``step / sqrt(12)``.
    """

    lens: Array
    wheels: Array
    T_body_cam: Array
    tilt: Array
    shape: Array
    common_growth: float
    explained: Array
    poses: Array
    lean: Array
    growth: Array
    encoder_errors: Array


def resting(problem: Problem, *, lens: Array, wheels: Array, T_body_cam: Array, poses: Array) -> State:
    """Return a state with all that deviates from the ideal at zero.

    Parameters
    ----------
    problem
        How many of each unknown there are.
    lens : (5 + extras,), px
    wheels : (3,), m
    T_body_cam : (4, 4), m
    poses : (P, 3), m and rad
    """
    P = len(poses)
    return State(
        lens=lens,
        wheels=wheels,
        T_body_cam=T_body_cam,
        tilt=np.zeros((problem.drives, 2)),
        shape=np.zeros(len(problem.target.names)),
        common_growth=0.0,
        explained=np.zeros(problem.explained.stop - problem.explained.start),
        poses=poses,
        lean=np.zeros((P, 3)),
        growth=np.zeros(P),
        encoder_errors=np.zeros((P, 2)),
    )


def retract(problem: Problem, state: State, d_shared: Array, d_stops: Array, d_local: Array) -> State:
    """Return the state after a step: (n,) of the shared unknowns, (P, 5) and (P, 4) of the stops'.

    To first order the extrinsics move to ``T_body_cam @ exp_se3(rx, ry, rz, tx, ty, tz)`` and everything else by
    addition. Beyond that, the step keeps straight what the images know well: where the cameras stand and look is linear
    in the step, whatever the extrinsics' yaw and place on the robot do, and the poses follow. (Moving poses and
    extrinsics independently would bend every long step out of the images' narrow valley.)
    """
    m = d_shared[MOUNTING]
    R, t = state.T_body_cam[:3, :3], state.T_body_cam[:3, 3]
    yaw = float(R[2] @ m[:3])  # turn of the camera about the vertical
    new_R = rot_z(yaw) @ R @ exp_so3(m[:3] - yaw * R[2])
    d_t = R @ m[3:]
    Rz, theta = headings(state.poses[:, 2]), state.poses[:, 2] + d_stops[:, 2]
    s = (Rz @ t)[:, :2]
    camera = s + (Rz @ d_t)[:, :2] + d_stops[:, :2] + d_stops[:, 2:3] * np.stack([-s[:, 1], s[:, 0]], axis=1)
    xy = state.poses[:, :2] + camera - (headings(theta) @ (t + d_t))[:, :2]
    tilt = state.tilt
    if problem.tilt_count:
        tilt = tilt + d_shared[problem.tilts].reshape(-1, 2)
    return replace(
        state,
        lens=state.lens + np.concatenate([d_shared[CAMERA], d_shared[problem.extras]]),
        wheels=state.wheels + d_shared[WHEELS],
        T_body_cam=rigid(new_R, t + d_t),
        tilt=tilt,
        shape=state.shape + d_shared[problem.shapes],
        common_growth=state.common_growth + float(d_shared[problem.growth].sum()),
        explained=state.explained + d_shared[problem.explained],
        poses=np.concatenate([xy, theta[:, None]], axis=1),
        lean=state.lean + d_local[:, :3],
        growth=state.growth + d_local[:, 3],
        encoder_errors=state.encoder_errors + d_stops[:, READINGS],
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraMotions:
    """Camera poses and their derivatives as right perturbations of ``T_box_cam``.

    Attributes
    ----------
    R_box_cam : (P, 3, 3)
    p_box_cam : (P, 3), m
    J_pose : (P, 6, 3)
        Motion (rotation, translation) by (x, y, heading). That by the extrinsics' perturbation is the identity.
    J_lean : (P, 6, 3)
        By roll, pitch and height.
    J_tilt : (P, 6, 2)
        By the tilt of the drive's floor.
    """

    R_box_cam: Array
    p_box_cam: Array
    J_pose: Array
    J_lean: Array
    J_tilt: Array


def camera_motions(problem: Problem, state: State) -> CameraMotions:
    """Return the cameras' poses and how they move with poses, lean and tilt."""
    P = len(state.poses)
    tilts = np.concatenate([state.tilt, np.zeros((len(state.tilt), 1))], axis=1)
    F = exp_so3(tilts)[problem.drive]
    R_m, t_m = state.T_body_cam[:3, :3], state.T_body_cam[:3, 3]
    leaning, J_r = _leaning(state.lean[:, :2])
    R_e = leaning @ R_m  # from the upright body frame to the camera
    t_e = leaning @ t_m
    t_e[:, 2] += state.lean[:, 2]
    Rz = headings(state.poses[:, 2])
    s = (Rz @ t_e[:, :, None])[:, :, 0]
    s[:, :2] += state.poses[:, :2]
    Q = Rz @ R_e  # R_floor_cam
    Q_t, R_e_t = np.swapaxes(Q, 1, 2), np.swapaxes(R_e, 1, 2)
    J_pose = np.zeros((P, 6, 3))
    J_pose[:, 3:, :2] = Q_t[:, :, :2]
    J_pose[:, :3, 2] = R_e[:, 2]
    J_pose[:, 3:, 2] = (R_e_t @ np.stack([-t_e[:, 1], t_e[:, 0], np.zeros(P)], axis=1)[:, :, None])[:, :, 0]
    J_lean = np.zeros((P, 6, 3))
    J_lean[:, :3, :2] = R_m.T @ J_r
    J_lean[:, 3:, :2] = R_m.T @ (-hat(t_m) @ J_r)
    J_lean[:, 3:, 2] = R_e[:, 2]
    # Tilt: R_box_floor <- R_box_floor exp(beta), beta = J dtilt.
    J = right_jacobian(tilts)[:, :, :2][problem.drive]
    J_tilt = np.concatenate([Q_t @ J, -Q_t @ (hat(s) @ J)], axis=1)
    return CameraMotions(
        R_box_cam=F @ Q, p_box_cam=np.einsum("pij,pj->pi", F, s), J_pose=J_pose, J_lean=J_lean, J_tilt=J_tilt
    )


def headings(theta: Array) -> Array:
    """Return rotations about the vertical, (P, 3, 3), by angles (P,), rad."""
    R = np.zeros((len(theta), 3, 3))
    c, s = np.cos(theta), np.sin(theta)
    R[:, 0, 0], R[:, 0, 1], R[:, 1, 0], R[:, 1, 1], R[:, 2, 2] = c, -s, s, c, 1.0
    return R


def _leaning(angles: Array) -> tuple[Array, Array]:
    """Return ``exp(roll, pitch, 0)``, (P, 3, 3), and its right derivative by (roll, pitch), (P, 3, 2)."""
    if not np.any(angles):
        return np.tile(np.eye(3), (len(angles), 1, 1)), np.tile(np.eye(3)[:, :2], (len(angles), 1, 1))
    w = np.concatenate([angles, np.zeros((len(angles), 1))], axis=1)
    return exp_so3(w), right_jacobian(w)[:, :, :2]
