"""The logs of simulated drives, and the truth beside them, agree with each other and with the drive."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from boxcal.calib.compare.ground_truth import load_truth
from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.drive import Drive, DriveOptions, simulate_drive
from boxcal.calib.simulate.recorder import RecordOptions, frame_times, take_picture, take_rows, write_log
from boxcal.calib.simulate.robot import Robot, random_robot, turtlebot
from boxcal.calib.simulate.truth import truth_bytes
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import project
from boxcal.target.render.renderer import render
from boxcal.target.render.sensor import SensorModel

TARGET = make_target()
STORE = get_typestore(Stores.ROS2_HUMBLE)
ROBOT = random_robot("r05", np.random.default_rng(5))
DRIVEN = DriveOptions(stops=3)
PLAIN = RecordOptions(frames=2, moving_frames=1, image="raw", compression="none", sensor=SensorModel())


@dataclass(frozen=True, kw_only=True)
class Row:
    topic: str
    kind: str
    log_ns: int
    stamp_ns: int
    message: Any


def drive(robot: Robot = ROBOT, seed: int = 0) -> Drive:
    return simulate_drive(robot, TARGET, DRIVEN, np.random.default_rng(seed))


def rows(path: Path) -> list[Row]:
    found = []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            content: Any = STORE.deserialize_cdr(message.data, schema.name)
            stamp = content.header.stamp.sec * 10**9 + content.header.stamp.nanosec
            found.append(
                Row(topic=channel.topic, kind=schema.name, log_ns=message.log_time, stamp_ns=stamp, message=content)
            )
    return found


def write(path: Path, options: RecordOptions, seed: int = 0) -> tuple[list[Row], dict[str, Any], Drive]:
    driven = drive()
    names, _ = write_log(path, ROBOT, TARGET, driven, options, rng=np.random.default_rng(seed))
    truth = json.loads(truth_bytes(ROBOT, driven, DRIVEN, options, names))
    return rows(path), truth, driven


def test_log_holds_every_sample_and_the_pictures_asked_for(tmp_path: Path) -> None:
    found, truth, driven = write(tmp_path / "a.mcap", PLAIN)
    joints = [r for r in found if r.topic == truth["joint_topic"]]
    pictures = [r for r in found if r.topic == truth["camera_topic"]]
    assert len(joints) + len(pictures) == len(found)
    assert {r.kind for r in joints} == {"sensor_msgs/msg/JointState"}
    assert {r.kind for r in pictures} == {"sensor_msgs/msg/Image"}
    assert [r.stamp_ns for r in joints] == driven.t_ns.tolist()
    stamps = np.array([(r.stamp_ns - truth["t0_ns"]) / 1e9 for r in pictures])
    still = [(stamps > s["t_start"] + 0.1) & (stamps < s["t_end"] - 0.1) for s in truth["stops"]]
    assert [int(s.sum()) for s in still] == [2, 2, 2]
    legs = zip(truth["stops"], truth["stops"][1:], strict=False)
    assert [int(((stamps > a["t_end"]) & (stamps < b["t_start"])).sum()) for a, b in legs] == [1, 1]
    assert len(stamps) == 8


def test_log_times_ascend_and_come_late(tmp_path: Path) -> None:
    found, truth, _ = write(tmp_path / "a.mcap", PLAIN)
    assert np.all(np.diff([r.log_ns for r in found]) >= 0)
    late = {
        topic: np.median([r.log_ns - r.stamp_ns for r in found if r.topic == truth[topic]]) / 1e6
        for topic in ("joint_topic", "camera_topic")
    }
    assert 2 <= late["joint_topic"] < 3
    assert 30 <= late["camera_topic"] < 40
    assert min(r.log_ns - r.stamp_ns for r in found) > 0


def test_wheel_angles_in_the_log_are_the_truths_by_joint_name(tmp_path: Path) -> None:
    orders = set()
    for seed in range(6):
        found, truth, _ = write(tmp_path / f"{seed}.mcap", replace(PLAIN, frames=1, moving_frames=0), seed)
        joints = [r for r in found if r.topic == truth["joint_topic"]]
        orders.add(tuple(joints[0].message.name))
        assert joints[0].message.name == truth["joint_names"]
        right, left = (joints[0].message.name.index(f"{side}_wheel_joint") for side in ("right", "left"))
        step = np.radians(truth["tick_deg"])
        for stop in truth["stops"]:
            for r in joints:
                if stop["t_start"] <= (r.stamp_ns - truth["t0_ns"]) / 1e9 <= stop["t_end"]:
                    behind = np.array(stop["wheel_angles_RL"]) - r.message.position[[right, left]]
                    assert np.all((behind > -1e-9) & (behind < step + 1e-9))
        position = np.array([r.message.position for r in joints])
        velocity = np.array([r.message.velocity for r in joints])
        np.testing.assert_allclose(velocity[1:] * 0.02, np.diff(position, axis=0), atol=1e-9)
        if len(orders) == 2:
            break
    assert orders == {("left_wheel_joint", "right_wheel_joint"), ("right_wheel_joint", "left_wheel_joint")}


def test_pictures_show_the_box_from_the_true_pose(tmp_path: Path) -> None:
    found, truth, _ = write(tmp_path / "a.mcap", PLAIN)
    pictures = [r for r in found if r.topic == truth["camera_topic"]]
    for stop in truth["stops"]:
        shown = next(r for r in pictures if (r.stamp_ns - truth["t0_ns"]) / 1e9 > stop["t_start"]).message
        image = shown.data.reshape(shown.height, shown.width)
        T_cam_box = inverse(np.array(stop["T_world_camera"]))
        np.testing.assert_array_equal(image, render(TARGET, ROBOT.camera, T_cam_box, (640, 480), SensorModel()))


def test_opencv_finds_twenty_tags_where_the_truth_puts_them(tmp_path: Path) -> None:
    found, truth, _ = write(tmp_path / "a.mcap", RecordOptions(frames=1, moving_frames=0))
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    pictures = [r.message for r in found if r.topic == truth["camera_topic"]]
    for picture, stop in zip(pictures, truth["stops"], strict=True):
        corners, ids, _ = detector.detectMarkers(cv2.imdecode(picture.data, cv2.IMREAD_GRAYSCALE))
        rows_of = np.searchsorted(TARGET.tag_ids, np.ravel(ids))
        T_cam_box = inverse(np.array(stop["T_world_camera"]))
        p_cam = TARGET.tag_corners[rows_of] @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
        off = np.abs(np.reshape(corners, (-1, 4, 2)) - project(ROBOT.camera, p_cam)).max(axis=(1, 2))
        assert np.sum(off < 1.5) >= 20


@pytest.mark.parametrize(
    ("image", "kind", "magic"),
    [("jpeg", "CompressedImage", b"\xff\xd8"), ("png", "CompressedImage", b"\x89PNG"), ("raw", "Image", b"")],
)
@pytest.mark.parametrize("compression", ["lz4"])
def test_pictures_come_as_asked_for(tmp_path: Path, image: str, kind: str, magic: bytes, compression: str) -> None:
    options = RecordOptions(frames=1, moving_frames=0, image=image, compression=compression)
    found, truth, _ = write(tmp_path / "a.mcap", options)
    picture = next(r for r in found if r.topic == truth["camera_topic"])
    assert picture.kind == f"sensor_msgs/msg/{kind}"
    assert bytes(picture.message.data[:4]).startswith(magic)
    assert picture.topic == f"/camera/image_raw{'' if image == 'raw' else '/compressed'}"


def test_moving_pictures_are_blurred_by_the_motion_and_still_ones_are_not() -> None:
    driven = drive()
    speed = np.abs(np.diff(driven.path[:, 2]))
    fastest = int(driven.path_t_ns[int(speed.argmax())])
    for t_ns, blurred in ((fastest, True), (int(driven.stop_t_ns[1].mean()), False)):
        sharp, long = (
            take_picture(
                ROBOT, TARGET, driven, t_ns, options=replace(PLAIN, exposure_s=s), rng=np.random.default_rng(0)
            ).astype(float)
            for s in (0.0, 0.02)
        )
        contrast = [np.abs(np.diff(image, axis=1)).mean() for image in (sharp, long)]
        assert (contrast[1] < 0.7 * contrast[0]) == blurred
        assert np.array_equal(sharp, long) != blurred


def test_length_of_the_streak_is_the_true_motion_during_the_exposure(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []
    monkeypatch.setattr("boxcal.calib.simulate.recorder.render", lambda *args, **_: looks.append(args[4]))
    robot = turtlebot()
    stops = np.array([[0.6, 0.0, np.pi], [0.6, 0.0, np.pi + 3]])
    driven = simulate_drive(robot, TARGET, replace(DRIVEN, slip=0), np.random.default_rng(0), stops)
    t_ns = int((driven.stop_t_ns[0, 1] + driven.stop_t_ns[1, 0]) // 2)
    take_picture(robot, TARGET, driven, t_ns, options=PLAIN, rng=np.random.default_rng(0))
    rate = np.diff(driven.pose_at(np.array([t_ns - 10**6, t_ns + 10**6]))[:, 2])[0] / 2e-3
    # A camera that turns about a point a little behind it: the centre of the picture moves by f * angle, and more.
    level = PLAIN.exposure_s * rate * robot.camera.fu
    assert level * 0.95 < looks[0].motion_blur_px < level * 1.3
    assert abs(np.sin(looks[0].motion_angle)) < 0.1


def test_truth_file_has_the_form_that_is_read_and_the_drives_figures(tmp_path: Path) -> None:
    driven = drive()
    path = tmp_path / "r05.truth.json"
    path.write_bytes(truth_bytes(ROBOT, driven, DRIVEN, PLAIN, ("left_wheel_joint", "right_wheel_joint")))
    truth = load_truth(path)
    assert truth.camera == ROBOT.camera
    assert (truth.wheels.rR, truth.wheels.rL, truth.wheels.b) == (ROBOT.rR, ROBOT.rL, ROBOT.b)
    np.testing.assert_array_equal(truth.T_body_cam, ROBOT.T_body_cam)
    document = json.loads(path.read_bytes())
    np.testing.assert_array_equal([s["pose"] for s in document["stops"]], driven.stop_poses)
    np.testing.assert_array_equal([s["T_world_camera"] for s in document["stops"]], driven.T_box_cam)
    np.testing.assert_array_equal([s["wheel_angles_RL"] for s in document["stops"]], driven.stop_phi)
    assert document["nominal"]["r"] == pytest.approx(ROBOT.rR, rel=0.05)
    assert (document["slip"], document["tick_deg"]) == (0.0002, 0.1302)


def test_truth_has_every_key_of_the_shared_truth_that_a_calibration_needs(shared_data: Path) -> None:
    theirs = json.loads((shared_data / "fleet" / "khepera.truth.json").read_bytes())
    ours = json.loads(truth_bytes(ROBOT, drive(), DRIVEN, PLAIN, ("a", "b")))
    rooms = json.loads((shared_data / "rooms" / "going00.truth.json").read_bytes())
    assert set(ours) - {"lean_deg", "camera_stamp_drift", "camera_faults"} <= {*theirs, *rooms}
    assert {"model", "k", "box", "wheel", "tilt", "slip_true", "note", "camera_stamp_offset_s"} <= set(ours)
    for key in ("camera", "nominal"):
        assert set(ours[key]) == set(theirs[key])
    assert set(ours["stops"][0]) == set(theirs["stops"][0])


def test_frame_times_are_ascending_and_follow_the_generator() -> None:
    driven = drive()
    a, b, c = (frame_times(driven, PLAIN, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.all(np.diff(a) > 0)
    np.testing.assert_array_equal(a, b)
    assert np.any(a != c)


def test_unknown_picture_kind_is_refused() -> None:
    with pytest.raises(CalibError, match="jpeg, png, raw"):
        RecordOptions(image="gif")


def test_a_rolling_shutter_sees_each_row_at_its_own_time() -> None:
    driven, rng = drive(), np.random.default_rng(1)
    between = int((driven.stop_t_ns[0, 1] + driven.stop_t_ns[1, 0]) // 2)
    options = replace(PLAIN, readout_s=0.04, exposure_s=1e-4)
    rolled = take_rows(ROBOT, TARGET, driven, between, options=options, rng=rng)
    height = rolled.shape[0]
    for row in (0, height // 2, height - 8):
        at = between + round(0.04e9 * ((row + 4) / height - 0.5))
        whole = take_picture(ROBOT, TARGET, driven, at, options=options, rng=rng)
        np.testing.assert_array_equal(rolled[row : row + 8], whole[row : row + 8])
    still = int(driven.stop_t_ns[0].mean())
    stands = take_rows(ROBOT, TARGET, driven, still, options=options, rng=rng)
    np.testing.assert_array_equal(stands, take_picture(ROBOT, TARGET, driven, still, options=options, rng=rng))


def test_stamps_are_late_and_jitter_as_asked(tmp_path: Path) -> None:
    driven = drive()
    asked = {
        "a": PLAIN,
        "b": replace(PLAIN, late_s=0.03),
        "c": replace(PLAIN, jitter_s=0.004),
        "d": replace(PLAIN, clock_rate=1e-3, clock_jump_s=0.2),
    }
    for name, options in asked.items():
        write_log(tmp_path / f"{name}.mcap", ROBOT, TARGET, driven, options, rng=np.random.default_rng(2))
    a, b, c, d = (
        np.array([row.stamp_ns for row in rows(tmp_path / f"{name}.mcap") if row.kind == "sensor_msgs/msg/Image"])
        for name in asked
    )
    np.testing.assert_array_equal(b - a, 30_000_000)
    assert 1e6 < np.std(c - a) < 8e6
    middle = (driven.path_t_ns[0] + driven.path_t_ns[-1]) // 2
    late = 1e-3 * (a - middle) + 2e8 * (a > middle)
    assert 0 < np.sum(a > middle) < len(a)
    np.testing.assert_allclose(d - a, late, rtol=0, atol=1)
