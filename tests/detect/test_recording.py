"""Opening a log: what is found in it, however it is laid out, and what is said where something is missing."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore
from small_logs import (
    CAMERA,
    COMPRESSED,
    JOINTS,
    LEFT,
    RIGHT,
    STEP,
    T0_NS,
    blank,
    drive,
    jpeg,
    write_frames,
    write_joints,
    write_log,
    write_small,
)

from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.topics import Topics


def _check(recording: Recording) -> None:
    t_ns, phi_R, phi_L, _ = drive()
    np.testing.assert_array_equal(recording.wheels.t_ns, t_ns)
    np.testing.assert_array_equal(recording.wheels.phi_R, phi_R)
    np.testing.assert_array_equal(recording.wheels.phi_L, phi_L)
    assert recording.wheels.encoder_steps == pytest.approx((STEP, STEP), rel=1e-9)
    frames = list(recording.read_frames(range(4)))
    assert [t for t, _ in frames] == [T0_NS + round((0.5 + 2 * k) * 1e9) for k in range(4)]
    for k, (_, image) in enumerate(frames):
        np.testing.assert_array_equal(image, blank() + np.uint8(k))


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("chunk_bytes", [1, 1 << 12, 1 << 22])
def test_a_log_reads_alike_under_every_compression_and_chunk_size(
    tmp_path: Path, compression: str, chunk_bytes: int
) -> None:
    _check(open_recording(write_small(tmp_path / "a.mcap", compression=compression, chunk_bytes=chunk_bytes)))


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("indexed", [True, False])
def test_a_log_reads_alike_with_and_without_chunks_index_and_summary(
    tmp_path: Path, chunked: bool, indexed: bool
) -> None:
    whole = write_small(tmp_path / "a.mcap")
    bare = tmp_path / "b.mcap"
    with whole.open("rb") as source, bare.open("wb") as sink:
        extras = dict.fromkeys(("repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets"), indexed)
        writer = Writer(sink, use_chunking=chunked, compression=CompressionType.NONE, chunk_size=4096, **extras)
        writer.start()
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.id not in channels and schema is not None:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.log_time)
        writer.finish()
    recording = open_recording(bare)
    _check(recording)
    recording.source.cache.places.clear()  # and again from their places in the file
    _check(recording)


def test_frames_are_read_in_any_order_and_by_time(tmp_path: Path) -> None:
    recording = open_recording(write_small(tmp_path / "a.mcap"))
    assert [int(image[0, 0]) for _, image in recording.read_frames([3, 0, 2])] == [3, 0, 2]
    t = recording.frame_t_ns
    assert recording.frames_between(int(t[1]), int(t[2])).tolist() == [1, 2]
    assert recording.frames_between(int(t[1]) + 1, int(t[2]) - 1).size == 0


def test_messages_out_of_order_and_repeated_stamps_give_the_same_samples(tmp_path: Path) -> None:
    t_ns, phi_R, phi_L, _ = drive()
    order = np.random.default_rng(0).permutation(t_ns.size)

    def shuffled(log: LogWriter) -> None:
        for k, i in enumerate([*order, *order[:20]]):
            log.joint_state(JOINTS, int(t_ns[i]), T0_NS + k, [LEFT, RIGHT], [phi_L[i], phi_R[i]])

    _check(open_recording(write_log(tmp_path / "a.mcap", shuffled, write_frames)))


def test_other_joints_nan_missing_velocities_and_other_topics_do_not_matter(tmp_path: Path) -> None:
    t_ns, phi_R, phi_L, _ = drive()
    store = get_typestore(Stores.ROS2_HUMBLE)
    text = store.types["std_msgs/msg/String"](data="hello")

    def mixed(log: LogWriter) -> None:
        for k, (t, right, left) in enumerate(zip(t_ns.tolist(), phi_R, phi_L, strict=True)):
            log.message("/rosout", t, text)
            log.joint_state(JOINTS, t, t, ["arm", "gripper"], [np.nan, 1.0], [0.0, np.nan])
            log.joint_state("/arm/joint_states", t, t, ["arm"], [float(k)])
            log.joint_state(JOINTS, t, t, [RIGHT, "pan", LEFT], [right, np.nan, left])
            log.joint_state(JOINTS, t + 1, t, [RIGHT, LEFT], [np.nan, np.inf])

    _check(open_recording(write_log(tmp_path / "a.mcap", mixed, write_frames)))


@pytest.mark.parametrize("topics", [(JOINTS, JOINTS), ("/left/joint_states", "/right/joint_states")])
def test_wheels_split_over_messages_or_topics_are_joined_on_one_time_base(
    tmp_path: Path, topics: tuple[str, str]
) -> None:
    t_ns, phi_R, phi_L, _ = drive(step=0)

    def split(log: LogWriter) -> None:
        for t, right, left in zip(t_ns.tolist(), phi_R, phi_L, strict=True):
            log.joint_state(topics[1], t + 1_000_000, t, [RIGHT], [right])
            log.joint_state(topics[0], t, t, [LEFT], [left])

    wheels = open_recording(write_log(tmp_path / "a.mcap", split, write_frames)).wheels
    assert len(wheels) == 2 * t_ns.size - 2
    np.testing.assert_allclose(np.interp(t_ns[1:-1], wheels.t_ns, wheels.phi_L), phi_L[1:-1], atol=1e-6)
    np.testing.assert_allclose(np.interp(t_ns[1:-1] + 1e6, wheels.t_ns, wheels.phi_R), phi_R[1:-1], atol=1e-6)


def test_a_raw_topic_is_taken_before_its_compressed_twin(tmp_path: Path) -> None:
    def both(log: LogWriter) -> None:
        write_frames(log)
        log.compressed_image(COMPRESSED, T0_NS, T0_NS, jpeg(blank()))

    path = write_log(tmp_path / "a.mcap", write_joints, both)
    assert open_recording(path).camera_topic == CAMERA
    chosen = open_recording(path, Topics(camera_topic=COMPRESSED))
    assert (chosen.camera_topic, chosen.frame_t_ns.size) == (COMPRESSED, 1)


def test_named_topics_and_joints_decide_where_names_do_not(tmp_path: Path) -> None:
    t_ns, phi_R, phi_L, _ = drive()

    def odd(log: LogWriter) -> None:
        for t, right, left in zip(t_ns.tolist(), phi_R, phi_L, strict=True):
            log.joint_state("/a", t, t, ["m1", "m2"], [left, right])
            log.joint_state("/b", t, t, ["m1", "m2"], [0.0, 0.0])
        write_frames(log, "/cam0")
        write_frames(log, CAMERA)

    path = write_log(tmp_path / "a.mcap", odd)
    _check(open_recording(path, Topics(camera_topic="cam0", joint_topic="/a", left_joint="m1", right_joint="m2")))


def _two_cameras(log: LogWriter) -> None:
    write_frames(log, "/front/image_raw")
    write_frames(log, "/rear/image_raw")


def _joints_named(*names: str, topic: str = JOINTS) -> Callable[[LogWriter], None]:
    def write(log: LogWriter) -> None:
        for k in range(20):
            log.joint_state(topic, T0_NS + k * 10**7, T0_NS, list(names), [k * 0.1] * len(names))

    return write


def _joints_without_positions(log: LogWriter) -> None:
    for k in range(20):
        log.joint_state(JOINTS, T0_NS + k * 10**7, T0_NS, [LEFT, RIGHT], [])


def _frames_later(log: LogWriter) -> None:
    write_frames(log, start_ns=T0_NS + 10**12)


def _no_camera(log: LogWriter) -> None:
    log.joint_state("/other", T0_NS, T0_NS, ["a"], [0.0])


@pytest.mark.parametrize(
    ("parts", "topics", "message"),
    [
        ([write_joints], {}, r"a.mcap: no camera topic, .*found: /joint_states \[sensor_msgs/msg/JointState\].*record"),
        ([write_frames], {}, r"a.mcap: no joint topic, .*found: /camera/image_raw \[sensor_msgs/msg/Image\].*record"),
        (
            [_joints_named("pan", "tilt"), write_frames],
            {},
            r"a.mcap: no wheel joints in /joint_states \(found: pan, tilt\); name them with --left-joint and",
        ),
        (
            [_joints_named("left_wheel", "tilt"), write_frames],
            {},
            r"a.mcap: no right wheel joint in /joint_states \(found: left_wheel, tilt\); name",
        ),
        (
            [write_joints, _two_cameras],
            {},
            r"a.mcap: 2 camera topics \(/front/image_raw, /rear/image_raw\), one is needed; .*--camera-topic",
        ),
        (
            [_joints_named("front_left_wheel", "rear_left_wheel", "right_wheel"), write_frames],
            {},
            r"2 joints can be the left wheel \(front_left_wheel, rear_left_wheel\), one .*--left-joint",
        ),
        (
            [write_joints, _joints_named(LEFT, RIGHT, topic="/more"), write_frames],
            {},
            r"2 joint topics with wheels \(/joint_states, /more\), one is needed; name it with --joint-topic",
        ),
        (
            [write_joints, write_frames],
            {"camera_topic": "/camera/imag_raw"},
            r"no camera topic /camera/imag_raw, image topics in the log: /camera/image_raw; .*did you mean /camera/ima",
        ),
        (
            [write_joints, write_frames],
            {"camera_topic": JOINTS},
            r"no camera topic /joint_states \(its type is sensor_msgs/msg/JointState\)",
        ),
        (
            [write_joints, write_frames],
            {"joint_topic": "/joint_state"},
            r"no joint topic /joint_state, joint topics in the log: /joint_states; .*did you mean /joint_states\?",
        ),
        (
            [write_joints, write_frames],
            {"left_joint": "left_whel_joint"},
            r"no joint left_whel_joint in /joint_states \(found: left_wheel_joint, right_wheel_joint\); .*--left-joint",
        ),
        (
            [write_joints, write_frames],
            {"left_joint": RIGHT},
            r"left and right wheel are both right_wheel_joint, two joints are needed",
        ),
        ([write_joints, _frames_later], {}, r"images are stamped 1700001000.500 to .* wheels 1700000000.000 .*clock"),
        (
            [_joints_without_positions, write_frames],
            {},
            r"joint right_wheel_joint in /joint_states: no positions, wheel angles .* needed; make the driver publish",
        ),
    ],
)
def test_what_is_missing_or_ambiguous_is_named_with_a_remedy(
    tmp_path: Path, parts: list[Callable[[LogWriter], None]], topics: dict[str, str], message: str
) -> None:
    path = write_log(tmp_path / "a.mcap", *parts)
    with pytest.raises(DetectError, match=message):
        open_recording(path, Topics(**topics)).refuse_times_apart()


def _empty_channels(tmp_path: Path, *, image: bool, joints: bool) -> Path:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for name, topic, wanted in (("Image", CAMERA, image), ("JointState", JOINTS, joints)):
            if wanted:
                schema = writer.register_schema(f"sensor_msgs/msg/{name}", "ros2msg", b"")
                writer.register_channel(topic, "cdr", schema)
        writer.finish()
    return path


def test_topics_without_messages_are_named(tmp_path: Path) -> None:
    with pytest.raises(DetectError, match=r"a.mcap: no messages on camera topic /camera/image_raw; record again"):
        open_recording(_empty_channels(tmp_path, image=True, joints=True))
    path = write_log(tmp_path / "b.mcap", _joints_named(), write_frames)
    with pytest.raises(DetectError, match=r"b.mcap: no messages with joints on /joint_states; record again"):
        open_recording(path)


def test_an_image_that_does_not_decode_is_passed_over_and_counted(tmp_path: Path) -> None:
    def broken(log: LogWriter) -> None:
        whole = jpeg(blank(64, 64))
        for k, content in enumerate((whole, whole[:200], b"", b"garbage", whole)):
            log.compressed_image(CAMERA, T0_NS + k * 10**8, T0_NS + k * 10**8, content)

    recording = open_recording(write_log(tmp_path / "a.mcap", write_joints, broken))
    assert [t for t, _ in recording.read_frames(range(5))] == [T0_NS, T0_NS + 4 * 10**8]
    assert recording.frames_missing()[0] == 3


def test_a_log_that_changes_while_it_is_read_is_refused(tmp_path: Path) -> None:
    path = write_small(tmp_path / "a.mcap", chunk_bytes=1 << 22)
    recording = open_recording(path)
    recording.source.cache.places.clear()
    shutil.copy(write_log(tmp_path / "b.mcap", _frames_later, write_joints), path)
    with pytest.raises(DetectError, match=re.escape("a.mcap: ")):
        list(recording.read_frames(range(4)))


def test_messages_without_stamps_take_the_times_of_their_recording(tmp_path: Path) -> None:
    t_ns, phi_R, phi_L, _ = drive()

    def unstamped(log: LogWriter) -> None:
        for t, right, left in zip(t_ns.tolist(), phi_R, phi_L, strict=True):
            log.joint_state(JOINTS, 0, t, [LEFT, RIGHT], [left, right])

    recording = open_recording(write_log(tmp_path / "a.mcap", unstamped, write_frames))
    np.testing.assert_array_equal(recording.wheels.t_ns, t_ns)
    assert any("carry no stamps" in note for note in recording.notes)
