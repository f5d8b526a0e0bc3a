"""Rolling shutter: rows of a frame on the move are seen one after the other."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_so3
from boxcal.calib.likelihood.corner_residuals import Corners
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.moving.course import rates_after, turned
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State, camera_motions
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

    The middle row is seen at the frame's time, rows above it earlier, the robot rolling on as its wheels measure.

    Parameters
    ----------
    problem, state, corners
        The corners about a state, all rows seen at once, with one spare column: it is filled.
    course : (P, 3, 2)
        How the wheels turn at each stop and frame: see :mod:`boxcal.calib.likelihood.moving.course`; 0 at stops.
    height : px
        Of the images.
    """
    stop, n = problem.corner_stop, len(state.lens)
    rows = np.flatnonzero(np.any(course != 0, axis=(1, 2))[stop])  # no row of a stop's image moves
    course, row = course[stop[rows]], problem.uv_px[rows, 1] / height - 0.5
    readout = float(state.explained[-1])
    since = readout * row
    by_motion, rolling = corners.jacobian[rows, :, n : n + 6], _rolling(corners, state, rows)
    moved = np.zeros(corners.residual.shape)
    twist = _twists(state, rolling, rates_after(course, since))
    corners.jacobian[rows, :, -1] = (by_motion @ twist[:, :, None])[:, :, 0] * row[:, None]
    corners.J_shared[:, -1, -1] = 1.0
    motion = _twists(state, rolling, turned(course, since))
    if abs(readout) > _SHORT_S:
        moved[rows] = (problem.whiten[rows] @ _moved(problem, state, rows, motion)[:, :, None])[:, :, 0]
    else:
        moved[rows] = (by_motion @ motion[:, :, None])[:, :, 0]
    return replace(corners, residual=corners.residual - moved)


def motions_px_s(problem: Problem, corners: Corners, state: State, course: Array) -> Array:
    """Return how fast the corners of each stop and frame move through the image, on average, (P, 2) px/s.

    Arguments as of :func:`with_rolling`.
    """
    stop, n = problem.corner_stop, len(state.lens)
    twist = _twists(state, _rolling(corners, state, np.arange(len(stop))), course[stop, 0])
    whitened = corners.jacobian[:, :, n : n + 6] @ twist[:, :, None]
    moving = np.linalg.solve(problem.whiten, whitened)[:, :, 0]
    P = len(state.poses)
    count = np.maximum(np.bincount(stop, minlength=P), 1)
    return np.stack([np.bincount(stop, weights=moving[:, k], minlength=P) / count for k in (0, 1)], axis=1)


def twists_of_wheels(corners: Corners, state: State, wheels: Array) -> Array:
    """Return the camera's motions for turns of the wheels (L, 2), rad, at each corner; see :func:`with_rolling`."""
    return _twists(state, _rolling(corners, state, np.arange(len(corners.group))), wheels)


def _rolling(corners: Corners, state: State, rows: Ids) -> Array:
    """Return the camera's motions, (R, 6, 2), as right perturbations of ``T_box_cam``, as the robot rolls and turns.

    Of some corners, (R,).
    """
    n, theta = len(state.lens), state.poses[corners.group_stop, 2]
    to_floor = np.zeros((len(theta), 3, 2))
    to_floor[:, 0, 0], to_floor[:, 1, 0], to_floor[:, 2, 1] = np.cos(theta), np.sin(theta), 1.0
    return np.asarray((corners.J_pose[:, n : n + 6] @ to_floor)[corners.group[rows]])


def _twists(state: State, rolling: Array, wheels: Array) -> Array:
    """Return the camera's motions, (R, 6), for turns of the wheels (R, 2), rad, by those of :func:`_rolling`."""
    rR, rL, b = state.wheels
    body = np.stack([(wheels @ np.array([rR, rL])) / 2, (wheels @ np.array([rR, -rL])) / b], axis=1)
    return np.asarray((rolling @ body[:, :, None])[:, :, 0])


def _moved(problem: Problem, state: State, rows: Ids, motion: Array) -> Array:
    """Return how far some corners (R,) move, (R, 2) px, if the camera moves otherwise for each, (R, 6)."""
    motions, stop = camera_motions(problem, state), problem.corner_stop[rows]
    R = motions.R_box_cam[stop]
    p_box = problem.target.landmarks(state.shape)[0][rows]
    p = (np.swapaxes(R, 1, 2) @ (p_box - motions.p_box_cam[stop])[:, :, None])[:, :, 0]
    turn, shift = motion[:, :3], motion[:, 3:]
    shift = shift + np.cross(turn, shift) / 2
    after = (np.swapaxes(exp_so3(turn), 1, 2) @ (p - shift)[:, :, None])[:, :, 0]
    ends = [project_with_jacobians(problem.lens, state.lens, x)[0] for x in (p, after)]
    return np.asarray(ends[1] - ends[0])
