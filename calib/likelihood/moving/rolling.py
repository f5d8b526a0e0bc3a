"""Rolling shutter: rows of a frame on the move are seen one after the other."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_so3
from boxcal.calib.likelihood.corner_residuals import Corners
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.moving.course import rates_after, turned
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import CameraMotions, State, camera_motions
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import project_with_jacobians

ROLLING = "camera_readout"
PRIOR_S = 0.01
"""Standard deviation of the readout time beforehand, s: many cameras read all rows at once, few take 30 ms."""
_SHORT_S = 1e-4
"""A shorter readout moves corners in proportion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Readout:
    """Readout time of a frame as an unknown; its columns differ from corner to corner, see :func:`with_rolling`."""

    @property
    def names(self) -> tuple[str, ...]:
        """Its one unknown, s: positive if upper rows are seen first."""
        return (ROLLING,)

    @property
    def prior(self) -> tuple[float, ...]:
        """Standard deviation beforehand, s."""
        return (PRIOR_S,)

    def columns(self, problem: Problem, state: State) -> Columns:  # noqa: ARG002 (see the class)
        """Return nothing: no stop sees it."""
        return Columns()


def with_rolling(problem: Problem, state: State, corners: Corners, course: Array, height: int) -> Corners:
    """Return the corners with the readout time, which is the last of the shared unknowns.

    The middle row is seen at the frame's time, rows above it earlier, the robot rolling on as its wheels tell.

    Parameters
    ----------
    problem, state, corners
        The corners about a state, all rows seen at once.
    course : (P, 3, 2)
        How the wheels turn at each stop and frame: see :mod:`boxcal.calib.likelihood.moving.course`; 0 at stops.
    height : px
        Of the images.
    """
    motions, stop = camera_motions(problem, state), problem.corner_stop
    by_body = motions.J_pose @ _to_floor(state)
    n = len(state.lens)
    row = problem.uv_px[:, 1] / height - 0.5
    since = float(state.explained[-1]) * row
    by_motion = corners.jacobian[:, :, n : n + 6]
    twist = _twists(state, by_body, stop, rates_after(course[stop], since))
    column = (by_motion @ twist[:, :, None])[:, :, 0] * row[:, None]
    way = _twists(state, by_body, stop, turned(course[stop], since))
    moved = (by_motion @ way[:, :, None])[:, :, 0]
    if abs(float(state.explained[-1])) > _SHORT_S:
        moved = (problem.whiten @ _moved(problem, state, motions, way)[:, :, None])[:, :, 0]
    G, m, n_shared = corners.J_shared.shape
    J_shared = np.zeros((G, m + 1, n_shared))
    J_shared[:, :m], J_shared[:, m, -1] = corners.J_shared, 1.0
    below = ((0, 0), (0, 1), (0, 0))
    return replace(
        corners,
        residual=corners.residual - moved,
        jacobian=np.concatenate([corners.jacobian, column[:, :, None]], axis=2),
        J_shared=J_shared,
        J_pose=np.pad(corners.J_pose, below),
        J_local=np.pad(corners.J_local, below),
    )


def motions_px_s(problem: Problem, corners: Corners, state: State, course: Array) -> Array:
    """Return how fast the corners of each stop and frame move through the picture, on average, (P, 2) px/s.

    Arguments as of :func:`with_rolling`.
    """
    stop, n = problem.corner_stop, len(state.lens)
    twist = _twists(state, camera_motions(problem, state).J_pose @ _to_floor(state), stop, course[stop, 0])
    whitened = corners.jacobian[:, :, n : n + 6] @ twist[:, :, None]
    moving = np.linalg.solve(problem.whiten, whitened)[:, :, 0]
    P = len(state.poses)
    count = np.maximum(np.bincount(stop, minlength=P), 1)
    return np.stack([np.bincount(stop, weights=moving[:, k], minlength=P) / count for k in (0, 1)], axis=1)


def _to_floor(state: State) -> Array:
    """Return what turns motions ahead and turns of the robot into motions of its pose on the floor, (P, 3, 2)."""
    theta = state.poses[:, 2]
    out = np.zeros((len(theta), 3, 2))
    out[:, 0, 0], out[:, 1, 0], out[:, 2, 1] = np.cos(theta), np.sin(theta), 1.0
    return out


def twists_of_wheels(problem: Problem, state: State, wheels: Array) -> Array:
    """Return the camera's motions for turns of the wheels (L, 2), rad, at each corner; see :func:`with_rolling`."""
    by_body = camera_motions(problem, state).J_pose @ _to_floor(state)
    return _twists(state, by_body, problem.corner_stop, wheels)


def _twists(state: State, by_body: Array, stop: Ids, wheels: Array) -> Array:
    """Return the camera's motions, (L, 6), as right perturbations of ``T_box_cam``, for turns of the wheels (L, 2)."""
    rR, rL, b = state.wheels
    way = np.stack([(wheels @ np.array([rR, rL])) / 2, (wheels @ np.array([rR, -rL])) / b], axis=1)
    return np.asarray((by_body[stop] @ way[:, :, None])[:, :, 0])


def _moved(problem: Problem, state: State, motions: CameraMotions, motion: Array) -> Array:
    """Return how far corners move, (L, 2) px, if the camera moves otherwise for each, (L, 6)."""
    stop = problem.corner_stop
    R = motions.R_box_cam[stop]
    p_box, _ = problem.target.landmarks(state.shape)
    p = (np.swapaxes(R, 1, 2) @ (p_box - motions.p_box_cam[stop])[:, :, None])[:, :, 0]
    turn, way = motion[:, :3], motion[:, 3:]
    way = way + np.cross(turn, way) / 2
    after = (np.swapaxes(exp_so3(turn), 1, 2) @ (p - way)[:, :, None])[:, :, 0]
    ends = [project_with_jacobians(problem.lens, state.lens, x)[0] for x in (p, after)]
    return np.asarray(ends[1] - ends[0])
