"""Information of a stop's picture on the shared unknowns and on where the robot stands."""

from dataclasses import replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.corner_residuals import corner_residuals
from boxcal.calib.likelihood.corner_sums import groups_of
from boxcal.calib.likelihood.explanation import explained_columns
from boxcal.calib.likelihood.problem import LOCAL, Problem, build_problem
from boxcal.calib.likelihood.state import State, resting
from boxcal.calib.planning.assumptions import Model
from boxcal.calib.planning.views import camera_poses
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Mask
from boxcal.target.box import CORNERS
from boxcal.target.camera.camera_model import project


def expected_drive(model: Model, poses: Array, seen: Mask) -> Correspondences:
    """Return what cameras at poses (N, 3) would see, exactly, of the tags (N, T) that they read; wheels stand still."""
    robot, target, sigma = model.robot, model.target, model.assumptions.corner_px
    T_cam_box = inverse(camera_poses(robot, poses))
    stops = []
    for j, (T, tags) in enumerate(zip(T_cam_box, seen, strict=True)):
        rows = np.flatnonzero(tags)
        p_box = target.tag_corners[rows].reshape(-1, 3)
        stops.append(
            StopObservation(
                t_start_ns=2 * j,
                t_end_ns=2 * j + 1,
                first_sample=2 * j,
                last_sample=2 * j + 1,
                phi_R=0.0,
                phi_L=0.0,
                landmark_ids=(CORNERS * target.tag_ids[rows, None] + np.arange(CORNERS)).ravel(),
                p_box=p_box,
                uv_px=project(robot.camera, p_box @ T[:3, :3].T + T[:3, 3]),
                cov_px2=np.broadcast_to(np.eye(2) * sigma**2, (len(p_box), 2, 2)),
                faces=np.repeat(target.tag_faces[rows], CORNERS),
                frames=1,
            )
        )
    still = np.zeros(2 * len(stops))
    wheels = WheelSamples(t_ns=np.arange(2 * len(stops)), phi_R=still, phi_L=still, encoder_steps=(0.0, 0.0))
    return Correspondences(robot=robot.name, image_size=robot.image_size, wheels=wheels, stops=tuple(stops))


def expected_problem(model: Model, poses: Array, seen: Mask) -> tuple[Problem, State]:
    """Return the likelihood's data and state for pictures at poses (N, 3), without wheels."""
    drive = expected_drive(model, poses, seen)
    options = replace(model.options, lens=model.robot.camera.kind)
    problem = build_problem([drive], [tuple(range(len(poses)))], options, model.assumptions.encoder_step)
    robot = model.robot
    state = resting(
        problem,
        lens=robot.camera.values,
        wheels=np.array([robot.rR, robot.rL, robot.b]),
        T_body_cam=robot.T_body_cam,
        poses=poses,
    )
    return problem, state


def picture_information(model: Model, problem: Problem, state: State) -> Array:
    """Return what each picture tells of the shared unknowns and its stop's pose, (N, n + 3, n + 3).

    Priors are not in it; lean, height and growth are eliminated.
    """
    corners = corner_residuals(problem, state, explained_columns(problem, state))
    m, G, N = corners.jacobian.shape[2], len(corners.group_stop), len(problem.drive)
    rows = [corners.jacobian[at].reshape(-1, m) for at in groups_of(corners.group, G)]
    H = np.array([part.T @ part for part in rows]) * model.components.noise_scale**-2
    maps = np.concatenate([corners.J_shared, corners.J_pose, corners.J_local * model.components.local_sigma], axis=2)
    first = np.searchsorted(corners.group_stop, np.arange(N))
    full = np.add.reduceat(np.swapaxes(maps, 1, 2) @ H @ maps, first, axis=0)
    own = full[:, -LOCAL:, -LOCAL:] + np.eye(LOCAL)
    across = full[:, :-LOCAL, -LOCAL:]
    return np.asarray(full[:, :-LOCAL, :-LOCAL] - across @ np.linalg.solve(own, np.swapaxes(across, 1, 2)))
