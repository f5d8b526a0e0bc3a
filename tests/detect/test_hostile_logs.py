"""Files that are no logs, broken logs and logs made to do harm: every one ends in a DetectError with a remedy."""

import struct
import zipfile
import zlib
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import pytest
import zstandard
from mcap.writer import Writer
from small_logs import JOINTS, write_frames, write_joints, write_log, write_small

from boxcal.detect.errors import DetectError
from boxcal.detect.log import mcap_records, scan
from boxcal.detect.log.mcap_records import MAGIC
from boxcal.detect.log.recording import open_recording


def _record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _chunk(data: bytes, size: int, compression: bytes, crc: int = 0) -> bytes:
    head = struct.pack("<QQQII", 0, 0, size, crc, len(compression)) + compression
    return _record(6, head + struct.pack("<Q", len(data)) + data)


def _file(path: Path, *records: bytes) -> Path:
    path.write_bytes(MAGIC + b"".join(records) + _record(2, bytes(20)) + MAGIC)
    return path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"a.mcap: an empty file, an MCAP file is needed; record again"),
        (b"#ROSBAG V2.0\n....", r"a.mcap: a ROS 1 bag, .*convert it with `rosbags-convert --src in.bag"),
        (b"SQLite format 3\x00....", r"a.mcap: a ROS 2 bag in sqlite3 storage \(.db3\), .*rosbags-convert"),
        (b"PK\x03\x04 something else", r"a.mcap: not an MCAP \(begins with 50 4b 03 04 .*record with `ros2 bag"),
        (MAGIC[:5], r"a.mcap: an MCAP truncated in its first bytes"),
        (MAGIC, r"a.mcap: truncated at byte 8, between two records; recover what is there with `mcap recover`"),
        (MAGIC + b"\x06", r"a.mcap: truncated at byte 9"),
        (MAGIC + _record(2, bytes(20)), r"a.mcap: truncated after its footer.*`mcap recover`"),
        (
            MAGIC + struct.pack("<BQ", 9, 1 << 62),
            r"truncated or damaged: the record at byte 8 claims 4611686018427387",
        ),
        (MAGIC + _record(2, bytes(20)) + MAGIC, r"a.mcap: no topics, a camera and joint states are needed"),
    ],
)
def test_what_is_no_whole_mcap_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(DetectError, match=message):
        open_recording(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(DetectError, match=r"none.mcap: no such file, a log in MCAP is needed; check the path"):
        open_recording(tmp_path / "none.mcap")
    (tmp_path / "bag").mkdir()
    with pytest.raises(DetectError, match=r"bag: is a folder, one .mcap file is needed; name the file inside it"):
        open_recording(tmp_path / "bag")


def test_a_log_of_another_middleware_is_named_with_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", b"")
        channel = writer.register_channel("/joint_states", "ros1", schema)
        writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 0, b"1234", 0)
        writer.finish()
    with pytest.raises(DetectError, match=r"not a ROS 2 log: its messages are .*ros1 of sensor_msgs/JointState.*CDR"):
        open_recording(path)


@pytest.mark.parametrize(
    ("chunk", "message"),
    [
        (_chunk(b"x" * 10, 1 << 40, b""), r"claims to unpack to 1099511627776 bytes, at most"),
        (_chunk(zstandard.compress(bytes(1 << 26)), 100, b"zstd"), r"claims to unpack to 100 bytes and unpacks to m"),
        (_chunk(lz4.frame.compress(bytes(1 << 26)), 100, b"lz4"), r"claims to unpack to 100 bytes and unpacks to more"),
        (_chunk(zstandard.compress(bytes(10)), 100, b"zstd"), r"unpacks to 10; recover"),
        (_chunk(b"no zstd at all", 100, b"zstd"), r"is damaged \(ZstdError"),
        (_chunk(b"no lz4 at all", 100, b"lz4"), r"is damaged \(RuntimeError"),
        (_chunk(b"x", 1, b"br"), r"compressed with 'br', zstd and lz4 are read"),
        (_chunk(b"x" * 9, 9, b"", crc=1), r"checksum does not match"),
        (_chunk(struct.pack("<BQ", 5, 99), 9, b""), r"a record in its chunk claims 99 bytes, the chunk has 0 more"),
        (_record(5, b"short"), r"is damaged \(error: "),
        (_record(5, struct.pack("<HIQQ", 7, 0, 0, 0)), r"a message of channel 7, which the file does not describe"),
        (_record(4, struct.pack("<HHI", 1, 1, 1 << 31) + b"/topic"), r"damaged|not describe|no topics"),
        (_record(4, struct.pack("<HHI", 1, 1, 2) + b"\xff\xff" + bytes(8)), r"is damaged \(UnicodeDecodeError"),
    ],
)
def test_a_damaged_or_lying_record_is_refused(tmp_path: Path, chunk: bytes, message: str) -> None:
    with pytest.raises(DetectError, match=message):
        open_recording(_file(tmp_path / "a.mcap", chunk))


def test_a_record_larger_than_the_bound_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_records, "MAX_RECORD_BYTES", 1000)
    with pytest.raises(DetectError, match=r"the record at byte 8 claims 2000 bytes, at most 1000 are read"):
        open_recording(_file(tmp_path / "a.mcap", _record(3, bytes(2000))))


def test_too_many_messages_samples_or_joints_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_small(tmp_path / "a.mcap")
    with monkeypatch.context() as patch:
        patch.setattr(mcap_records, "MAX_MESSAGES", 10)
        with pytest.raises(DetectError, match=r"a.mcap: more than 10 messages"):
            open_recording(path)
    with monkeypatch.context() as patch:
        patch.setattr(scan, "MAX_SAMPLES", 10)
        with pytest.raises(DetectError, match=r"a.mcap: more than 10 joint readings and images; split the log"):
            open_recording(path)
    monkeypatch.setattr(scan, "MAX_NAMES", 1)
    with pytest.raises(DetectError, match=r"more than 1 different joints"):
        open_recording(path)


def test_names_from_a_log_are_shown_without_control_characters(tmp_path: Path) -> None:
    def odd(log: object) -> None:
        write_joints(log, topic="/evil\x1b[31m" + "x" * 500)  # type: ignore[arg-type]

    with pytest.raises(DetectError) as caught:
        open_recording(write_log(tmp_path / "a.mcap", odd))
    assert "\x1b" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_joint_message_that_does_not_decode_is_named_by_topic_and_time(tmp_path: Path) -> None:
    def broken(log: object) -> None:
        log.raw(JOINTS, "sensor_msgs/msg/JointState", 5 * 10**9, b"\x00\x01\x00\x00" + bytes(8) + b"\xff" * 8)  # type: ignore[attr-defined]

    with pytest.raises(DetectError, match=r"a.mcap: /joint_states at log time 5.000 s: a message does not decode as"):
        open_recording(write_log(tmp_path / "a.mcap", write_frames, broken))


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_every_truncation_is_refused(tmp_path: Path, compression: str) -> None:
    content = write_small(tmp_path / "a.mcap", compression=compression).read_bytes()
    cut = tmp_path / "cut.mcap"
    for length in np.random.default_rng(1).integers(0, len(content) - 1, 40):
        cut.write_bytes(content[:length])
        with pytest.raises(DetectError, match=r"cut.mcap: .*(truncated|empty)"):
            open_recording(cut)


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_flipped_bytes_give_a_recording_or_a_detect_error_and_nothing_else(tmp_path: Path, compression: str) -> None:
    content = write_small(tmp_path / "a.mcap", compression=compression, chunk_bytes=1 << 12).read_bytes()
    rng, refused = np.random.default_rng(2), 0
    for _ in range(60):
        damaged = bytearray(content)
        for at in rng.integers(8, len(content), rng.integers(1, 4)):
            damaged[at] ^= 1 << int(rng.integers(8))
        (tmp_path / "b.mcap").write_bytes(damaged)
        try:
            recording = open_recording(tmp_path / "b.mcap")
            list(recording.read_frames(range(recording.frame_t_ns.size)))
        except DetectError:
            refused += 1
    assert refused > 10


def test_flipped_bytes_inside_messages_that_no_checksum_guards_do_no_harm(tmp_path: Path) -> None:
    """The same on uncompressed chunks whose checksums are made right again: damage reaches the decoders."""
    content = bytearray(write_small(tmp_path / "a.mcap", compression="none", chunk_bytes=1 << 12).read_bytes())
    chunks, at = [], len(MAGIC)
    while at < len(content) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", content, at)
        if opcode == 6:
            chunks.append((at + 9, length))
        at += 9 + length
    rng, refused = np.random.default_rng(3), 0
    for _ in range(80):
        damaged = bytearray(content)
        start, length = chunks[int(rng.integers(len(chunks)))]
        data = start + 40
        for where in rng.integers(data, start + length, 3):
            damaged[where] = int(rng.integers(256))
        struct.pack_into("<I", damaged, start + 24, zlib.crc32(damaged[data : start + length]))
        (tmp_path / "b.mcap").write_bytes(damaged)
        try:
            recording = open_recording(tmp_path / "b.mcap")
            list(recording.read_frames(range(recording.frame_t_ns.size)))
        except DetectError:
            refused += 1
    assert refused > 5


def test_no_conformance_file_ends_in_anything_but_a_detect_error(tmp_path: Path, shared_data: Path) -> None:
    """The MCAP conformance files hold no robot's log, so each is refused; none for its layout."""
    messages = []
    with zipfile.ZipFile(shared_data / "mcap-conformance" / "conformance.zip") as archive:
        for name in archive.namelist():
            if name.endswith(".mcap"):
                path = tmp_path / "a.mcap"
                path.write_bytes(archive.read(name))
                with pytest.raises(DetectError) as caught:
                    open_recording(path)
                messages.append(str(caught.value))
    assert len(messages) > 400
    assert not [m for m in messages if "damaged" in m or "truncated" in m or "not an MCAP" in m]
