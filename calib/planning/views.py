"""Visibility of the box's tags from many places at once."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.state import headings
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array, Mask
from boxcal.target.box import FACES, Target
from boxcal.target.camera.camera_model import project
from boxcal.target.camera.undistort import radius_limit

_MARGIN = 0.02
"""How far tags stay off the image's border, as a fraction of its width: robots do not stop to the millimetre."""
_STEEPEST = 0.2
"""Cosine of the largest angle off a face's normal at which its tags are read reliably."""


def camera_poses(robot: Robot, poses: Array) -> Array:
    """Return where the camera is, (N, 4, 4), m, of a robot at x, y, heading (N, 3) on a level floor."""
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    T[:, :3, :3] = headings(poses[:, 2])
    T[:, :2, 3] = poses[:, :2]
    return np.asarray(T @ robot.T_body_cam)


def tags_seen(robot: Robot, target: Target, poses: Array, min_side_px: float, margin: float = _MARGIN) -> Mask:
    """Return which tags are read from each pose, (N, T) bool.

    Parameters
    ----------
    robot
        Camera, image size and extrinsics.
    target
        The box.
    poses : (N, 3), m and rad
        x, y, heading of the body.
    min_side_px : px
        Shortest side of a tag that is read reliably.
    margin
        How far they stay off the border, as a fraction of the image's width.
    """
    T_box_cam = camera_poses(robot, poses)
    seen = _slants(target, T_box_cam[:, :3, 3]) > _STEEPEST
    view, tag = np.nonzero(seen)
    T = inverse(T_box_cam)[view]
    p_cam = target.tag_corners[tag] @ T[:, :3, :3].swapaxes(1, 2) + T[:, None, :3, 3]  # (M, 4, 3): no others
    uv = project(robot.camera, p_cam)
    with np.errstate(divide="ignore"):
        rho = np.hypot(p_cam[..., 0], p_cam[..., 1]) / p_cam[..., 2]
    limit = radius_limit(robot.camera.kind, np.array(robot.camera.distortion))
    reached = np.all((p_cam[..., 2] > 0) & (rho < limit), axis=1)
    width, height = robot.image_size
    low = margin * width - 0.5
    inside = np.all((uv >= low) & (uv <= (width - 1 - low, height - 1 - low)), axis=(1, 2))
    edge = uv - np.roll(uv, -1, axis=1)
    seen[seen] = reached & inside & (np.hypot(edge[..., 0], edge[..., 1]).min(axis=1) >= min_side_px)
    return np.asarray(seen)


def _slants(target: Target, cameras: Array) -> Array:
    """Return the cosines of the angles off each tag's normal, (N, T), at which it is seen from places (N, 3), m."""
    corners = target.tag_corners
    centre = corners.mean(axis=1)
    inward = np.cross(corners[:, 2] - corners[:, 1], corners[:, 0] - corners[:, 1])
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    square = np.sum(centre**2, axis=1) - 2 * cameras @ centre.T + np.sum(cameras**2, axis=1)[:, None]
    return np.asarray((np.sum(inward * centre, axis=1) - cameras @ inward.T) / np.sqrt(square))


def tags_by_face(target: Target, seen: Mask) -> Array:
    """Return how many tags of each face are among those seen (N, T): (N, FACES)."""
    return np.stack([seen[:, target.tag_faces == f].sum(axis=1) for f in range(FACES)], axis=1)
