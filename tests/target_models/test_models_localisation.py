"""The box as others localise by it: OpenCV's board and apriltag_ros's bundle find the pose that was rendered."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from boxcal.target.box import Box, Target, make_target
from boxcal.target.camera.camera_model import CameraModel
from boxcal.target.models.localisation import apriltag_ros_files, opencv_board, tag_poses
from boxcal.target.render.pictures import looking
from boxcal.target.render.renderer import SensorModel, render
from boxcal.target.tags.families import load_dictionary


def test_opencvs_board_finds_the_camera(tmp_path: Path) -> None:
    target, camera = make_target(), CameraModel(fu=700.0, fv=700.0, cu=319.5, cv=239.5, kr=0.0)
    (tmp_path / "board.yml").write_bytes(opencv_board(target))
    storage = cv2.FileStorage(str(tmp_path / "board.yml"), cv2.FILE_STORAGE_READ)
    ids, points = (storage.getNode(name).mat() for name in ("ids", "object_points"))
    dictionary = load_dictionary(storage.getNode("dictionary").string())
    np.testing.assert_allclose(points.reshape(-1, 4, 3), target.tag_corners, atol=1e-15)
    board = cv2.aruco.Board(points.astype(np.float32).reshape(-1, 4, 3), dictionary, ids)
    T = looking(np.array([0.5, 0.28, 0.22]), np.array([0.0, 0.0, 0.1]))
    picture = render(target, camera, T, (640, 480), SensorModel(psf_px=0.5))
    corners, found, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(picture)
    assert len(found) > 40
    p_box, uv_px = board.matchImagePoints(corners, found)
    _, rotation, translation = cv2.solvePnP(p_box, uv_px, camera.K, np.zeros(4))
    assert translation.ravel() == pytest.approx(T[:3, 3], abs=2e-3)
    assert cv2.Rodrigues(rotation)[0] == pytest.approx(T[:3, :3], abs=3e-3)


@pytest.mark.parametrize("case", ["small", "built wrong"])
def test_apriltag_ros_places_every_corner_where_the_target_does(case: str, wrong_target: Target) -> None:
    target = make_target(Box(width=0.12, depth=0.13, columns=3)) if case == "small" else wrong_target
    files = apriltag_ros_files(target)
    (bundle,) = yaml.safe_load(files["tags.yaml"])["tag_bundles"]
    assert [tag["id"] for tag in bundle["layout"]] == target.tag_ids.tolist()
    for tag, wanted in zip(bundle["layout"], target.tag_corners, strict=True):
        w, x, y, z = (tag[q] for q in ("qw", "qx", "qy", "qz"))
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        s = tag["size"] / 2  # apriltag_ros: x right, y up, z out of the tag
        corners = np.array([[-s, s, 0], [s, s, 0], [s, -s, 0], [-s, -s, 0]]) @ R.T + (tag["x"], tag["y"], tag["z"])
        assert corners == pytest.approx(wanted, abs=2e-8 if case == "small" else 1e-4)
    ros2 = yaml.safe_load(files["tags_ros2.yaml"])["/**"]["ros__parameters"]
    assert ros2["family"] == "36h11"
    assert ros2["tag"]["ids"] == target.tag_ids.tolist()
    assert len(set(ros2["tag"]["frames"])) == len(target.tag_ids)
    assert ros2["tag"]["sizes"] == pytest.approx(tag_poses(target)[1].tolist(), rel=1e-8)


def test_families_that_apriltag_ros_does_not_read_have_no_file() -> None:
    box = Box(columns=3, rows=2, tag_size=0.06, pitch=0.071, dictionary="DICT_4X4_250")
    assert apriltag_ros_files(make_target(box)) == {}
    assert b"DICT_4X4_250" in opencv_board(make_target(box))
