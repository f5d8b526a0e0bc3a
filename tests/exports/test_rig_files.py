"""Files of a robot with several cameras, read back with readers of other programs."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest
import yaml
from urdf_parser_py import urdf as urdf_reader

from boxcal.calib.exports.files import exports
from boxcal.calib.geometry.camera_pair import between
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, rigid
from boxcal.calib.results.calibration import Calibration
from tests.exports.made_up import calibration, camera, with_cameras

BASELINE = 0.06


@pytest.fixture(scope="module")
def robot() -> Calibration:
    first = calibration().T_body_cam
    beside = first @ rigid(exp_so3(np.array([0.01, -0.02, 0.005])), np.array([BASELINE, 1e-3, -5e-4]))
    turned = rigid(exp_so3(np.array([0.0, 0.0, np.pi])), np.array([-0.1, 0.01, 0.02]))
    return with_cameras(
        right=(beside, replace(camera(), fu=612.0, fv=613.5, cu=310.0)),
        rear=(turned @ first, camera("fisheye", k2=0.1, k3=0.2, k4=0.3)),
    )


@pytest.fixture(scope="module")
def files(robot: Calibration) -> dict[str, str]:
    return {name: content.decode() for name, content in exports(robot).items()}


def test_urdf_has_all_cameras_where_they_sit(robot: Calibration, files: dict[str, str]) -> None:
    read = urdf_reader.URDF.from_xml_string(files["camera.urdf"].encode())
    joints = {joint.child: joint for joint in read.joints}
    assert len({link.name for link in read.links}) == len(read.links) == 7
    assert robot.rig is not None
    for number, seen in enumerate(robot.rig.cameras):
        link, T = "camera_optical_frame" if number == 0 else seen.frame, np.eye(4)
        while link != "base_footprint":
            joint = joints[link]
            r, p, y = (exp_so3(angle * axis) for angle, axis in zip(joint.origin.rpy, np.eye(3), strict=True))
            T, link = rigid(y @ p @ r, np.array(joint.origin.xyz)) @ T, joint.parent
        assert np.allclose(T, seen.T_body_cam, atol=1e-9)


def test_kalibr_chain_goes_from_camera_to_camera(robot: Calibration, files: dict[str, str]) -> None:
    chain = yaml.safe_load(files["camchain.yaml"])
    assert list(chain) == ["cam0", "cam1", "cam2"]
    assert "T_cn_cnm1" not in chain["cam0"]
    assert robot.rig is not None
    T = [inverse(seen.T_body_cam) for seen in robot.rig.cameras]
    for k in (1, 2):
        assert np.allclose(chain[f"cam{k}"]["T_cn_cnm1"], T[k] @ inverse(T[k - 1]), atol=1e-9)
        assert np.allclose(chain[f"cam{k}"]["T_cam_body"], T[k], atol=1e-9)
    assert [chain[f"cam{k}"]["cam_overlaps"] for k in range(3)] == [[1], [0], []]
    assert [chain[f"cam{k}"]["rostopic"] for k in (1, 2)] == ["/right/image_raw", "/rear/image_raw"]
    assert chain["cam2"]["distortion_model"] == "equidistant"


def test_opencv_reads_every_pair(robot: Calibration, files: dict[str, str]) -> None:
    pairs = sorted(name for name in files if name.startswith("opencv_stereo"))
    assert len(pairs) == 3
    assert robot.rig is not None
    seen = {c.name: c for c in robot.rig.cameras}
    for name in pairs:
        read = cv2.FileStorage(files[name], cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        a, b = (seen[read.getNode(f"camera_{k}").string()] for k in (1, 2))
        T_b_a = between(b.T_body_cam, a.T_body_cam)
        assert np.allclose(read.getNode("R").mat(), T_b_a[:3, :3], atol=1e-9)
        assert np.allclose(read.getNode("T").mat()[:, 0], T_b_a[:3, 3], atol=1e-9)
        for k, own in ((1, a), (2, b)):
            assert np.allclose(read.getNode(f"M{k}").mat(), own.camera.K, atol=1e-9)
        assert np.allclose(read.getNode("covariance").mat(), robot.rig.pair(a.name, b.name).covariance, atol=1e-15)
        assert read.getNode("Q").empty() == ("rear" in name)


def test_ros_pair_projects_points_to_one_row_with_the_baseline_as_disparity(
    robot: Calibration, files: dict[str, str]
) -> None:
    left, right = (yaml.safe_load(files[f"stereo_left_right/{side}.yaml"]) for side in ("left", "right"))
    assert robot.rig is not None
    p_body = np.array([[0.8, 0.05, 0.2], [1.5, -0.2, 0.1], [0.6, 0.0, 0.15]])
    pixels, depth = [], np.zeros(3)
    for info, own in ((left, robot.rig.cameras[0]), (right, robot.rig.cameras[1])):
        R = np.array(info["rectification_matrix"]["data"]).reshape(3, 3)
        P = np.array(info["projection_matrix"]["data"]).reshape(3, 4)
        T = inverse(own.T_body_cam)
        p = (p_body @ T[:3, :3].T + T[:3, 3]) @ R.T
        depth = p[:, 2]
        # of the second camera P takes points of the first one's rectified frame: Tx moves them over
        pixels.append((p @ P[:, :3].T)[:, :2] / p[:, 2:])
    Tx = np.array(right["projection_matrix"]["data"]).reshape(3, 4)[0, 3]
    assert left["projection_matrix"]["data"][3] == 0
    assert np.allclose(pixels[0][:, 1], pixels[1][:, 1], atol=1e-9)
    assert np.allclose(pixels[1][:, 0] - pixels[0][:, 0], Tx / depth, atol=1e-9)
    f, pair = right["projection_matrix"]["data"][0], robot.rig.pair("left", "right")
    assert np.isclose(-Tx / f, np.linalg.norm(pair.T_a_b[:3, 3]), atol=1e-9)
    assert (left["camera_name"], right["camera_name"]) == ("r01_left", "r01_right")


def test_cameras_that_look_apart_have_no_rectification(files: dict[str, str]) -> None:
    assert [name for name in files if name.startswith("stereo_")] == [
        "stereo_left_right/left.yaml",
        "stereo_left_right/right.yaml",
    ]


def test_one_camera_has_no_files_of_pairs() -> None:
    assert not [name for name in exports(calibration()) if "stereo" in name]


def test_another_camera_of_the_robot_stands_for_itself(robot: Calibration) -> None:
    assert robot.rig is not None
    rear = robot.rig.cameras[2]
    own = replace(robot, robot="r01/rear", camera=rear.camera, T_body_cam=rear.T_body_cam)
    files = exports(own)
    assert list(yaml.safe_load(files["camchain.yaml"])) == ["cam0"]
    assert not [name for name in files if "stereo" in name]


def test_frames_of_cameras_never_are_the_same_and_never_markup(robot: Calibration) -> None:
    assert robot.rig is not None
    alike = [
        replace(c, frame=frame)
        for c, frame in zip(robot.rig.cameras, ("", "camera_optical_frame", "<a b>"), strict=True)
    ]
    urdf = exports(replace(robot, rig=replace(robot.rig, cameras=tuple(alike))))["camera.urdf"]
    links = [link.attrib["name"] for link in ET.fromstring(urdf).iter("link")]
    assert len(set(links)) == 7
    assert {"right_optical_frame", "rear_optical_frame"} <= set(links)
