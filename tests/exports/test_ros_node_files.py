"""Parameter and launch files for ROS 2 nodes reach their node, and mean there what the calibration says."""

import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest
import xacro
import yaml
from made_up import EVIL, calibration, camera, detail, matrix_of
from rcl_parameters import launched, node_parameters

from boxcal.calib.exports.files import STALE_FILES, exports
from boxcal.calib.exports.names import Names, names_for
from boxcal.calib.exports.odometry_noise import odometry_noise
from boxcal.calib.exports.ros_amcl import UPDATE_TURN, UPDATE_WAY, amcl_alphas
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Nominal, Settings
from boxcal.detect.log.source import Source
from boxcal.target.camera.camera_model import project

NOMINAL = Nominal(wheel_radius=0.033, wheel_separation=0.16, source="robot.yaml")
OWN = {"wheel_separation": 0.2, "wheel_radius": 0.05, "wheel_separation_multiplier": 1.5}
"""What a robot's own parameters say of its wheels before it is calibrated."""
BURGER = """
/**:
  turtlebot3_node:
    ros__parameters:
      opencr: {id: 200}
      wheels: {separation: 0.160, radius: 0.033}
/**:
  diff_drive_controller:
    ros__parameters: {odometry: {publish_tf: true}}
"""
"""Laid out as the driver's own file: one key twice."""


def files_of(made: Calibration, **names: str) -> dict[str, str]:
    return {name: content.decode() for name, content in exports(made, NOMINAL, Names(**names)).items()}


def wheels_of(parameters: dict[str, Any]) -> tuple[float, float, float]:
    """Radii and separation as diff_drive_controller takes them from its parameters."""
    r = parameters["wheel_radius"]
    separation = parameters["wheel_separation"] * parameters["wheel_separation_multiplier"]
    return r * parameters["right_wheel_radius_multiplier"], r * parameters["left_wheel_radius_multiplier"], separation


@pytest.mark.parametrize("node", ["/diff_drive_controller", "/r01/diff_drive_controller"])
@pytest.mark.parametrize("own", ["file", "file under /**", "both", "dictionary", "dictionary of a named node"])
def test_the_controllers_file_wins_over_a_robots_own_parameters(node: str, own: str) -> None:
    by_name = yaml.safe_dump({node: {"ros__parameters": OWN}})
    wild = yaml.safe_dump({"/**": {"ros__parameters": OWN}})
    setups = {
        "file": [by_name],
        "file under /**": [wild],
        "both": [wild, by_name],
        "dictionary": [launched(None, OWN)],
        "dictionary of a named node": [launched(node, OWN)],
    }
    made = calibration(detail=detail())
    found = node_parameters(node, *setups[own], files_of(made)["diff_drive_controller.yaml"])
    w = made.wheels
    assert wheels_of(found) == pytest.approx((w.rR, w.rL, w.b), rel=1e-12)
    assert len(found["pose_covariance_diagonal"]) == len(found["twist_covariance_diagonal"]) == 6


def test_the_model_of_rcl_shows_what_a_key_of_wildcards_loses() -> None:
    calibrated = yaml.safe_dump({"/**": {"ros__parameters": {"wheel_radius": 0.033}}})
    clock = yaml.safe_dump({"/**": {"ros__parameters": {"use_sim_time": False}}})
    own = yaml.safe_dump({"diff_drive_controller": {"ros__parameters": OWN}})
    assert node_parameters("/diff_drive_controller", clock, own, calibrated)["wheel_radius"] == OWN["wheel_radius"]


def test_turtlebot3s_driver_gets_separation_and_mean_radius() -> None:
    made = calibration(detail=detail())
    text = files_of(made)["turtlebot3_node.yaml"]
    for node in ("/turtlebot3_node", "/r01/turtlebot3_node"):
        found = node_parameters(node, BURGER, text)
        assert found["wheels.separation"] == made.wheels.b
        assert found["wheels.radius"] == pytest.approx((made.wheels.rR + made.wheels.rL) / 2, rel=1e-12)
        assert found["opencr.id"] == 200
    drift = re.search(r"leaves ([-+.\d]+) deg a metre", text)
    assert drift is not None
    # one metre by the mean radius: how far the two wheels' ways differ, over the separation
    turns = 1 / ((made.wheels.rR + made.wheels.rL) / 2)
    assert float(drift[1]) == pytest.approx(
        np.degrees(turns * (made.wheels.rR - made.wheels.rL) / made.wheels.b), abs=5e-3
    )


def test_amcls_alphas_give_the_scatter_of_slipping_wheels() -> None:
    made = calibration(detail=detail())
    noise = odometry_noise(made)
    assert noise is not None
    alphas, rng, b = amcl_alphas(made), np.random.default_rng(1), made.wheels.b
    # sizes of wheels as the calibration may be off, and slip of each wheel: many drives of one update
    count = 200_000
    heading_off = rng.normal(0, noise.heading_per_m * UPDATE_WAY, count)
    slip = rng.normal(0, noise.slip * np.sqrt(UPDATE_WAY), (2, count))
    turned = heading_off + (slip[0] - slip[1]) / b
    way = rng.normal(0, noise.along * UPDATE_WAY, count) + slip.mean(axis=0)
    assert 2 * alphas["alpha2"] * UPDATE_WAY**2 == pytest.approx(turned.var(), rel=0.02)
    assert alphas["alpha3"] * UPDATE_WAY**2 == pytest.approx(way.var(), rel=0.02)
    slip = rng.normal(0, noise.slip * np.sqrt(b * UPDATE_TURN / 2), (2, count))
    turned = rng.normal(0, noise.heading_per_rad * UPDATE_TURN, count) + (slip[0] - slip[1]) / b
    assert alphas["alpha1"] * UPDATE_TURN**2 == pytest.approx(turned.var(), rel=0.02)
    assert alphas["alpha4"] * UPDATE_TURN**2 == pytest.approx(slip.mean(axis=0).var(), rel=0.02)
    own = yaml.safe_dump({"amcl": {"ros__parameters": {"alpha1": 0.2, "max_beams": 60}}})
    found = node_parameters("/amcl", own, files_of(made)["nav2_amcl.yaml"])
    assert {name: found[name] for name in alphas} == alphas
    assert found["max_beams"] == 60


def test_robot_localizations_filter_gets_the_slip_as_process_noise() -> None:
    made = calibration(detail=detail())
    found = node_parameters("/ekf_filter_node", files_of(made, controller="wheels")["robot_localization.yaml"])
    assert found["odom0"] == "wheels/odom"
    absolute = node_parameters("/ekf_filter_node", files_of(made, controller="/r01/wheels")["robot_localization.yaml"])
    assert absolute["odom0"] == "/r01/wheels/odom"
    assert [k for k, used in enumerate(found["odom0_config"]) if used] == [6, 7, 11]  # vx, vy, vyaw
    Q = np.reshape(found["process_noise_covariance"], (15, 15))
    assert made.detail is not None
    slip, b = made.detail.noise.slip, made.wheels.b
    assert np.count_nonzero(Q - np.diag(Q.diagonal())) == 0
    assert Q[0, 0] == Q[1, 1] == pytest.approx(slip**2 * 0.5 / 2)
    assert Q[5, 5] == pytest.approx(2 * slip**2 * 0.5 / b**2)
    assert (Q.diagonal() > 0).all()


def test_files_that_need_sigmas_are_not_written_without_them() -> None:
    sizeless = calibration(detail=replace(detail(), ground=replace(detail().ground, straight_heading=np.inf)))
    for made in (calibration(), sizeless):
        files = files_of(made)
        assert not {"nav2_amcl.yaml", "robot_localization.yaml"} & set(files)
        assert "covariance" not in yaml.safe_load(files["diff_drive_controller.yaml"])
    assert {"nav2_amcl.yaml", "robot_localization.yaml"} <= set(STALE_FILES)


def launch(text: str, folder: str = "/calibration/r01", **arguments: str) -> list[dict[str, str]]:
    """The nodes that a launch file starts, with ROS 2's substitutions done (launch_xml)."""
    root = ET.fromstring(text)
    assert root.tag == "launch"
    values = {arg.attrib["name"]: arg.attrib["default"] for arg in root.findall("arg")}
    assert set(arguments) <= set(values)
    values |= arguments

    def filled(raw: str) -> str:
        return re.sub(r"\$\(var (\w+)\)", lambda m: values[m[1]], raw).replace("$(dirname)", folder)

    nodes = [{name: filled(raw) for name, raw in node.attrib.items()} for node in root.findall("node")]
    return [node for node in nodes if node.get("if", "true") == "true"]


def test_the_launch_file_puts_the_camera_into_tf_under_the_robots_prefix() -> None:
    made = calibration(robot=EVIL, detail=detail())
    names = names_for(Settings(base_frame="base_footprint", camera_frame="eye_optical_frame"), Source())
    text = exports(made, None, names)["calibrated.launch.xml"].decode()
    for prefix in ("", "r01_", "r02_"):
        (node,) = launch(text, prefix=prefix, namespace="fleet")
        assert (node["pkg"], node["exec"], node["namespace"]) == ("tf2_ros", "static_transform_publisher", "fleet")
        words = shlex.split(node["args"])
        args = dict(zip(words[::2], words[1::2], strict=True))
        assert args["--frame-id"] == f"{prefix}base_footprint"
        assert args["--child-frame-id"] == f"{prefix}eye_optical_frame"
        xyz, q = ([float(args[f"--{k}"]) for k in keys] for keys in ("xyz", ("qx", "qy", "qz", "qw")))
        assert np.allclose(matrix_of(np.array(xyz), np.array(q)), made.T_body_cam, atol=1e-12)
    own = names_for(Settings(prefix="r03/", camera_frame="eye"), Source())
    (node,) = launch(exports(made, None, own)["calibrated.launch.xml"].decode())
    assert "--frame-id r03/base_footprint --child-frame-id r03/eye" in node["args"]


def test_the_launch_file_starts_the_controller_where_it_is_asked_to() -> None:
    text = files_of(calibration(), controller="wheels")["calibrated.launch.xml"]
    _, spawner = launch(text, start_controller="true", parameters="/own.yaml")
    assert (spawner["pkg"], spawner["exec"]) == ("controller_manager", "spawner")
    assert shlex.split(spawner["args"]) == [
        "wheels",
        "--param-file",
        "/own.yaml",
        "--param-file",
        "/calibration/r01/diff_drive_controller.yaml",
    ]


def test_gazebos_diff_drive_gets_the_wheels(tmp_path: Path) -> None:
    made = calibration(robot=EVIL, detail=detail())
    (tmp_path / "gazebo_diff_drive.xacro").write_bytes(exports(made)["gazebo_diff_drive.xacro"])
    robot = tmp_path / "robot.xacro"
    robot.write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:property name="wheel_radius" value="1"/>'
        f'<xacro:include filename="{tmp_path}/gazebo_diff_drive.xacro"/>'
        '<xacro:calibrated_diff_drive left_joint="l" right_joint="r"/>'
        '<link name="own_${wheel_radius}_${calibrated_wheel_radius_left}"/></robot>'
    )
    root = ET.fromstring(xacro.process_file(str(robot)).toxml())
    plugin = root.find("gazebo/plugin")
    assert plugin is not None
    assert plugin.attrib == {"filename": "gz-sim-diff-drive-system", "name": "gz::sim::systems::DiffDrive"}
    values = {child.tag: child.text for child in plugin}
    assert float(values["wheel_separation"] or "") == made.wheels.b
    assert float(values["wheel_radius"] or "") == pytest.approx((made.wheels.rR + made.wheels.rL) / 2)
    assert (values["left_joint"], values["right_joint"]) == ("l", "r")
    assert root.find("link").get("name") == f"own_1_{made.wheels.rL}"  # type: ignore[union-attr]


@pytest.mark.parametrize("kind", ["radial", "brown", "rational", "fisheye"])
def test_opencv_reads_and_projects_what_its_file_says(tmp_path: Path, kind: str) -> None:
    further = {"brown": ("k2", "p1", "p2", "k3"), "rational": ("k2", "p1", "p2", "k3", "k4", "k5", "k6")}
    names = further.get(kind, ("k2", "k3", "k4") if kind == "fisheye" else ())
    made = calibration(robot=EVIL, camera=camera(kind, **{n: 0.003 * (k + 1) for k, n in enumerate(names)}))
    path = tmp_path / "opencv_camera.yaml"
    path.write_bytes(exports(made)["opencv_camera.yaml"])
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    size = (int(file.getNode("image_width").real()), int(file.getNode("image_height").real()))
    K, D = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    assert size == made.image_size
    assert np.allclose(file.getNode("T_body_cam").mat(), made.T_body_cam, atol=1e-12)
    p_cam = np.array([[0.3, -0.2, 1.0], [-0.1, 0.25, 0.8], [0.0, 0.0, 2.0]])
    if file.getNode("fisheye_model").real():
        uv_px, _ = cv2.fisheye.projectPoints(p_cam[:, None], np.zeros(3), np.zeros(3), K, D)
    else:
        uv_px, _ = cv2.projectPoints(p_cam, np.zeros(3), np.zeros(3), K, D)
    assert np.allclose(uv_px.reshape(-1, 2), project(made.camera, p_cam), atol=1e-9)
