"""A client of rosbridge, as far as listening needs it: JSON over a WebSocket.

The protocol: https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md. Messages stay the JSON
that they are; the topics come from rosapi, which is asked again and again.
"""

import asyncio
import contextlib
import json
import time
from typing import TYPE_CHECKING, Any

from boxcal.calib.guide.sources.inbox import PICTURES_A_SECOND
from boxcal.calib.guide.sources.link import Link
from boxcal.calib.guide.sources.protocol import spoken
from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Channel, checked_name, ros_type

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

_ASK_EVERY_S, _CHOOSE_EVERY_S = 3.0, 0.2
_NEITHER = "neither a Foxglove bridge nor rosbridge"
_MOST_TOPICS = 20_000


class RosbridgeListener:
    """Listens to the topics of one connection that a calibration needs."""

    def __init__(self, socket: "ClientConnection", link: Link) -> None:
        self._socket, self._link = socket, link
        self._channels: dict[str, Channel] = {}
        self._subscribed: set[str] = set()

    async def run(self) -> None:
        """Listen until the connection ends (DetectError if the server does not speak the protocol)."""
        asking = asyncio.create_task(self._ask())
        try:
            async for message in self._socket:
                await self._take(message)
        finally:
            asking.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await asking

    async def _ask(self) -> None:
        """Ask for the topics now and then: what was not there may come, what was there may go, and be named anew."""
        while True:
            await self._send("call_service", service="/rosapi/topics", id="topics")
            known, asked = self._link.choices, time.monotonic()
            while time.monotonic() - asked < _ASK_EVERY_S and self._link.choices == known:
                await asyncio.sleep(_CHOOSE_EVERY_S)

    async def _take(self, message: str | bytes) -> None:
        with spoken(self._link, _NEITHER, "start foxglove_bridge or rosbridge_server on the robot"):
            content = json.loads(message)
            kind = content["op"]
            if kind == "publish":
                self._published(content)
            elif kind == "service_response" and content.get("id") == "topics":
                self._link.found()
                if not content.get("result", True):
                    self._link.said = "its rosapi does not answer; start rosapi_node beside rosbridge"
                    return
                await self._offered(content["values"])

    def _published(self, content: dict[str, Any]) -> None:
        channel = self._channels.get(content["topic"])
        if channel is not None and channel.topic in self._subscribed:
            self._link.hand_on(channel, time.time_ns(), json.dumps(content["msg"]).encode())

    async def _offered(self, values: dict[str, list[str]]) -> None:
        pairs = list(zip(values["topics"], values["types"], strict=True))
        if len(pairs) > _MOST_TOPICS:
            raise DetectError(f"{len(pairs)} topics, at most {_MOST_TOPICS} are looked at", source=self._link.name)
        self._channels = {
            topic: self._link.known(
                Channel(
                    topic=checked_name(str(topic), "topic"),
                    type=ros_type(checked_name(str(kind), "type")),
                    encoding="json",
                    schema=b"{}",
                    schema_encoding="jsonschema",
                )
            )
            for topic, kind in pairs
        }
        chosen = self._link.offer(list(self._channels.values()))
        for topic in self._subscribed - set(chosen.topics):
            await self._send("unsubscribe", topic=topic)
        for topic in set(chosen.topics) - self._subscribed:
            rate = (
                {"throttle_rate": round(1000 / PICTURES_A_SECOND), "queue_length": 1} if topic == chosen.camera else {}
            )
            await self._send("subscribe", topic=topic, type=self._channels[topic].type, **rate)
        self._subscribed = set(chosen.topics)

    async def _send(self, kind: str, **content: Any) -> None:
        await self._socket.send(json.dumps({"op": kind, **content}))
