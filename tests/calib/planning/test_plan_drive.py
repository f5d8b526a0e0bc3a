"""The command plan-drive and its files."""

import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from boxcal.calib.plan_drive.cli import main
from boxcal.calib.plan_drive.drawing import path_points
from boxcal.calib.plan_drive.instructions import corner_places, taped_stops
from boxcal.calib.plan_drive.nav2 import nav2_bytes
from boxcal.calib.planning.plan import DrivePlan, PlanOptions, plan_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.log.urdf_wheels import urdf_camera
from boxcal.target.box import make_target

URDF = """<robot name="r"><link name="base"/>
<link name="left"><visual><geometry><cylinder radius="0.03" length="0.01"/></geometry></visual></link>
<link name="right"><visual><geometry><cylinder radius="0.03" length="0.01"/></geometry></visual></link>
<link name="camera_rgb_optical_frame"/><link name="camera_depth_optical_frame"/>
<joint name="wheel_left_joint" type="continuous"><parent link="base"/><child link="left"/>
<origin xyz="0.01 0.08 0.03" rpy="-1.57079632679 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="wheel_right_joint" type="continuous"><parent link="base"/><child link="right"/>
<origin xyz="0.01 -0.08 0.03" rpy="-1.57079632679 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="rgb" type="fixed"><parent link="base"/><child link="camera_rgb_optical_frame"/>
<origin xyz="0.08 0 0.2" rpy="-1.57079632679 0 -1.57079632679"/></joint>
<joint name="depth" type="fixed"><parent link="base"/><child link="camera_depth_optical_frame"/></joint></robot>"""


@pytest.fixture(scope="module")
def plan() -> DrivePlan:
    return plan_drive(turtlebot(), make_target(), PlanOptions(stops=6, candidates=60))


def test_command_writes_a_plan_that_other_programs_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pdfium = pytest.importorskip("pypdfium2")
    (tmp_path / "robot.urdf").write_text(URDF)
    out = tmp_path / "plan"
    status = main(
        [str(out), "--urdf", str(tmp_path / "robot.urdf"), "--stops", "6", "--sure", "--floor", "-2", "-2", "2", "2"]
    )
    said = capsys.readouterr()
    assert status in {0, 1}, said.err
    document = json.loads((out / "plan.json").read_text())
    assert len(document["stops"]) == 6
    assert all(abs(stop["x"]) < 2 and abs(stop["y"]) < 2 for stop in document["stops"])
    assert "ring of 6" in said.out or "at random" in said.out
    pages = pdfium.PdfDocument(out / "floor-plan.pdf")
    text = "".join(pages[k].get_textpage().get_text_range() for k in range(len(pages)))
    assert "from A" in text
    assert f"{document['length']:.1f} m" in text
    assert "<svg" in (out / "plan.svg").read_text()


def test_same_options_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        main([str(tmp_path / name), "--stops", "3", "--sure"])
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_what_cannot_be_read_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "x"), "--calibration", str(tmp_path / "none.json")]) == 2
    assert main([str(tmp_path / "x"), "--after", str(tmp_path)]) == 2
    (tmp_path / "bad.urdf").write_text("<robot/>")
    assert main([str(tmp_path / "x"), "--urdf", str(tmp_path / "bad.urdf")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("plan-drive: ") for line in lines)


def test_urdf_gives_the_camera_from_the_floor_below_the_axle() -> None:
    link, T_body_cam = urdf_camera(URDF.encode(), "robot.urdf")
    assert link == "camera_rgb_optical_frame"
    assert T_body_cam[:3, 3] == pytest.approx([0.07, 0.0, 0.2], abs=1e-9)
    assert T_body_cam[:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


def test_tapes_from_two_corners_meet_at_the_stop(plan: DrivePlan) -> None:
    corners = corner_places(plan.target.box)
    for taped, stop in zip(taped_stops(plan), plan.stops, strict=True):
        for name, distance in taped.from_corners:
            assert np.hypot(*(stop.pose[:2] - corners[name])) == pytest.approx(distance, abs=1e-12)
        assert -180 <= taped.heading_deg < 180


def test_drawn_ways_end_at_the_stops(plan: DrivePlan) -> None:
    for points, stop in zip(path_points(plan), plan.stops[1:], strict=True):
        assert points[-1] == pytest.approx(stop.pose[:2], abs=1e-9)


def test_waypoints_are_poses_in_the_frame_of_the_box_and_turn_as_far_as_planned(plan: DrivePlan) -> None:
    goal = YAML(typ="safe", pure=True).load(nav2_bytes(plan).decode())
    headings, places = [], []
    for stamped in goal["poses"]:
        assert stamped["header"]["frame_id"] == "box"
        q = stamped["pose"]["orientation"]
        assert q["z"] ** 2 + q["w"] ** 2 == pytest.approx(1.0, abs=1e-5)
        headings.append(2 * np.arctan2(q["z"], q["w"]))
        places.append((stamped["pose"]["position"]["x"], stamped["pose"]["position"]["y"]))
    for stop in plan.stops:
        near = np.hypot(*(np.array(places) - stop.pose[:2]).T) < 1e-3
        assert np.any(near)
    assert len(goal["poses"]) >= len(plan.stops)
