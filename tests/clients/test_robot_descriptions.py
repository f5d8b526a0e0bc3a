"""URDFs and launch files in the programs that read them: urdfdom, yourdfpy, libxml2 (Debian and PyPI)."""

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from boxcal.calib.results.calibration import Calibration


def program(name: str, package: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed (apt-get install {package})")
    return found


def one_tree(robots: dict[str, Path]) -> str:
    """The descriptions of all robots under one map, as a viewer of a team holds them."""
    team = ET.Element("robot", name="team")
    ET.SubElement(team, "link", name="map")
    for robot, folder in robots.items():
        root = ET.parse(folder / "camera.urdf").getroot()
        team.extend(list(root))
        children = {child.get("link") for child in root.iter("child")}
        (base,) = {link.get("name") for link in root.iter("link")} - children
        joint = ET.SubElement(team, "joint", name=f"{robot}_localisation", type="floating")
        ET.SubElement(joint, "parent", link="map")
        ET.SubElement(joint, "child", link=str(base))
    return ET.tostring(team, encoding="unicode")


def test_urdfdom_loads_the_cameras_of_two_robots_in_one_tree(robots: dict[str, Path], tmp_path: Path) -> None:
    check = program("check_urdf", "liburdfdom-tools")
    (tmp_path / "team.urdf").write_text(one_tree(robots))
    for path in (robots["r01"] / "camera.urdf", tmp_path / "team.urdf"):
        done = subprocess.run([check, path], capture_output=True, text=True, check=False)
        assert "Successfully Parsed XML" in done.stdout, done.stdout + done.stderr
        assert not done.returncode
    for robot in robots:
        assert re.search(rf"child\(1\):\s+{robot}_camera_optical_frame", done.stdout)


def test_yourdfpy_puts_the_camera_where_the_calibration_does(robots: dict[str, Path], made: Calibration) -> None:
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed (pip install yourdfpy)")
    for robot, folder in robots.items():
        model = yourdfpy.URDF.load(str(folder / "camera.urdf"), load_meshes=False)
        assert model.validate()
        T = model.get_transform(f"{robot}_camera_optical_frame", f"{robot}_base_footprint")
        assert np.allclose(T, made.T_body_cam, atol=1e-9)


def test_xml_files_are_well_formed_to_libxml2(robots: dict[str, Path]) -> None:
    xmllint = program("xmllint", "libxml2-utils")
    for name in ("calibrated.launch.xml", "camera.urdf", "camera.urdf.xacro", "gazebo_diff_drive.xacro"):
        done = subprocess.run([xmllint, "--noout", robots["r01"] / name], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, ""), name
