"""Files that are no logs, broken logs and logs made to do harm: every one ends in a DetectError with a remedy."""

import re
import struct
import zipfile
import zlib
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import pytest
import zstandard
from mcap.writer import Writer
from robot_logs import BLANKS, counters, images, write_mcap
from small_logs import (
    CAMERA,
    JOINTS,
    LEFT,
    RIGHT,
    T0_NS,
    blank,
    drive,
    write_frames,
    write_joints,
    write_log,
    write_small,
)

from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.detect.errors import DetectError
from boxcal.detect.log import readings
from boxcal.detect.log.containers import base, mcap
from boxcal.detect.log.containers.mcap_records import MAGIC
from boxcal.detect.log.losses import LossKind
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits


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
        (b"", r"a.mcap: an empty file, a recording of a robot is needed .*; record again"),
        (b"#ROSBAG V2.0\n....", r"a.mcap: truncated or damaged at byte 13, .*; recover what is there"),
        (b"#ROSBAG V1.2\n....", r"a.mcap: a ROS 1 bag of format 1, .*; convert it"),
        (b"SQLite format 3\x00....", r"a.mcap: does not open \(.*\), a ROS 2 bag"),
        (b"PK\x03\x04 something else", r"a.mcap: not an MCAP \(begins with 50 4b 03 04 .*record with `ros2 bag"),
        (MAGIC[:5], r"a.mcap: an MCAP truncated in its first bytes"),
        (MAGIC, r"a.mcap: truncated at byte 8, .*; recover what is there with `mcap recover`"),
        (MAGIC + b"\x06", r"a.mcap: truncated at byte 9"),
        (MAGIC + _record(2, bytes(20)), r"a.mcap: truncated after its footer.*`mcap recover`"),
        (
            MAGIC + struct.pack("<BQ", 9, 1 << 62),
            r"truncated or damaged: the record at byte 8 claims 4611686018427387",
        ),
        (MAGIC + _record(2, bytes(20)) + MAGIC, r"a.mcap: no topics, a camera and wheel readings are needed"),
    ],
)
def test_what_is_no_whole_mcap_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(DetectError, match=message):
        open_recording(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(DetectError, match=r"/none.mcap: no such file, a recording .* is needed .*; check the path"):
        open_recording(tmp_path / "none.mcap")
    for pattern in ("*.mcap", "r0?.mcap", "r[0-9].mcap"):  # a shell leaves a pattern that matches nothing as it is
        with pytest.raises(DetectError, match=r": no file matches this pattern, a recording .* is needed"):
            open_recording(tmp_path / pattern)
    (tmp_path / "bag").mkdir()
    with pytest.raises(
        DetectError, match=r"bag: a folder without a recording, a bag .* or images with wheels.csv; name the recording"
    ):
        open_recording(tmp_path / "bag")


def test_a_log_of_another_middleware_is_named_with_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", b"")
        channel = writer.register_channel("/joint_states", "cbor", schema)
        writer.register_channel("/x", "flatbuffer", 0)
        writer.add_message(channel, 0, b"1234", 0)
        writer.finish()
    with pytest.raises(
        DetectError,
        match=r"its messages are cbor, flatbuffer \(.*sensor_msgs/msg/JointState.*\), CDR, ROS 1, protobuf or",
    ):
        open_recording(path)


@pytest.mark.parametrize(
    ("chunk", "message"),
    [
        (_chunk(b"x" * 10, 1 << 40, b""), r"claims to unpack to 1099511627776 bytes, at most"),
        (_chunk(zstandard.compress(bytes(1 << 26)), 100, b"zstd"), r"claims to unpack to 100 bytes and unpacks to m"),
        (_chunk(lz4.frame.compress(bytes(1 << 26)), 100, b"lz4"), r"claims to unpack to 100 bytes and unpacks to more"),
        (_chunk(zstandard.compress(bytes(10)), 100, b"zstd"), r"unpacks to 10\).*; recover"),
        (_chunk(b"no zstd at all", 100, b"zstd"), r"is damaged \([a-z ]*: Unknown frame descriptor\) and was left out"),
        (_chunk(b"no lz4 at all", 100, b"lz4"), r"is damaged \([A-Z a-z_:]*LZ4F[^)]*\) and was left out"),
        (_chunk(b"x", 1, b"br"), r"compressed with 'br', zstd and lz4 are read"),
        (_chunk(b"x" * 9, 9, b"", crc=1), r"checksum does not match"),
        (_chunk(struct.pack("<BQ", 5, 99), 9, b""), r"a record in its chunk claims 99 bytes, the chunk has 0 more"),
        (_record(5, b"short"), r"is damaged inside|no topics"),
        (_record(5, struct.pack("<HIQQ", 7, 0, 0, 0)), r"messages of channel 7, which the file does not describe"),
        (_record(4, struct.pack("<HHI", 1, 1, 1 << 31) + b"/topic"), r"damaged|not describe|no topics"),
        (
            _record(4, struct.pack("<HHI", 1, 1, 2) + b"\xff\xff" + bytes(8)),
            r"a channel is damaged \(UnicodeDecodeError",
        ),
    ],
)
def test_a_damaged_or_lying_record_is_refused(tmp_path: Path, chunk: bytes, message: str) -> None:
    with pytest.raises(DetectError, match=message):
        open_recording(_file(tmp_path / "a.mcap", chunk))


def test_a_record_larger_than_the_bound_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap, "MAX_RECORD_BYTES", 1000)
    monkeypatch.setattr(mcap, "_BLOCK", 100)
    with pytest.raises(DetectError, match=r"the record at byte 8 claims 2000 bytes, at most 1000 are read"):
        open_recording(_file(tmp_path / "a.mcap", _record(6, bytes(2000))))


def test_too_many_messages_samples_or_joints_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_small(tmp_path / "a.mcap")
    with monkeypatch.context() as patch:
        patch.setattr(base, "_FREE_MESSAGES", -path.stat().st_size // 8 + 10)
        with pytest.raises(DetectError, match=r"a.mcap: more than \d+ messages in \d+ bytes"):
            open_recording(path)
    with monkeypatch.context() as patch:
        patch.setattr(readings, "MAX_SAMPLES", 10)
        with pytest.raises(DetectError, match=r"a.mcap: more than 10 wheel readings and images; split the log"):
            open_recording(path)
    monkeypatch.setattr(readings, "MAX_NAMES", 1)
    with pytest.raises(DetectError, match=r"more than 1 different joints"):
        open_recording(path)


def test_names_from_a_log_are_shown_without_control_characters(tmp_path: Path) -> None:
    def odd(log: object) -> None:
        write_joints(log, topic="/evil\x1b[31m" + "x" * 500)  # type: ignore[arg-type]

    with pytest.raises(DetectError) as caught:
        open_recording(write_log(tmp_path / "a.mcap", odd))
    assert "\x1b" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_joint_message_that_does_not_decode_is_counted_and_said(tmp_path: Path) -> None:
    def broken(log: LogWriter) -> None:
        log.raw(JOINTS, "sensor_msgs/msg/JointState", 5 * 10**9, b"\x00\x01\x00\x00" + bytes(8) + b"\xff" * 8)

    recording = open_recording(write_log(tmp_path / "a.mcap", write_joints, broken, write_frames))
    assert any("/joint_states: 1 message left out" in note for note in recording.notes)
    np.testing.assert_array_equal(recording.wheels.phi_R, drive()[1])
    with pytest.raises(DetectError, match=r"no messages with joints.*; and /joint_states: 1 message"):
        open_recording(write_log(tmp_path / "b.mcap", write_frames, broken))


def _in_order(path: Path, compression: str) -> Path:
    """Write the small log as a recorder does: by time."""
    t_ns, phi_R, phi_L, _ = drive()
    due = [T0_NS + round((0.5 + 2 * k) * 1e9) for k in range(4)]
    with LogWriter(path, compression=compression, chunk_bytes=1 << 11) as log:
        for t, right, left in zip(t_ns.tolist(), phi_R, phi_L, strict=True):
            log.joint_state(JOINTS, t, t + 2_000_000, [LEFT, RIGHT], [left, right])
            if t in due:
                log.image(CAMERA, t, t + 3_000_000, blank() + np.uint8(due.index(t)))
    return path


def _is_part_of_the_truth(recording: Recording) -> bool:
    """Tell whether every reading and image is one of the sound log's."""
    t_ns, phi_R, phi_L, _ = drive()
    wheels = recording.wheels
    at = np.searchsorted(t_ns, wheels.t_ns)
    right = np.array_equal(t_ns[at], wheels.t_ns) and np.array_equal(phi_R[at], wheels.phi_R)
    images = dict(recording.read_frames(range(recording.frame_t_ns.size)))
    return bool(
        right
        and np.array_equal(phi_L[at], wheels.phi_L)
        and all(np.array_equal(i, blank() + np.uint8(round((t - T0_NS) / 2e9 - 0.25))) for t, i in images.items())
    )


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_of_a_cut_log_what_stands_before_the_cut_is_used_and_the_loss_said(tmp_path: Path, compression: str) -> None:
    content = _in_order(tmp_path / "a.mcap", compression).read_bytes()
    cut, used = tmp_path / "cut.mcap", 0
    for length in np.random.default_rng(1).integers(0, len(content) - 1, 40):
        cut.write_bytes(content[:length])
        try:
            recording = open_recording(cut)
        except DetectError as error:
            assert "truncated" in str(error) or "empty" in str(error)  # noqa: PT017
            continue
        used += 1
        assert _is_part_of_the_truth(recording)
        assert any("truncated" in note for note in recording.notes)
    assert used > 20


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_flipped_bytes_give_what_is_right_and_say_what_is_lost_or_one_line(tmp_path: Path, compression: str) -> None:
    content = write_small(tmp_path / "a.mcap", compression=compression, chunk_bytes=1 << 12).read_bytes()
    rng, said = np.random.default_rng(2), 0
    for _ in range(60):
        damaged = bytearray(content)
        for at in rng.integers(8, len(content), rng.integers(1, 4)):
            damaged[at] ^= 1 << int(rng.integers(8))
        (tmp_path / "b.mcap").write_bytes(damaged)
        try:
            recording = open_recording(tmp_path / "b.mcap")
        except DetectError:
            said += 1
            continue
        said += bool(recording.notes)
        assert _is_part_of_the_truth(recording)
        whole = len(recording.wheels) == len(drive()[0]) and recording.frame_t_ns.size == 4
        assert whole or recording.notes
    assert said > 10


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


def test_a_chunk_of_a_ros1_bag_without_its_size_is_damage(tmp_path: Path) -> None:
    pytest.importorskip("mcap_ros1")
    from recorded_kinds import KINDS, events  # noqa: PLC0415  (needs extras)

    path = KINDS["ROS 1 bag"](tmp_path / "r", events())
    content = path.read_bytes()
    at = content.index(b"size=", content.index(b"compression=") - 200)
    path.write_bytes(content[:at] + b"sizf=" + content[at + 5 :])
    try:
        found = open_recording(path)
    except DetectError as error:
        assert "\n" not in str(error)  # noqa: PT017
        return
    assert any("damaged" in note for note in found.notes)


def test_times_beyond_all_measure_are_dropped(tmp_path: Path) -> None:
    """Times of recording are unsigned in MCAP: the last message's, the year 2280, is as int64 too early to subtract."""
    angles = tuple(a[:200] for a in drive(step=0)[:3])
    parts = list(counters(angles, "Int32", "/right_ticks", "/left_ticks"))  # type: ignore[arg-type]
    late = [(topic, kind, (1 << 63) + (1 << 59), message) for topic, kind, _, message in parts[-1:]]
    path = write_mcap(tmp_path / "a.mcap", [*parts, *late], images(BLANKS))
    found = open_recording(path, units=WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=1200))
    assert found.wheels.t_ns[-1] == angles[0][-1]
    assert np.max(np.diff(found.wheels.t_ns)) < 1e9


def test_readings_beyond_all_measure_are_dropped_and_counted(tmp_path: Path) -> None:
    def wild(log: LogWriter) -> None:
        write_joints(log)
        for k in range(2):
            t = T0_NS + 100_000_000 * (k + 1) + 5
            log.joint_state(JOINTS, t, t + 2_000_000, [LEFT, RIGHT], [1e300, -1e308])

    found = open_recording(write_log(tmp_path / "a.mcap", wild, write_frames))
    assert np.max(np.abs(found.wheels.phi_R)) < 1e3
    for joint in (LEFT, RIGHT):
        assert any(re.match(rf"2 of \d+ readings of {joint} are no numbers, or", note) for note in found.notes)


@pytest.mark.parametrize(("wrong", "lost"), [(slice(0, 100), 0), (slice(100, 106), 0), (slice(100, 110), 2)])
def test_many_readings_that_are_no_numbers_are_a_loss_but_not_before_the_motors_answer(
    tmp_path: Path, wrong: slice, lost: int
) -> None:
    t_ns, right, left, _ = drive()
    right, left = right.copy(), left.copy()
    right[wrong] = left[wrong] = np.nan

    def joints(log: LogWriter) -> None:
        for t, of_right, of_left in zip(t_ns.tolist(), right, left, strict=True):
            log.joint_state(JOINTS, t, t + 2_000_000, [LEFT, RIGHT], [of_left, of_right])

    found = open_recording(write_log(tmp_path / "a.mcap", joints, write_frames))
    assert sum(" are no numbers, or" in note for note in found.notes) == 2
    assert [loss.kind for loss in found.losses] == [LossKind.NO_NUMBERS] * lost


@pytest.mark.parametrize(("broken", "said"), [(1, "1 message left out"), (20, "20 of {} messages do not decode")])
def test_messages_that_do_not_decode_are_counted_and_many_are_said_as_a_loss(
    tmp_path: Path, broken: int, said: str
) -> None:
    """One stray message is chance; more than one in fifty is a loss, in the words that the verdict knows."""

    def wild(log: LogWriter) -> None:
        write_joints(log)
        for k in range(broken):
            bad = b"\0\1\0\0" + bytes(8) + b"\xff" * (k + 4)
            log.raw("/joint_states", "sensor_msgs/msg/JointState", T0_NS + k, bad)

    found = open_recording(write_log(tmp_path / "a.mcap", wild, write_frames))
    assert found.lost_messages == broken
    said = said.format(broken + len(found.wheels.t_ns))
    assert any(f"/joint_states: {said}" in note for note in found.notes)
