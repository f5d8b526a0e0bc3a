"""Messages come in from Foxglove bridges, rosbridge and growing files; what is wrong with a server is said."""

import asyncio
import base64
import json
import threading
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_messages import (
    CAMERA,
    INFO,
    T0,
    WHEELS,
    Followed,
    Server,
    advertised,
    data_message,
    heard,
    picture,
    until,
    wheels,
)
from websockets.asyncio.server import ServerConnection

from boxcal.calib.guide.drive.wheels_so_far import WheelsSoFar
from boxcal.calib.guide.recording.chunked_file import ChunkedFile
from boxcal.calib.guide.sources import video
from boxcal.calib.guide.sources.descriptions import Descriptions
from boxcal.calib.guide.sources.file import follow_file
from boxcal.calib.guide.sources.inbox import MOST_OTHER_BYTES, MOST_PICTURE_BYTES, Inbox, LiveMessage
from boxcal.calib.guide.sources.link import Link, without_credentials
from boxcal.calib.guide.sources.selection import select
from boxcal.calib.guide.sources.video import VideoFeed
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.images import VideoPacket, decode_frame, frame_id_of, image_stamp_ns
from boxcal.detect.log.scan import Scan
from boxcal.detect.log.topic_use import Use, use_of
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import WheelUnits

FOXGLOVE = ["foxglove.websocket.v1"]


def _kinds(messages: list[LiveMessage]) -> set[str]:
    return {m.channel.topic for m in messages}


def _robot(count: int = 3, then: str = "") -> object:
    async def talk(socket: ServerConnection) -> None:
        await socket.send(INFO)
        await socket.send(
            advertised(WHEELS, CAMERA, Channel(topic="/chatter", type="std_msgs/msg/Int8", encoding="cdr"))
        )
        asked = json.loads(await socket.recv())
        assert asked["op"] == "subscribe"
        ids = {s["channelId"]: s["id"] for s in asked["subscriptions"]}
        assert set(ids) == {1, 2}, "only what a calibration needs is subscribed to"
        for k in range(count):
            await socket.send(data_message(ids[1], T0 + k, wheels(T0 + k, 0.1 * k, 0.1 * k)))
            await socket.send(data_message(ids[2], T0 + k, picture(T0 + k, b"jpeg")))
        if then:
            await socket.send(then)
        if then != "leave":
            await socket.wait_closed()

    return talk


@pytest.mark.parametrize("protocol", ["foxglove.websocket.v1", "foxglove.sdk.v1"])
def test_topics_of_a_foxglove_bridge_are_subscribed_to_and_heard(protocol: str) -> None:
    with Server(_robot(), [protocol]) as server, Followed(server.url) as link:  # type: ignore[arg-type]
        came: list[LiveMessage] = []
        until(lambda: came.extend(link.inbox.take(0.05)) or len(came) >= 4)
        assert _kinds(came) == {WHEELS.topic, CAMERA.topic}
        assert link.connected
        assert not link.said
        assert {m.picture for m in came if m.channel.topic == CAMERA.topic} == {True}


def test_a_lost_connection_is_made_again_and_goes_on() -> None:
    with Server(_robot(then="leave"), FOXGLOVE) as server, Followed(server.url) as link:  # type: ignore[arg-type]
        until(lambda: link.losses >= 2)
        assert len(link.inbox.take(1)) > 0


def test_no_bridge_is_said_and_waited_for() -> None:
    with Server(_robot(), FOXGLOVE) as server:  # type: ignore[arg-type]
        port = server.port
    with Followed(f"ws://127.0.0.1:{port}") as link:
        until(lambda: "no bridge there" in link.said)
        with Server(_robot(), FOXGLOVE, port):  # type: ignore[arg-type]
            until(lambda: link.connected)


@pytest.mark.parametrize(
    ("name", "said"),
    [("ws://", "not an address"), ("http://127.0.0.1:1", "not an address"), ("ws://[", "not an address")],
)
def test_what_is_no_address_is_said(name: str, said: str) -> None:
    with Followed(name) as link:
        until(lambda: said in link.said)


def test_credentials_in_an_address_are_neither_shown_nor_written() -> None:
    for address, shown in (
        ("ws://ann:s3cret@robot:8765/x?token=s3cret#s3cret", "ws://robot:8765/x"),
        ("wss://s3cret@robot", "wss://robot"),
        ("ws://robot:8765", "ws://robot:8765"),
        ("a?b@c.mcap", "a?b@c.mcap"),
        ("--robot", "--robot"),
    ):
        assert without_credentials(address) == shown
    with Followed("http://ann:s3cret@127.0.0.1:1") as link:
        until(lambda: link.said)
        assert "s3cret" not in link.name + link.said


async def _nothing(socket: ServerConnection) -> None:
    await socket.wait_closed()


def test_another_protocol_version_is_said() -> None:
    def refuse(connection: ServerConnection, offered: object) -> None:
        raise AssertionError(offered)

    with Server(_nothing, ["foxglove.websocket.v9"]) as server, Followed(server.url) as link:
        until(
            lambda: (
                "refuses the Foxglove protocol" in link.said or "neither a Foxglove bridge" in link.said or link.said
            )
        )
        assert not link.connected


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ("no json", "not of the Foxglove protocol"),
        ("[1, 2]", "not of the Foxglove protocol"),
        ('{"op": "advertise", "channels": [{"id": "x"}]}', "not of the Foxglove protocol"),
        ('{"op": "advertise", "channels": 3}', "not of the Foxglove protocol"),
        ('{"op": "unadvertise", "channelIds": null}', "not of the Foxglove protocol"),
        ("[" * 100_000, "not of the Foxglove protocol"),
        (
            json.dumps(
                {
                    "op": "advertise",
                    "channels": [{"id": 1, "topic": "t" * 5000, "encoding": "cdr", "schemaName": "a", "schema": ""}],
                }
            ),
            "name of 5000 characters",
        ),
        (
            json.dumps(
                {
                    "op": "advertise",
                    "channels": [
                        {"id": k, "topic": f"/{k}", "encoding": "cdr", "schemaName": "a", "schema": ""}
                        for k in range(20_001)
                    ],
                }
            ),
            "more than 20000 topics",
        ),
    ],
    ids=["text", "list", "no topic", "no list", "null", "deep", "long name", "many topics"],
)
def test_a_server_that_speaks_nonsense_is_left_with_a_sentence(message: str, said: str) -> None:
    async def talk(socket: ServerConnection) -> None:
        await socket.send(INFO)
        await socket.send(message)
        await socket.wait_closed()

    with Server(talk, FOXGLOVE) as server, Followed(server.url) as link:
        until(lambda: said in link.said)


def test_a_message_too_large_is_refused() -> None:
    async def talk(socket: ServerConnection) -> None:
        await socket.send(INFO)
        await socket.send(bytes(130 << 20))
        await socket.wait_closed()

    with Server(talk, FOXGLOVE) as server, Followed(server.url) as link:
        until(lambda: "more than 128 MB" in link.said)


def test_binary_messages_cut_short_or_of_no_subscription_are_passed_over() -> None:
    async def talk(socket: ServerConnection) -> None:
        await socket.send(INFO)
        await socket.send(advertised(WHEELS, CAMERA))
        ids = [s["id"] for s in json.loads(await socket.recv())["subscriptions"]]
        for odd in (b"", b"\x01", b"\x02" + bytes(8), data_message(99, 0, b"x"), data_message(ids[0], 0, b"")):
            await socket.send(odd)
        await socket.send(data_message(ids[0], T0, wheels(T0, 0, 0)))
        await socket.wait_closed()

    with Server(talk, FOXGLOVE) as server, Followed(server.url) as link:
        came: list[LiveMessage] = []
        until(lambda: came.extend(link.inbox.take(0.05)) or any(m.log_ns == T0 for m in came))
        assert link.connected


def test_topics_that_vanish_are_said() -> None:
    gone = json.dumps({"op": "unadvertise", "channelIds": [2]})
    with Server(_robot(then=gone), FOXGLOVE) as server, Followed(server.url) as link:  # type: ignore[arg-type]
        until(lambda: "no camera topic" in link.said)
        assert link.connected


def test_rosbridge_is_heard_as_json() -> None:
    async def talk(socket: ServerConnection) -> None:
        async for message in socket:
            asked = json.loads(message)
            if asked["op"] == "call_service":
                values = {
                    "topics": ["/joint_states", "/cam/compressed", "/other"],
                    "types": ["sensor_msgs/msg/JointState", "sensor_msgs/msg/CompressedImage", "std_msgs/msg/Bool"],
                }
                await socket.send(
                    json.dumps({"op": "service_response", "id": asked["id"], "values": values, "result": True})
                )
            elif asked["op"] == "subscribe" and asked["topic"] == "/joint_states":
                msg = {
                    "header": {"stamp": {"sec": 5, "nanosec": 7}, "frame_id": ""},
                    "name": ["left_wheel_joint", "right_wheel_joint"],
                    "position": [1.0, 2.0],
                    "velocity": [],
                    "effort": [],
                }
                await socket.send(json.dumps({"op": "publish", "topic": "/joint_states", "msg": msg}))

    with Server(talk) as server, Followed(server.url) as link:
        came: list[LiveMessage] = []
        until(lambda: came.extend(link.inbox.take(0.05)) or came)
        assert set(link.selection.topics) == {"/cam/compressed", "/joint_states"}
        wheels_so_far = WheelsSoFar("x", Topics(), WheelUnits(), None)
        wheels_so_far.take(came)
        signals = wheels_so_far.scan.readings.signals["/joint_states"]
        assert {name: s.values.tolist() for name, s in signals.items() if s.count} == {
            "left_wheel_joint": [1.0],
            "right_wheel_joint": [2.0],
        }


def test_a_recording_is_followed_while_it_grows(tmp_path: Path) -> None:
    path = tmp_path / "growing.mcap"
    link = Link(address=str(path), topics=Topics(), inbox=Inbox())
    thread = threading.Thread(target=lambda: asyncio.run(follow_file(link, path)), daemon=True)
    thread.start()
    until(lambda: "waited for" in link.said)
    file = ChunkedFile(path)
    came: list[LiveMessage] = []
    for k in range(3):
        file.add(WHEELS, T0 + k, wheels(T0 + k, k, k))
        file.add(CAMERA, T0 + k * 10**9, picture(T0 + k * 10**9, b"x"))
        file.flush()
        until(lambda: came.extend(link.inbox.take(0.05)) or len(came) == 2 * k + 2)  # noqa: B023
    file.close()
    until(lambda: link.said == "the recording is finished")
    assert [m.log_ns for m in came if not m.picture] == [T0, T0 + 1, T0 + 2]
    link.choose_camera(CAMERA.topic)
    again: list[LiveMessage] = []
    until(lambda: again.extend(link.inbox.take(0.05)) or len(again) == 6)
    link.stopped.set()
    thread.join(10)
    assert not thread.is_alive()


def test_what_is_followed_is_what_a_reader_of_the_recording_would_read() -> None:
    kinds = [
        ("sensor_msgs/msg/JointState", "/joint_states"),
        ("nav_msgs/msg/Odometry", "/odom"),
        ("irobot_create_msgs/msg/WheelTicks", "/wheel_ticks"),
        ("sensor_msgs/msg/Image", "/image"),
        ("sensor_msgs/msg/CompressedImage", "/image/compressed"),
        ("tf2_msgs/msg/TFMessage", "/tf_static"),
        ("sensor_msgs/msg/CameraInfo", "/camera_info"),
        ("sensor_msgs/msg/LaserScan", "/scan"),
        ("std_msgs/msg/Int8", "/chatter"),
    ]
    for kind, topic in kinds:
        channel = Channel(topic=topic, type=kind, encoding="cdr")
        scan = Scan(name="x", topics=Topics())
        read = scan._handler(channel) is not None
        assert (use_of(channel, Topics()) is not Use.NONE) == read, kind


def test_of_raw_and_compressed_pictures_the_compressed_are_taken_unless_named() -> None:
    raw = Channel(topic="/cam", type="sensor_msgs/msg/Image", encoding="cdr")
    small = Channel(topic="/cam/compressed", type="sensor_msgs/msg/CompressedImage", encoding="cdr")
    assert select([raw, small, WHEELS], Topics()).camera == "/cam/compressed"
    assert select([raw, small, WHEELS], Topics(camera_topic="/cam")).camera == "/cam"
    other = Channel(topic="/other", type="sensor_msgs/msg/Image", encoding="cdr")
    two = select([raw, other, WHEELS], Topics())
    assert not two.camera
    assert "--camera-topic" in two.problem
    assert two.problem.endswith("; or choose one on the page")
    assert two.cameras == ("/cam", "/other")


def test_a_camera_that_is_named_on_the_page_is_listened_to() -> None:
    other = Channel(topic="/rear/compressed", type=CAMERA.type, encoding="cdr")
    asked: list[dict[str, Any]] = []

    async def talk(socket: ServerConnection) -> None:
        await socket.send(INFO)
        await socket.send(advertised(WHEELS, CAMERA, other))
        async for message in socket:
            asked.append(json.loads(message))  # noqa: PERF401  (looked at meanwhile)

    with Server(talk, FOXGLOVE) as server, Followed(server.url) as link:
        until(lambda: len(link.selection.cameras) == 2 and not link.selection.camera)
        until(lambda: len(asked) == 1)
        link.choose_camera(other.topic)
        until(lambda: len(asked) == 2)
        assert link.selection.camera == other.topic
        assert [s["channelId"] for s in asked[1]["subscriptions"]] == [3]
        link.choose_camera(CAMERA.topic)
        until(lambda: len(asked) == 4)
        assert [a["op"] for a in asked[2:]] == ["unsubscribe", "subscribe"]


def test_what_a_server_says_once_of_the_robot_is_known_to_the_next_drive_too() -> None:
    described = Channel(topic="/robot_description", type="std_msgs/msg/String", encoding="cdr")
    held = Descriptions()
    held.keep([heard(WHEELS, 1, b"wheels"), heard(described, 2, b"urdf"), heard(CAMERA, 3, b"jpeg")], Topics())
    assert [(m.log_ns, m.data) for m in held.again(9)] == [(9, b"urdf")]
    held.keep([heard(described, 4, bytes(9 << 20))], Topics())
    assert len(held.again(9)) == 1, "nor is memory filled with them"


def test_pictures_that_come_too_fast_are_dropped_and_memory_stays_flat() -> None:
    inbox = Inbox()
    frame = bytes(8 << 20)
    for k in range(900):  # 30 s of 30 Hz, 8 MB each, and nobody takes them
        inbox.put(heard(CAMERA, k, frame), now=k / 30)
        inbox.put(heard(WHEELS, k, b"wheels"), now=k / 30)
    held = inbox.take(0)
    assert sum(len(m.data) for m in held if m.picture) <= MOST_PICTURE_BYTES
    assert sum(m.picture for m in held) + inbox.dropped_pictures == 900
    assert held[-2].log_ns == 899 or max(m.log_ns for m in held if m.picture) > 890
    assert [m.log_ns for m in held if not m.picture] == list(range(900)), "no wheel reading is lost for pictures"


def test_empty_messages_fill_the_memory_no_more_than_others() -> None:
    inbox = Inbox()
    for k in range(300_000):
        inbox.put(heard(WHEELS, k, b""), now=0)
    assert inbox.dropped_others > 0
    assert inbox.waiting * 256 <= MOST_OTHER_BYTES


def test_times_beyond_all_measure_are_clipped_to_what_a_log_holds() -> None:
    inbox = Inbox()
    inbox.put(heard(WHEELS, (1 << 64) - 1, b""), now=0)
    inbox.put(heard(WHEELS, -5, b""), now=0)
    assert [m.log_ns for m in inbox.take(0)] == [(1 << 63) - 1, 0]


def _video_message(t_ns: int, packet: bytes) -> bytes:
    stamp = {"sec": t_ns // 10**9, "nsec": t_ns % 10**9}
    told = {"timestamp": stamp, "frame_id": "lens", "format": "h264", "data": base64.b64encode(packet).decode()}
    return json.dumps(told).encode()


def test_a_cameras_video_is_decoded_and_kept_as_pictures() -> None:
    av = pytest.importorskip("av")
    try:
        encoder = av.CodecContext.create("libx264", "w")
    except (av.error.FFmpegError, ValueError):
        pytest.skip("PyAV has no encoder libx264")
    encoder.width, encoder.height, encoder.pix_fmt = 128, 96, "yuv420p"
    encoder.time_base, encoder.framerate = Fraction(1, 30), 30
    encoder.options = {"tune": "zerolatency", "g": "20", "bf": "0", "preset": "ultrafast", "crf": "10"}
    channel = Channel(topic="/cam/video", type="foxglove.CompressedVideo", encoding="json")
    link = Link(address="ws://robot", topics=Topics(), inbox=Inbox(1000.0))
    link.found()
    assert link.offer([WHEELS, channel]).is_video
    for k in range(40):
        shown = np.full((96, 128), 40 + 2 * k, dtype=np.uint8)
        frame = av.VideoFrame.from_ndarray(shown, format="gray").reformat(format="yuv420p")
        frame.pts = k
        for packet in encoder.encode(frame):
            t = T0 + k * 50_000_000
            link.hand_on(channel, t, _video_message(t, bytes(packet)), now=t / 1e9)
    came: list[LiveMessage] = []
    until(lambda: came.extend(link.inbox.take(0.05)) or len(came) == 20 or link.said)
    link.stopped.set()
    assert not link.said
    for n, message in enumerate(came):
        assert message.picture
        image = decode_frame(message.channel, message.data)
        assert not isinstance(image, VideoPacket)
        assert float(np.mean(image)) == pytest.approx(40 + 4 * n, abs=3)
        kind = message.channel.type
        assert image_stamp_ns(message.channel, kind, memoryview(message.data), 0) == T0 + n * 100_000_000
        assert frame_id_of(message.channel, message.data) == "lens"


def test_a_video_that_raises_or_floods_ends_nothing_and_has_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    decoded: list[bytes] = []

    def decode(_: VideoFeed, packet: Any) -> None:
        decoded.append(packet.data)
        if len(decoded) == 1:
            raise RuntimeError("odd packet")

    monkeypatch.setattr(VideoFeed, "_decode", decode)
    channels = [Channel(topic=t, type="foxglove.CompressedVideo", encoding="json") for t in ("/a", "/b")]
    link = Link(address="ws://robot", topics=Topics(), inbox=Inbox(1000.0))
    link.found()
    for k in range(6):
        link.choose_camera(channels[k % 2].topic)
        link.offer([WHEELS, *channels])
        for _ in range(2):
            link.hand_on(channels[k % 2], T0, _video_message(T0, b"\0\0\1\x65"))
        if not told:
            until(lambda: len(decoded) == 2, 20)
            told.append(link.said)
    assert "a packet cannot be decoded (RuntimeError: odd packet)" in told[0]
    until(lambda: sum(thread.name == "video" for thread in threading.enumerate()) == 1)
    link.stopped.set()
    monkeypatch.setattr(VideoFeed, "_run", lambda _: None)
    feed = VideoFeed(lambda *_: None, lambda _: None, threading.Event())
    monkeypatch.setattr(video, "MOST_BYTES", 1000)
    for _ in range(1000):
        feed.put(channels[0], 0, b"", 0.0)
    assert len(feed._waiting) <= 4


def test_packets_of_a_video_that_wait_without_end_are_left_out_up_to_the_next_whole_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(VideoFeed, "_run", lambda _: None)
    feed = VideoFeed(lambda *_: None, lambda _: None, threading.Event())
    channel = Channel(topic="/cam/video", type="foxglove.CompressedVideo", encoding="json")
    key, other = (_video_message(T0, start + bytes(5 << 20)) for start in (b"\0\0\1\x65", b"\0\0\1\x41"))
    for packet in (key, other, other, other, other, _video_message(T0, b"\0\0\1\x41")):
        feed.put(channel, 0, packet, 0.0)
    assert (len(feed._waiting), feed.left_out) == (4, 2)
    assert feed.is_full
    feed._waiting.clear()
    feed._bytes = 0
    for packet in (other, key, other):
        feed.put(channel, 0, packet, 0.0)
    assert (len(feed._waiting), feed.left_out) == (2, 3)
