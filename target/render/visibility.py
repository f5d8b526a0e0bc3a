"""Visibility of the box's tags to a camera, and checks of poses and image sizes."""

import numpy as np

from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Box, Target
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.camera.undistort import radius_limit
from boxcal.target.errors import TargetError
from boxcal.target.render.sides import BOTTOM, sides_facing

MAX_SIDE_PX = 16_384
"""Longest side of an image, px: more than any camera's."""


def visible_tags(
    target: Target, camera: CameraModel, T_cam_box: Array, image_size: tuple[int, int], margin_px: float = 0.0
) -> Ids:
    """Return the ids of the tags that lie wholly inside the image, on faces turned to the camera.

    Parameters
    ----------
    target, camera, T_cam_box, image_size
        As for :func:`render`.
    margin_px : px
        How far from the image's border all four corners must stay; the border runs half a pixel outside the
        outermost pixel centres.

    Returns
    -------
    (N,), ascending.
    """
    width, height = checked_size(image_size)
    T_cam_box = checked_pose(T_cam_box, target.box)
    faces = np.zeros(BOTTOM + 1, dtype=np.bool_)
    faces[sides_facing(target.box, T_cam_box)] = True
    p_cam = target.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
    rows = np.flatnonzero(faces[target.tag_faces] & np.all(p_cam[..., 2] > 0, axis=1))
    p_cam = p_cam[rows]
    uv_px = project(camera, p_cam)
    rho = np.hypot(p_cam[..., 0], p_cam[..., 1]) / p_cam[..., 2]
    reached = np.all(rho < radius_limit(camera.kind, np.array(camera.distortion)), axis=1)
    low = margin_px - 0.5
    inside = np.all((uv_px >= low) & (uv_px <= (width - 1 - low, height - 1 - low)), axis=(1, 2))
    return np.asarray(np.sort(target.tag_ids[rows[reached & inside]]))


def checked_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return (width, height), px, as whole numbers.

    Raises
    ------
    TargetError
        If no image has such a size.
    """
    width, height = image_size
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX):
        raise TargetError(f"image size {width} x {height}: 1 to {MAX_SIDE_PX} px a side are needed")
    return int(width), int(height)


def checked_pose(T_cam_box: Array, box: Box) -> Array:
    """Return a pose (4, 4) of the box before a camera.

    Raises
    ------
    TargetError
        If it is not rigid, or the camera is inside the box.
    """
    T = np.asarray(T_cam_box, dtype=np.float64)
    rigid = T.shape == (4, 4) and bool(np.isfinite(T).all())
    rigid = rigid and np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() < 1e-6 and np.linalg.det(T[:3, :3]) > 0
    if not rigid:
        raise TargetError("T_cam_box: not a rigid pose, a finite (4, 4) matrix with a rotation in it is needed")
    if not sides_facing(box, T):
        x, y, z = -T[:3, :3].T @ T[:3, 3]
        raise TargetError(
            f"T_cam_box: the camera is inside the box, at ({x:.3f}, {y:.3f}, {z:.3f}) m", remedy="move it out"
        )
    return T
