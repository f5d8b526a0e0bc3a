"""Slip while a rolling shutter reads a frame: its size, its elimination, and what it does to a drive's answer."""

from dataclasses import replace
from functools import cache

import numpy as np

import boxcal
from boxcal.calib.geometry.so3_se3 import inverse, log_so3, rigid
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.corner_residuals import Corners, corner_equations, corner_residuals
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.likelihood.explanation import explained_columns
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import one_time
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.rolling import with_rolling
from boxcal.calib.likelihood.moving.slip_within import equations_with_slip, slip_modes
from boxcal.calib.likelihood.moving.solve import Joint, joined, linearized
from boxcal.calib.likelihood.state import State, camera_motions
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.calib.simulate.simulated_drive import SimulatedDrive
from boxcal.target.arrays import Array

SLIP, READOUT_S = 1e-3, 0.02


@cache
def _stops() -> tuple[SimulatedDrive, Fit]:
    simulated = boxcal.simulate(options=DriveOptions(stops=8, slip=SLIP), seed=4)
    options = EstimateOptions(target=simulated.target, systematic_share=0.0)
    return simulated, fit([simulated.correspondences], None, options)


@cache
def _joint() -> Joint:
    simulated, solved = _stops()
    rng = np.random.default_rng(1)
    frames = moving_frames(
        simulated.robot, simulated.target, simulated.drive, ShutterOptions(readout_s=READOUT_S), rng
    )[::3]
    drive = replace(simulated.correspondences, moving=frames)
    noise = FrameNoise(slip=SLIP, jitter_s=1e-4, sway=0.1, scale=1.0)
    return joined(solved, [drive], np.arange(len(frames)), one_time(1), noise)


@cache
def _rolling() -> tuple[State, Corners, Array]:
    """The corners where frames take their readout time, slip within them not looked at yet, and its modes."""
    joint = _joint()
    explained = joint.state.explained.copy()
    explained[-1] = READOUT_S
    state = replace(joint.state, explained=explained)
    corners = corner_residuals(joint.problem, state, explained_columns(joint.problem, state), spare=1)
    frames = (joint.woven.course, joint.height)
    corners = with_rolling(joint.problem, state, corners, *frames)
    return state, corners, slip_modes(joint.problem, state, corners, frames, joint.within)


def test_modes_are_the_walk_of_each_wheel_from_the_middle_row_on() -> None:
    (state, corners, modes), joint = _rolling(), _joint()
    stop = joint.problem.corner_stop
    frame = int(joint.woven.moving[np.argmax(np.bincount(stop)[joint.woven.moving])])
    rows = np.flatnonzero(stop == frame)
    since = READOUT_S * (joint.problem.uv_px[rows, 1] / joint.height - 0.5)
    rate = joint.woven.course[frame, 0]
    b, n = state.wheels[2], len(state.lens)
    # Wiener processes drawn step by step, a wheel at constant speed: the robot moves and turns by them
    rng, steps, draws = np.random.default_rng(7), 200, 4000
    t = np.linspace(0, READOUT_S / 2, steps + 1)
    seen = np.zeros((draws, len(rows), 2))
    heading = state.poses[frame, 2]
    by_body = _by_body(joint, state, frame, heading)
    for side in (-1, 1):
        walk = np.zeros((draws, steps + 1, 2))
        step_m = np.abs(rate * state.wheels[:2]) * (t[1] - t[0])
        walk[:, 1:] = np.cumsum(rng.standard_normal((draws, steps, 2)) * joint.within * np.sqrt(step_m), axis=1)
        own = np.flatnonzero(np.sign(since) == side)
        at = np.rint(np.abs(since[own]) / (t[1] - t[0])).astype(int)
        body = np.stack([walk[:, at].mean(axis=2), (walk[:, at, 0] - walk[:, at, 1]) / b], axis=-1)
        seen[:, own] = np.einsum("lij,jk,dlk->dli", corners.jacobian[rows[own], :, n : n + 6], by_body, body)
    drawn = np.einsum("dli,dlj->lij", seen, seen) / draws
    told = modes[rows] @ np.swapaxes(modes[rows], 1, 2)
    far = np.abs(since) > 0.3 * READOUT_S / 2
    size = np.trace(told[far], axis1=1, axis2=2) / np.trace(drawn[far], axis1=1, axis2=2)
    assert 0.85 < np.median(size) < 1.05
    assert np.all((size > 0.75) & (size < 1.15))


def _by_body(joint: Joint, state: State, frame: int, heading: float) -> Array:
    """Return the camera's motion by a way ahead and a turn of the robot, (6, 2), by central differences."""
    columns, step = [], 1e-6
    ways = np.array([[np.cos(heading), np.sin(heading), 0.0], [0.0, 0.0, 1.0]])
    for way in ways:
        ends = []
        for sign in (-1, 1):
            poses = state.poses.copy()
            poses[frame] += sign * step * way
            motions = camera_motions(joint.problem, replace(state, poses=poses))
            ends.append(rigid(motions.R_box_cam[frame], motions.p_box_cam[frame]))
        d = inverse(ends[0]) @ ends[1]
        columns.append(np.concatenate([log_so3(d[:3, :3]), d[:3, 3]]) / (2 * step))
    return np.array(columns).T


def test_slip_is_eliminated_as_its_covariance_among_the_corners_of_a_frame_says() -> None:
    (_, corners, modes), joint = _rolling(), _joint()
    weight = np.random.default_rng(2).uniform(0.3, 1.0, len(modes))
    weight[::7] = 0.0
    left, (normal, local, squares), slipped = equations_with_slip(joint.problem, corners, weight, modes)
    assert slipped is not None
    n, P = len(normal.A), len(joint.woven.frame)
    X = np.concatenate([corners.J_shared, corners.J_pose, corners.J_local], axis=2)
    J, stop = corners.jacobian @ X[corners.group], joint.problem.corner_stop
    A, a = np.zeros((n, n)), np.zeros(n)
    for p in range(P):
        rows = np.flatnonzero((stop == p) & (weight > 0))
        G, own, r = (part[rows].reshape(2 * len(rows), -1) for part in (modes, J, corners.residual))
        C = np.diag(np.repeat(1 / weight[rows], 2)) + G @ G.T
        N, g = own.T @ np.linalg.solve(C, own), (own.T @ np.linalg.solve(C, r))[:, 0]
        A, a = A + N[:n, :n], a + g[:n]
        scale = np.abs(N).max()
        np.testing.assert_allclose(normal.D[p, :3, :3], N[n : n + 3, n : n + 3], rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(normal.B[p, :, :3], N[:n, n : n + 3], rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(local.by_shared[p], N[:n, n + 3 :], rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(local.by_chain[p, :3], N[n : n + 3, n + 3 :], rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(local.D[p], N[n + 3 :, n + 3 :], rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(local.c[p], g[n + 3 :], rtol=0, atol=1e-9 * np.abs(g).max())
        np.testing.assert_allclose(squares[p], (r.T @ np.linalg.solve(C, r))[0, 0], rtol=1e-9)
    np.testing.assert_allclose(normal.A, A, rtol=0, atol=1e-9 * np.abs(A).max())
    np.testing.assert_allclose(normal.a, a, rtol=0, atol=1e-9 * np.abs(a).max())
    assert np.sum(left.residual**2) < np.sum(corners.residual**2)
    assert 0 < slipped.freedom.sum() < 12 * len(joint.woven.moving)


def test_frames_read_at_once_have_no_slip_within() -> None:
    joint = _joint()
    at = linearized(joint, joint.state)
    assert at.slipped is None
    assert at.taken_by_slip == 0
    plain = corner_equations(joint.problem, at.corners, joint.weights.corners)
    np.testing.assert_array_equal(at.corner_normal.A, plain[0].A)
