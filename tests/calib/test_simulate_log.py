"""The log writer: what it writes, other libraries read."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from boxcal.calib.errors import CalibError
from boxcal.calib.simulate.mcap_writer import COMPRESSIONS, LogWriter

T0 = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)


def write(path: Path, compression: str = "zstd") -> None:
    with LogWriter(path, compression=compression) as log:
        log.joint_state("/joint_states", T0 + 7, T0 + 2_000_000, ("l", "r"), (0.25, -0.5), (1.0, 2.0))
        log.compressed_image("/cam/compressed", T0 + 8, T0 + 3_000_000, b"\xff\xd8not a picture", "jpeg")
        log.image("/cam", T0 + 9, T0 + 4_000_000, np.arange(12, dtype=np.uint8).reshape(3, 4))


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_messages_read_back_with_types_stamps_and_content(tmp_path: Path, compression: str) -> None:
    write(tmp_path / "a.mcap", compression)
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        rows = list(reader.iter_messages())
    assert [(s.name, s.encoding, c.topic, c.message_encoding, m.log_time - T0) for s, c, m in rows] == [
        ("sensor_msgs/msg/JointState", "ros2msg", "/joint_states", "cdr", 2_000_000),
        ("sensor_msgs/msg/CompressedImage", "ros2msg", "/cam/compressed", "cdr", 3_000_000),
        ("sensor_msgs/msg/Image", "ros2msg", "/cam", "cdr", 4_000_000),
    ]
    messages: list[Any] = [STORE.deserialize_cdr(m.data, s.name) for s, _, m in rows]
    joints, picture, image = messages
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec - T0 for m in messages] == [7, 8, 9]
    assert (joints.name, joints.position.tolist(), joints.velocity.tolist()) == (["l", "r"], [0.25, -0.5], [1.0, 2.0])
    assert (picture.format, bytes(picture.data)) == ("jpeg", b"\xff\xd8not a picture")
    assert (image.height, image.width, image.step, image.encoding) == (3, 4, 4, "mono8")
    assert image.data.tolist() == list(range(12))


def test_rosbags_reads_the_log_as_a_bag(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    with Reader(tmp_path / "a.mcap") as bag:
        assert {c.topic: c.msgtype for c in bag.connections} == {
            "/joint_states": "sensor_msgs/msg/JointState",
            "/cam/compressed": "sensor_msgs/msg/CompressedImage",
            "/cam": "sensor_msgs/msg/Image",
        }
        assert bag.message_count == 3


def test_same_calls_give_same_bytes(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    write(tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_failed_log_leaves_the_old_one_and_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"old")
    with pytest.raises(CalibError, match="no_such"), LogWriter(path) as log:
        log.raw("/j", "no_such/msg/Kind", T0, b"")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
    write(path)
    assert path.read_bytes() != b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_unknown_compression_and_unfitting_image_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibError, match="none, lz4, zstd"):
        LogWriter(tmp_path / "a.mcap", compression="gzip")
    with pytest.raises(CalibError, match="bgr8"), LogWriter(tmp_path / "a.mcap") as log:
        log.image("/cam", T0, T0, np.zeros((2, 2), dtype=np.uint8), "bgr8")
