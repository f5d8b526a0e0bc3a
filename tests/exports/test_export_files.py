"""Every exported file reads back, with a reader that is not ours, to the calibration's numbers."""

import csv
import io
import math
import re
import shlex
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest
import xacro
import yaml
from hypothesis import example, given, settings
from made_up import EVIL, RANDOM, SIGMA, calibration, camera, detail, matrix_of
from urdf_parser_py import urdf as urdf_reader

from boxcal.calib.exports.files import exports
from boxcal.calib.exports.fleet_csv import fleet_csv, fleet_rows
from boxcal.calib.exports.names import names_for
from boxcal.calib.exports.ros_diff_drive import covariance_diagonals, diff_drive
from boxcal.calib.exports.text import number, ros_name
from boxcal.calib.geometry.diff_drive import Legs, Wheels, unit_path
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, rigid
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level, Reason, Verdict
from boxcal.calib.settings import Nominal, Settings
from boxcal.detect.log.source import Source
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import project

NOMINAL = Nominal(wheel_radius=0.033, wheel_separation=0.16, source="robot.yaml")
CLOSE = 1e-9


def _same(a: Any, b: Any) -> bool:
    return bool(np.allclose(np.asarray(a, float), np.asarray(b, float), rtol=CLOSE, atol=CLOSE))


def _urdf_pose(text: str, top: str, bottom: str) -> Array:
    """The pose of a link in another, by URDF's rules: fixed axes roll, pitch, yaw."""
    robot = urdf_reader.URDF.from_xml_string(text.encode())
    T, link = np.eye(4), bottom
    while link != top:
        (joint,) = [j for j in robot.joints if j.child == link]
        assert joint.type == "fixed"
        r, p, y = (exp_so3(angle * axis) for angle, axis in zip(joint.origin.rpy, np.eye(3), strict=True))
        T = rigid(y @ p @ r, np.array(joint.origin.xyz)) @ T
        link = joint.parent
    return T


@settings(max_examples=200, deadline=None)
@given(made=RANDOM)
@example(made=calibration(robot=EVIL, detail=detail()))
@example(made=calibration(robot="False", detail=detail()))
@example(made=calibration(robot="no", detail=detail()))
def test_every_file_reads_back_with_another_reader(made: Calibration) -> None:
    files = {name: content.decode() for name, content in exports(made, NOMINAL).items()}
    c, w, T = made.camera, made.wheels, made.T_body_cam

    info = yaml.safe_load(files["camera_info.yaml"])
    assert (info["image_width"], info["image_height"]) == made.image_size
    assert info["camera_name"] == ros_name(made.robot)
    assert info["distortion_model"] == "plumb_bob"
    shapes = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
    read = {k: np.array(info[k]["data"]).reshape(info[k]["rows"], info[k]["cols"]) for k in shapes}
    assert {k: m.shape for k, m in read.items()} == shapes
    assert _same(read["camera_matrix"], c.K)
    assert _same(read["projection_matrix"], np.column_stack([c.K, np.zeros(3)]))
    assert _same(info["distortion_coefficients"]["data"], [c.kr, 0, 0, 0, 0])

    assert _same(_urdf_pose(files["camera.urdf"], "base_footprint", "camera_optical_frame"), T)

    words = shlex.split(files["static_transform.sh"], comments=True)
    assert words[:5] == ["exec", "ros2", "run", "tf2_ros", "static_transform_publisher"]
    args = dict(zip(words[5::2], words[6::2], strict=True))
    assert (args["--frame-id"], args["--child-frame-id"]) == ("base_footprint", "camera_optical_frame")
    xyz, q = ([float(args[f"--{k}"]) for k in keys] for keys in ("xyz", ("qx", "qy", "qz", "qw")))
    assert _same(matrix_of(np.array(xyz), np.array(q)), T)

    parameters = yaml.safe_load(files["diff_drive_controller.yaml"])["/**/diff_drive_controller"]["ros__parameters"]
    numbers_ = [v for value in parameters.values() for v in (value if isinstance(value, list) else [value])]
    assert all(type(v) is float for v in numbers_)  # ROS refuses a double given as an integer
    radius, separation = parameters["wheel_radius"], parameters["wheel_separation"]
    assert (radius, separation) == (0.033, 0.16)
    assert _same(radius * parameters["right_wheel_radius_multiplier"], w.rR)
    assert _same(radius * parameters["left_wheel_radius_multiplier"], w.rL)
    assert _same(separation * parameters["wheel_separation_multiplier"], w.b)

    chain = yaml.safe_load(files["camchain.yaml"])
    assert list(chain) == ["cam0"]  # Kalibr takes every key for a camera
    cam = chain["cam0"]
    assert (cam["camera_model"], cam["distortion_model"]) == ("pinhole", "radtan")
    assert all(type(v) is float for v in cam["intrinsics"])  # Kalibr checks that they are
    assert _same(cam["intrinsics"], [c.fu, c.fv, c.cu, c.cv])
    assert _same(cam["distortion_coeffs"], [c.kr, 0, 0, 0])
    assert tuple(cam["resolution"]) == made.image_size
    assert cam["rostopic"] == "/camera/image_raw"
    assert _same(cam["T_cam_body"], inverse(T))

    rows = list(csv.reader(io.StringIO(fleet_csv(fleet_rows([made, made])).decode()), strict=True))
    rows = [row for row in rows if not row[0].startswith("# ")]
    assert len(rows) == 3
    assert all(len(row) == len(rows[0]) for row in rows)
    row = dict(zip(rows[0], rows[2], strict=True))
    assert not row["robot"].lstrip().startswith(("=", "+", "-", "@"))
    names = ("fu_px", "fv_px", "cu_px", "cv_px", "kr", "rR_m", "rL_m", "b_m")
    assert _same([float(row[n]) for n in names], [c.fu, c.fv, c.cu, c.cv, c.kr, w.rR, w.rL, w.b])
    xyz, q = ([float(row[k]) for k in keys] for keys in (("x_m", "y_m", "z_m"), ("qx", "qy", "qz", "qw")))
    assert _same(matrix_of(np.array(xyz), np.array(q)), T)
    sigmas = [row[name] for name in rows[0] if name.startswith("sigma_")]
    if made.detail is None:
        assert set(sigmas) == {""}
    else:
        assert _same([float(s) for s in sigmas], list(made.detail.covariance.sigma.values()))


def test_xacro_macro_puts_the_camera_on_a_robot(tmp_path: Path) -> None:
    made = calibration(robot=EVIL, detail=detail())
    (tmp_path / "camera.urdf.xacro").write_bytes(exports(made)["camera.urdf.xacro"])
    robot = tmp_path / "robot.xacro"
    robot.write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="base_footprint"/>'
        f'<xacro:include filename="{tmp_path}/camera.urdf.xacro"/><xacro:calibrated_camera/>'
        '<xacro:calibrated_camera prefix="rear_"/></robot>'
    )
    text = xacro.process_file(str(robot)).toxml()
    for prefix in ("", "rear_"):
        assert _same(_urdf_pose(text, "base_footprint", f"{prefix}camera_optical_frame"), made.T_body_cam)


@pytest.mark.parametrize("nominal", [None, NOMINAL])
def test_diff_drive_parameters_reproduce_our_odometry(nominal: Nominal | None) -> None:
    """Wheel angles through diff_drive_controller's own rules give the path that our wheels give."""
    rng = np.random.default_rng(1)
    dR, dL = rng.uniform(-0.1, 0.3, (2, 500))
    wheels = Wheels(rR=0.0331, rL=0.0328, b=0.1604)
    p = diff_drive(wheels, nominal)
    separation = p.wheel_separation_multiplier * p.wheel_separation
    x = y = heading = 0.0
    for left, right in zip(
        dL * p.left_wheel_radius_multiplier * p.wheel_radius,
        dR * p.right_wheel_radius_multiplier * p.wheel_radius,
        strict=True,
    ):
        linear, angular = (left + right) * 0.5, (right - left) / separation
        if abs(angular) < 1e-6:
            x += linear * math.cos(heading + angular * 0.5)
            y += linear * math.sin(heading + angular * 0.5)
            heading += angular
        else:
            old, r = heading, linear / angular
            heading += angular
            x += r * (math.sin(heading) - math.sin(old))
            y += -r * (math.cos(heading) - math.cos(old))
    xy, th = unit_path(Legs(dphi_R=dR, dphi_L=dL, ends=(0, len(dR))), aR=wheels.rR / wheels.b, aL=-wheels.rL / wheels.b)
    assert _same([x, y, heading], [*(xy[-1] * wheels.rL), th[-1]])


def test_richer_lenses_keep_all_their_coefficients_or_are_left_out() -> None:
    brown = {"k2": 0.01, "p1": 1e-5, "p2": -2e-4, "k3": 0.0}
    k = [-0.0875, 0.01, 1e-5, -2e-4]
    files = exports(calibration(camera=camera("brown", **brown)))
    assert yaml.safe_load(files["camera_info.yaml"])["distortion_coefficients"]["data"] == [*k, 0.0]
    assert yaml.safe_load(files["camchain.yaml"])["cam0"]["distortion_coeffs"] == k
    files = exports(calibration(camera=camera("brown", **{**brown, "k3": 0.5})))
    assert yaml.safe_load(files["camera_info.yaml"])["distortion_coefficients"]["data"][-1] == 0.5
    assert "camchain.yaml" not in files  # Kalibr's radtan has no k3
    assert "brown" in files["camchain-missing.txt"].decode()
    fisheye = exports(calibration(camera=camera("fisheye", k2=0.1, k3=0.2, k4=0.3)))
    for name, key in (("camera_info.yaml", "distortion_model"), ("camchain.yaml", "distortion_model")):
        document = yaml.safe_load(fisheye[name])
        assert document.get("cam0", document)[key] == "equidistant"


def test_each_file_says_its_conventions_and_how_sure_it_is() -> None:
    for name, content in exports(calibration(detail=detail()), NOMINAL).items():
        text = content.decode()
        assert "r01" in text, name
        assert "standard deviations: " in text, name
        assert any(word in text for word in ("z up", "between the wheels' contact points", "u to the right")), name
        assert not any(line.rstrip(" ->").endswith("...") for line in text.splitlines()), name  # nothing is cut off
    assert "tz 0.0002 m" in exports(calibration(detail=detail()))["camera.urdf"].decode()
    assert "not estimated" in exports(calibration())["camera.urdf"].decode()
    sigma = dict(zip(ORDER, SIGMA, strict=True))
    assert f"b {sigma['b']:.2g} m" in exports(calibration(detail=detail()))["diff_drive_controller.yaml"].decode()


def test_names_with_markup_stay_data() -> None:
    assert ros_name(EVIL) == "script_alert_1_script_x_rm_rf_1_1_1_1"
    assert ros_name("7") == "robot_7"
    assert ros_name("日本") != ros_name("東京")  # two robots keep two names
    assert re.fullmatch(r"robot_[0-9a-f]{8}", ros_name("日本"))
    for name, content in exports(calibration(robot=EVIL)).items():
        text = content.decode()
        if name.endswith((".xml", ".xacro", ".urdf")):
            assert "<script>" not in text
        else:
            first = next(line for line in text.splitlines() if not line.startswith(("#!", "%YAML", "---")))
            assert [line for line in text.splitlines() if "script>" in line] == [first], name
            assert first.startswith("# "), name
    for evil in ("=cmd|' /C calc'!A0", "+1", "-1", "@x", " =1", "#1", "\t=1"):
        rows = list(csv.reader(io.StringIO(fleet_csv(fleet_rows([calibration(robot=evil)])).decode())))
        assert rows[-1][0].startswith("'")


@pytest.mark.parametrize("value", [1e-5, 1e22, -3e-300, 0.1, 12.0, math.pi])
def test_numbers_are_floats_to_a_yaml_reader(value: float) -> None:
    read = yaml.safe_load(number(value))
    assert type(read) is float
    assert read == value


@pytest.mark.parametrize("kind", ["radial", "brown", "rational", "fisheye"])
def test_every_camera_model_is_exported_as_opencv_projects_it(kind: str) -> None:
    further = {"brown": ("k2", "p1", "p2", "k3"), "rational": ("k2", "p1", "p2", "k3", "k4", "k5", "k6")}
    names = further.get(kind, ("k2", "k3", "k4") if kind == "fisheye" else ())
    made = calibration(camera=camera(kind, **{name: 0.003 * (k + 1) for k, name in enumerate(names)}))
    files = exports(made)
    info = yaml.safe_load(files["camera_info.yaml"])
    K, D = np.array(info["camera_matrix"]["data"]).reshape(3, 3), np.array(info["distortion_coefficients"]["data"])
    p_cam = np.array([[0.3, -0.2, 1.0], [-0.1, 0.25, 0.8], [0.0, 0.0, 2.0]])
    if kind == "fisheye":
        uv_px, _ = cv2.fisheye.projectPoints(p_cam[:, None], np.zeros(3), np.zeros(3), K, D)
    else:
        uv_px, _ = cv2.projectPoints(p_cam, np.zeros(3), np.zeros(3), K, D)
    assert np.allclose(uv_px.reshape(-1, 2), project(made.camera, p_cam), atol=1e-9)
    assert ("camchain.yaml" in files) != ("camchain-missing.txt" in files)


@pytest.mark.parametrize("level", list(Level))
def test_every_file_says_in_its_head_whether_it_may_be_used(level: Level) -> None:
    reason = Reason(rule="slip", level=level, text="The wheels slip -- by 9 mm.", advice="Drive slower.")
    judged = Verdict(level=level, headline="So it is.", reasons=(reason,), next_steps=("Drive slower.",))
    files = exports(calibration(detail=detail(), verdict=judged, camera=camera("brown", k3=0.1)), NOMINAL)
    assert len(files) == 12
    for name, content in files.items():
        head = "\n".join(content.decode().splitlines()[:8])
        assert f"verdict: {level.upper()} - So it is." in head, name
        assert ("Drive slower." in head) == (level is not Level.GOOD), name
        assert ("The wheels slip" in head) == (level is not Level.GOOD), name
        invited = re.search(r"ros2 launch|give this file|include|add your", content.decode())
        assert not invited or level is not Level.REDO, name
    ET.fromstring(files["camera.urdf"])  # two hyphens would end its comment


def test_frames_and_topic_are_the_logs_own_or_as_they_are_named() -> None:
    source = Source(camera_topic="/front/image_raw", camera_frame="front_rgb_optical_frame", base_frame="base_link")
    own = names_for(Settings(), source)
    assert (own.base, own.optical, own.link) == ("base_footprint", "front_rgb_optical_frame", "front_rgb_link")
    files = exports(calibration(), names=own)
    assert yaml.safe_load(files["camchain.yaml"])["cam0"]["rostopic"] == "/front/image_raw"
    assert _same(_urdf_pose(files["camera.urdf"].decode(), own.base, own.optical), calibration().T_body_cam)
    given = names_for(Settings(base_frame="ground", camera_frame="eye", prefix="r01/", controller="wheels"), source)
    assert (given.base, given.optical, given.link) == ("r01/ground", "r01/eye", "r01/eye_link")
    text = exports(calibration(), names=given)["static_transform.sh"].decode()
    assert "--frame-id r01/ground --child-frame-id r01/eye" in text
    assert list(yaml.safe_load(exports(calibration(), names=given)["diff_drive_controller.yaml"])) == ["/**/wheels"]
    hostile = names_for(Settings(), Source(camera_frame="x; rm -rf /", camera_topic="a b"))
    assert (hostile.optical, hostile.topic) == ("camera_optical_frame", "/camera/image_raw")
    assert names_for(Settings(camera_frame="cam_link"), Source()).link == "cam_mount_link"


def test_two_robots_share_one_tf_tree_by_their_prefixes() -> None:
    links = []
    for prefix in ("r01_", "r02_"):
        files = exports(calibration(), names=names_for(Settings(prefix=prefix), Source()))
        links.append({link.get("name") for link in ET.fromstring(files["camera.urdf"]).findall("link")})
    assert len(links[0]) == 3
    assert not links[0] & links[1]


def test_static_transform_runs(tmp_path: Path) -> None:
    (tmp_path / "ros2").write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    (tmp_path / "ros2").chmod(0o755)
    script = tmp_path / "static_transform.sh"
    script.write_bytes(exports(calibration(robot="r 1; $(false)"))["static_transform.sh"])
    script.chmod(0o755)
    done = subprocess.run(
        [script], env={"PATH": f"{tmp_path}:/usr/bin:/bin"}, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[:3] == ["run", "tf2_ros", "static_transform_publisher"]


def test_covariance_diagonals_are_those_of_calibration_and_slip() -> None:
    made = calibration(detail=detail())
    found = covariance_diagonals(made)
    x, y, z, roll, pitch, yaw = found["pose_covariance_diagonal"]
    assert made.detail is not None
    slip, b = made.detail.noise.slip, made.wheels.b
    assert yaw == pytest.approx((made.detail.ground.straight_heading / 10) ** 2 + 2 * slip**2 / b**2)
    assert x > slip**2 / 2
    assert y == pytest.approx(yaw / 3)
    assert z == roll == pitch == 1e-6
    assert found["twist_covariance_diagonal"][5] < yaw
    assert not covariance_diagonals(calibration())


def test_two_robots_descriptions_load_in_one_tree() -> None:
    """Under one map, as a viewer of a team holds them; every name is there once, each camera where it was found."""
    team = ET.Element("robot", name="team")
    ET.SubElement(team, "link", name="map")
    for prefix in ("r01/", "r02/"):
        names = names_for(Settings(prefix=prefix, camera_frame="eye"), Source())
        team.extend(list(ET.fromstring(exports(calibration(), names=names)["camera.urdf"])))
        joint = ET.SubElement(team, "joint", name=f"{prefix}map_joint", type="fixed")
        ET.SubElement(joint, "parent", link="map")
        ET.SubElement(joint, "child", link=f"{prefix}base_footprint")
        ET.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0")
    text = ET.tostring(team, encoding="unicode")
    robot = urdf_reader.URDF.from_xml_string(text.encode())
    assert robot.get_root() == "map"
    assert len({j.name for j in robot.joints}) == len(robot.joints) == 6
    assert len({link.name for link in robot.links}) == len(robot.links) == 7
    for prefix in ("r01/", "r02/"):
        assert _same(_urdf_pose(text, "map", f"{prefix}eye"), calibration().T_body_cam)
