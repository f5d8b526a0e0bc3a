"""The box as a landmark for localisation: an ArUco board for OpenCV, and ``tags.yaml`` for apriltag_ros.

Both hold all tags in frame ``box``, so that what they find is the camera's pose against the box.
"""

from collections.abc import Mapping

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from boxcal.target.arrays import Array
from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256

APRILTAG_FAMILIES = {
    "DICT_APRILTAG_16h5": "16h5",
    "DICT_APRILTAG_25h9": "25h9",
    "DICT_APRILTAG_36h10": "36h10",
    "DICT_APRILTAG_36h11": "36h11",
}
"""OpenCV's dictionaries and what apriltag_ros calls them."""


def opencv_board(target: Target) -> bytes:
    """Return the box as an OpenCV FileStorage (YAML) that an ``aruco.Board`` is made of.

    It holds ``dictionary`` (OpenCV's name), ``ids`` (N, 1) and ``object_points`` (4 N, 3): corners in m, frame ``box``,
    top left first and clockwise, as ``cv2.aruco`` finds them.
    """
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.writeComment(
        f"Landmark box, target {target_sha256(target)[:12]}; metres, origin at the centre of the base, z up.\n"
        "board = cv2.aruco.Board(object_points.astype(np.float32).reshape(-1, 4, 3), dictionary, ids)"
    )
    storage.write("dictionary", target.box.dictionary)
    storage.write("ids", target.tag_ids.astype(np.int32).reshape(-1, 1))
    storage.write("object_points", np.ascontiguousarray(target.tag_corners.reshape(-1, 3)))
    return str(storage.releaseAndGetString()).encode()


def apriltag_ros_files(target: Target) -> Mapping[str, bytes]:
    """Return configurations of apriltag_ros, name -> content; empty where the family is none of AprilTag's.

    ``tags.yaml`` is ROS 1's: one bundle whose frame is ``box``. ``tags_ros2.yaml`` is ROS 2's, which has no bundles:
    each tag is a frame of its own, whose pose in the box ``tags.yaml`` gives.
    """
    family = APRILTAG_FAMILIES.get(target.box.dictionary)
    if family is None:
        return {}
    return {"tags.yaml": _bundle(target).encode(), "tags_ros2.yaml": _ros2(target, family).encode()}


def tag_poses(target: Target) -> tuple[Array, Array]:
    """Return each tag's pose ``T_box_tag`` (N, 4, 4), m, x right, y up and z out of it, and its side (N,), m.

    The square that fits the corners best: a tag printed at unlike scales across and up has their mean.
    """
    corners = target.tag_corners
    right = (corners[:, 1] - corners[:, 0] + corners[:, 2] - corners[:, 3]) / 2
    up = (corners[:, 0] - corners[:, 3] + corners[:, 1] - corners[:, 2]) / 2
    sides = np.linalg.norm([right, up], axis=2)
    x, y = right / sides[0, :, None], up / sides[1, :, None]
    z = np.cross(x, y)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    T = np.tile(np.eye(4), (len(corners), 1, 1))
    T[:, :3, 0], T[:, :3, 1], T[:, :3, 2], T[:, :3, 3] = x, np.cross(z, x), z, corners.mean(axis=1)
    return T, sides.mean(axis=0)


def _bundle(target: Target) -> str:
    lines = [
        f"# Landmark box, target {target_sha256(target)[:12]}, for apriltag_ros (ROS 1); m, frame of the box: z up.",
        "standalone_tags: []",
        "tag_bundles:",
        "  - name: landmark_box",
        "    layout:",
    ]
    poses, sides = tag_poses(target)
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    for tag, T, side, (qx, qy, qz, qw) in zip(target.tag_ids, poses, sides, quaternions, strict=True):
        x, y, z = T[:3, 3]
        lines.append(
            f"      - {{id: {tag}, size: {side:.9g}, x: {x:.9f}, y: {y:.9f}, z: {z:.9f}, "
            f"qw: {qw:.9f}, qx: {qx:.9f}, qy: {qy:.9f}, qz: {qz:.9f}}}"
        )
    return "\n".join(lines) + "\n"


def _ros2(target: Target, family: str) -> str:
    _, sides = tag_poses(target)
    ids = ", ".join(str(tag) for tag in target.tag_ids)
    frames = ", ".join(f"landmark_box_tag_{tag}" for tag in target.tag_ids)
    return (
        f"# Landmark box, target {target_sha256(target)[:12]}, for apriltag_ros (ROS 2); lengths in m.\n"
        "/**:\n"
        "  ros__parameters:\n"
        f"    family: {family}\n"
        f"    size: {float(np.mean(sides)):.9g}\n"
        "    tag:\n"
        f"      ids: [{ids}]\n"
        f"      frames: [{frames}]\n"
        f"      sizes: [{', '.join(f'{side:.9g}' for side in sides)}]\n"
    )
