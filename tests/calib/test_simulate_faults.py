"""Simulated robots that are not exact: pictures, stamps and truth all tell of the same faults."""

import json
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pytest

from boxcal.calib.geometry.so3_se3 import inverse, log_so3
from boxcal.calib.simulate.as_built import as_built
from boxcal.calib.simulate.asked_faults import AskedFaults
from boxcal.calib.simulate.cli import main
from boxcal.calib.simulate.drive import Drive, DriveOptions, simulate_drive
from boxcal.calib.simulate.imperfections import BoxFaults, CameraFaults, Imperfections, WheelFaults
from boxcal.calib.simulate.recorder import RecordOptions, stamps_late_ns, take_picture
from boxcal.calib.simulate.robot import Robot, turtlebot, with_camera
from boxcal.detect.alignment.detector import detect_tags
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind, project
from boxcal.target.render.sensor import SensorModel

TARGET = make_target()
QUIET = RecordOptions(sensor=SensorModel(psf_px=0.6, noise=1.0))
PLACE = np.array([[4e-4, -3e-4, radians(0.3)], [0, 8e-4, 0], [-5e-4, 0, 0], [0, 0, radians(-0.2)]])
POSE = np.array([[radians(0.3), radians(-0.2), 0, 0, 0, 3e-4]] * 4)


def driven(faults: Imperfections, robot: Robot | None = None, seed: int = 5) -> Drive:
    options = DriveOptions(stops=4, steps_per_sample=4)
    return simulate_drive(robot or turtlebot(), TARGET, options, np.random.default_rng(seed), faults=faults)


def corner_errors(robot: Robot, drive: Drive, stop: int) -> Array:
    """Detected corners less those that the faults put there, px, of tags of 24 px or more."""
    t_ns = int(drive.stop_t_ns[stop].mean())
    picture = take_picture(robot, TARGET, drive, t_ns, options=QUIET, rng=np.random.default_rng(1))
    found = detect_tags(picture, TARGET)
    T_cam_box = inverse(drive.T_box_cam[stop])
    rows = [TARGET.row_of(int(tag)) for tag in found.ids]
    p_box = as_built(TARGET, drive.faults.box).tag_corners[rows]
    true = project(drive.scene.cameras[stop], p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
    off = found.corners_px - true
    large = np.linalg.norm(true[:, 0] - true[:, 2], axis=1) > 24
    assert large.sum() >= 10
    return np.asarray(off[large])


@pytest.mark.parametrize(
    "box",
    [
        BoxFaults(scale=(1.004, 0.997)),
        BoxFaults(place=PLACE, pose=POSE),
        BoxFaults(bow=(1e-3,) * 4, place=PLACE),
        BoxFaults(moved=(0, 0.02, -0.01, 0.05)),
        BoxFaults(turned=(0, 1, 2, 3)),
        BoxFaults(order=(1, 0, 3, 2)),
    ],
    ids=["scale", "sheets and faces", "bow", "moved", "upside down", "swapped"],
)
def test_tags_are_seen_where_the_box_as_built_has_them(box: BoxFaults) -> None:
    robot, drive = turtlebot(), driven(Imperfections(box=box))
    for stop in (0, 2):
        off = corner_errors(robot, drive, stop)
        assert np.sqrt(np.mean(off**2)) < 0.06
        assert np.abs(np.mean(off, axis=(0, 1))).max() < 0.03


@pytest.mark.parametrize("kind", [CameraKind.BROWN, CameraKind.RATIONAL])
def test_cameras_of_other_kinds_see_the_box_where_their_models_put_it(kind: CameraKind) -> None:
    robot = with_camera(turtlebot(), kind, np.random.default_rng(2))
    assert robot.camera.kind is kind
    off = corner_errors(robot, driven(Imperfections(), robot), 1)
    assert np.sqrt(np.mean(off**2)) < 0.06


def test_a_robot_leans_by_what_was_asked_for() -> None:
    robot = turtlebot()
    options = DriveOptions(stops=40, steps_per_sample=1)
    faults = Imperfections(lean=radians(0.5), tilt=(0.01, -0.02))
    drive = simulate_drive(robot, TARGET, options, np.random.default_rng(0), faults=faults)
    up = drive.T_box_cam[:, :3, :3] @ robot.T_body_cam[:3, :3].T @ np.array([0, 0, 1.0])
    assert np.mean(up, axis=0)[:2] == pytest.approx((-0.02, -0.01), abs=4 * radians(0.5) / np.sqrt(40))
    assert np.std(up[:, :2], axis=0) == pytest.approx(radians(0.5), rel=0.4)
    assert np.ptp(drive.T_box_cam[:, 2, 3]) > 1e-3  # with the camera's height


def test_a_knocked_camera_and_a_changed_focus_hold_from_their_stop_on() -> None:
    robot = turtlebot()
    camera = CameraFaults(knocked=(2, (0.0, 0.01, 0.0, 0.0, 0.0, 0.002)), focus=(1, 1.01, 3.0, 0.0))
    scene = driven(Imperfections(camera=camera)).scene
    turns = [np.linalg.norm(log_so3(robot.T_body_cam[:3, :3].T @ T[:3, :3])) for T in scene.T_body_cam]
    assert turns == pytest.approx([0, 0, 0.01, 0.01])
    assert [c.fu / robot.camera.fu for c in scene.cameras] == pytest.approx([1, 1.01, 1.01, 1.01])
    assert scene.cameras[1].cu == pytest.approx(319.5 + 1.01 * (robot.camera.cu - 319.5) + 3)


def test_wheels_that_scrub_turn_less_than_they_roll() -> None:
    sound, scrubbed = (driven(Imperfections(wheels=WheelFaults(slip=0.0, scrub=(s, s, 0.0)))) for s in (0.0, 0.05))
    robot = turtlebot()
    for drive, share in ((sound, 1.0), (scrubbed, 0.95)):
        rolled = (robot.rR * np.diff(drive.stop_phi[:, 0]) - robot.rL * np.diff(drive.stop_phi[:, 1])) / robot.b
        assert np.diff(drive.stop_poses[:, 2]) == pytest.approx(share * rolled, abs=1e-9)


def test_a_late_camera_clock_moves_the_stamps_only() -> None:
    drive = driven(Imperfections(camera=CameraFaults(late=0.025, drift=1e-3)))
    t_ns = drive.stop_t_ns[:, 0]
    since = (t_ns - drive.path_t_ns[0]) * 1e-9
    assert stamps_late_ns(drive, t_ns) * 1e-9 == pytest.approx(0.025 + 1e-3 * since, abs=1e-8)


def test_the_command_writes_what_was_wrong_into_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--robots", "1", "--jobs", "1", "--stops", "14", "--frames", "1", "--moving-frames", "0"]
    words += ["--image-size", "320x240", "--hand-made", "--lean-deg", "0.08", "--camera", "brown"]
    words += ["--violation", "wheels out of round=0.5", "--violation", "box moved=6"]
    assert main([str(tmp_path), *words]) == 0, capsys.readouterr().err
    truth = json.loads((tmp_path / "r01.truth.json").read_text())
    assert truth["note"] == (
        "a careful user's box, floor and lens; leans by 0.08 deg a stop; wheels out of round: 0.5 %; box moved: 6 mm"
    )
    assert truth["lean_deg"] == pytest.approx(0.08)
    assert truth["model"] == "brown"
    assert len(truth["k"]) == 5
    assert truth["k"][0] == truth["camera"]["kr"]
    assert truth["wheel"]["ecc"] == pytest.approx(0.005)
    assert truth["box"]["moved"][1] == pytest.approx(0.006)
    assert set(truth["box"]) >= {"scale", "shift", "glue", "turn", "tip", "out", "bow", "moved"}
    assert len(truth["stops"]) == 14


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--violation", "flat tyre"], "no violation 'flat tyre', one of wheels out of round, "),
        (["--violation", "box moved", "--stops", "5"], "5 stops, 14 are needed"),
    ],
)
def test_what_cannot_be_simulated_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    assert main([str(tmp_path), "--robots", "1", "--jobs", "1", *words]) == 1
    assert says in capsys.readouterr().err


def test_the_catalogue_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--list-violations"])
    assert left.value.code == 0
    assert "box moved" in capsys.readouterr().out


def test_nothing_asked_for_is_nothing_wrong() -> None:
    rng = np.random.default_rng(0)
    assert AskedFaults().draw(turtlebot(), DriveOptions(), rng) is None
    faults = AskedFaults(lean=0.01).draw(turtlebot(), DriveOptions(slip=7e-4), rng)
    assert faults is not None
    assert faults.wheels.slip == 7e-4
    assert replace(faults, lean=0.0).tilt == (0.0, 0.0)
