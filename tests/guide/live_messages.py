"""Messages of a small robot as a bridge sends them, and servers that send them or misbehave."""

import asyncio
import json
import struct
import threading
import time
from collections.abc import Awaitable, Callable
from typing import Any, Self

import numpy as np
from rosbags.typesys import Stores, get_typestore
from websockets.asyncio.server import ServerConnection, serve

from boxcal.calib.guide.sources.inbox import Inbox, LiveMessage
from boxcal.calib.guide.sources.link import Link
from boxcal.calib.guide.sources.server import follow_server
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.topics import Topics

STORE = get_typestore(Stores.ROS2_HUMBLE)
JOINTS, PICTURE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CompressedImage"
WHEELS = Channel(topic="/joint_states", type=JOINTS, encoding="cdr", schema_encoding="ros2msg")
CAMERA = Channel(topic="/camera/image_raw/compressed", type=PICTURE, encoding="cdr", schema_encoding="ros2msg")
T0 = 1_700_000_000_000_000_000


def _header(t_ns: int) -> Any:
    sec, nanosec = divmod(t_ns, 1_000_000_000)
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")


def wheels(t_ns: int, right: float, left: float) -> bytes:
    none = np.zeros(0)
    message = STORE.types[JOINTS](
        header=_header(t_ns),
        name=["right_wheel_joint", "left_wheel_joint"],
        position=np.array([right, left]),
        velocity=none,
        effort=none,
    )
    return bytes(STORE.serialize_cdr(message, JOINTS))


def picture(t_ns: int, jpeg: bytes) -> bytes:
    message = STORE.types[PICTURE](header=_header(t_ns), format="jpeg", data=np.frombuffer(jpeg, dtype=np.uint8))
    return bytes(STORE.serialize_cdr(message, PICTURE))


def heard(channel: Channel, t_ns: int, data: bytes) -> LiveMessage:
    return LiveMessage(channel, t_ns, data, channel is CAMERA)


def advertised(*channels: Channel) -> str:
    described = [
        {
            "id": k,
            "topic": c.topic,
            "encoding": c.encoding,
            "schemaName": c.type,
            "schema": "",
            "schemaEncoding": "ros2msg",
        }
        for k, c in enumerate(channels, 1)
    ]
    return json.dumps({"op": "advertise", "channels": described})


INFO = json.dumps({"op": "serverInfo", "name": "test", "capabilities": []})


def data_message(subscription: int, t_ns: int, data: bytes) -> bytes:
    return struct.pack("<BIQ", 1, subscription, t_ns) + data


class Followed:
    """A link that follows a server in a thread, and what came of it."""

    def __init__(self, url: str, topics: Topics | None = None) -> None:
        self.link = Link(address=url, topics=topics or Topics(), inbox=Inbox())
        self._thread = threading.Thread(target=lambda: asyncio.run(follow_server(self.link)), daemon=True)

    def __enter__(self) -> Link:
        self._thread.start()
        return self.link

    def __exit__(self, *_: object) -> None:
        self.link.stopped.set()
        self._thread.join(10)
        assert not self._thread.is_alive()


class Server:
    """A WebSocket server in a thread; ``talk`` is called with each connection."""

    def __init__(
        self,
        talk: Callable[[ServerConnection], Awaitable[None]],
        subprotocols: list[str] | None = None,
        port: int = 0,
    ) -> None:
        self._talk, self._subprotocols, self._port = talk, subprotocols, port
        self._ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(10)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10)

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        self._stop = asyncio.Event()
        subprotocols: Any = self._subprotocols
        async with serve(
            self._talk, "127.0.0.1", self._port, subprotocols=subprotocols, max_size=None, close_timeout=0.2
        ) as server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            self._ready.set()
            await self._stop.wait()


def until(true: Callable[[], object], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "did not happen"
        time.sleep(0.02)
