"""Information of a stop's image on the shared unknowns and on where the robot stands."""

from dataclasses import replace

import numpy as np

from boxcal.calib.geometry.diff_drive import Legs
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.corner_residuals import corner_residuals
from boxcal.calib.likelihood.explanation import explained_columns
from boxcal.calib.likelihood.picture_blocks import group_blocks
from boxcal.calib.likelihood.problem import LOCAL, Problem, problem_of
from boxcal.calib.likelihood.seen_views import Views
from boxcal.calib.likelihood.state import State, resting
from boxcal.calib.planning.assumptions import Model
from boxcal.calib.planning.views import camera_poses
from boxcal.target.arrays import Array, Mask
from boxcal.target.box import CORNERS
from boxcal.target.camera.camera_model import project


def expected_views(model: Model, poses: Array, seen: Mask) -> Views:
    """Return what cameras at poses (N, 3) would see, exactly, of the tags (N, T) that they read."""
    robot, target = model.robot, model.target
    T_cam_box = inverse(camera_poses(robot, poses))
    view, tag = np.nonzero(seen)
    p_box = target.tag_corners[tag]  # (M, CORNERS, 3)
    T = T_cam_box[view]
    p_cam = p_box @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    ids = CORNERS * np.asarray(target.tag_ids)[tag, None] + np.arange(CORNERS)
    count = np.count_nonzero(seen, axis=1)
    return Views(
        landmark_ids=ids.ravel(),
        faces=np.repeat(target.tag_faces[tag], CORNERS),
        p_box=p_box.reshape(-1, 3),
        uv_px=project(robot.camera, p_cam.reshape(-1, 3)),
        cov_px2=np.tile(np.eye(2) * model.assumptions.corner_px**2, (ids.size, 1, 1)),
        starts=CORNERS * np.append(0, np.cumsum(count)),
    )


def expected_problem(model: Model, poses: Array, seen: Mask) -> tuple[Problem, State]:
    """Return the likelihood's data and state for images at poses (N, 3), without wheels."""
    options = replace(model.options, lens=model.robot.camera.kind)
    still = np.zeros(0)
    legs = Legs(dphi_R=still, dphi_L=still, ends=(0,) * len(poses), known=np.zeros(len(poses) - 1, dtype=np.bool_))
    places = np.zeros(len(poses), dtype=np.int64), np.arange(len(poses))
    views = expected_views(model, poses, seen)
    problem = problem_of(views, places, [legs], options, model.assumptions.encoder_step)
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
    """Return the information of each image about the shared unknowns and its stop's pose, (N, n + 3, n + 3).

    Priors are not in it; lean, height and growth are eliminated.
    """
    corners, N = corner_residuals(problem, state, explained_columns(problem, state)), len(problem.drive)
    H = group_blocks(corners, np.ones(len(problem.uv_px)))[0] * model.components.noise_scale**-2
    maps = np.concatenate([corners.J_shared, corners.J_pose, corners.J_local * model.components.local_sigma], axis=2)
    first = np.searchsorted(corners.group_stop, np.arange(N))
    full = np.add.reduceat(np.swapaxes(maps, 1, 2) @ H @ maps, first, axis=0)
    own = full[:, -LOCAL:, -LOCAL:] + np.eye(LOCAL)
    across = full[:, :-LOCAL, -LOCAL:]
    return np.asarray(full[:, :-LOCAL, :-LOCAL] - across @ np.linalg.solve(own, np.swapaxes(across, 1, 2)))
