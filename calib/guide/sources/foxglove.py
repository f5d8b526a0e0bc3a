"""A client of the Foxglove WebSocket protocol, as far as listening needs it.

The protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md. ``foxglove.sdk.v1`` is what newer servers
call the same messages. Sizes are bounded; what is out of order ends the connection with a sentence.
"""

import asyncio
import base64
import binascii
import contextlib
import json
import struct
from typing import TYPE_CHECKING, Any

from boxcal.calib.guide.sources.link import Link
from boxcal.calib.guide.sources.protocol import spoken
from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import MAX_SCHEMA_BYTES, Channel, checked_name, ros_type

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
MOST_CHANNELS = 20_000
_MESSAGE_DATA = 1
_CHOOSE_EVERY_S = 0.2
_NOT_SPOKEN = "a message that is not of the Foxglove protocol"
_MESSAGE_HEAD = struct.Struct("<BIQ")
_SCHEMA_OF = {"cdr": "ros2msg", "ros1": "ros1msg", "protobuf": "protobuf", "json": "jsonschema"}


class FoxgloveListener:
    """Listens to the topics of one connection that a calibration needs."""

    def __init__(self, socket: "ClientConnection", link: Link) -> None:
        self._socket, self._link = socket, link
        self._offered: dict[int, Channel] = {}
        self._subscribed: dict[int, Channel] = {}
        self._ids: dict[int, int] = {}
        self._next_id = 1

    async def run(self, first: str | bytes | None = None) -> None:
        """Listen until the connection ends.

        Parameters
        ----------
        first
            A message that was read already.

        Raises
        ------
        DetectError
            If the server does not speak the protocol.
        """
        choosing = asyncio.create_task(self._choose_again())
        try:
            if first is not None:
                await self._take(first)
            async for message in self._socket:
                await self._take(message)
        finally:
            choosing.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await choosing

    async def _choose_again(self) -> None:
        """Choose anew whenever the user has named another camera."""
        known = self._link.choices
        while True:
            await asyncio.sleep(_CHOOSE_EVERY_S)
            if self._link.choices != known:
                known = self._link.choices
                await self._choose()

    async def _take(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            self._data(message)
            return
        with spoken(self._link, _NOT_SPOKEN, "start foxglove_bridge on the robot, version 0.7 or newer"):
            content = json.loads(message)
            kind = content["op"]
            if kind == "serverInfo":
                self._link.found()
            elif kind == "advertise":
                await self._advertised(content["channels"])
            elif kind == "unadvertise":
                await self._unadvertised(content["channelIds"])

    def _data(self, message: bytes) -> None:
        """Hand on a message of a topic; other binary messages (times, answers) are passed over."""
        if len(message) < _MESSAGE_HEAD.size or message[0] != _MESSAGE_DATA:
            return
        _, number, log_ns = _MESSAGE_HEAD.unpack_from(message)
        channel = self._subscribed.get(number)
        if channel is not None:
            self._link.hand_on(channel, log_ns, message[_MESSAGE_HEAD.size :])

    async def _advertised(self, channels: list[dict[str, Any]]) -> None:
        for described in channels:
            number = int(described["id"])
            if number not in self._offered and len(self._offered) >= MOST_CHANNELS:
                raise DetectError(f"more than {MOST_CHANNELS} topics", source=self._link.name)
            self._offered[number] = self._link.known(_channel(described))
        await self._choose()

    async def _unadvertised(self, numbers: list[int]) -> None:
        for number in numbers:
            self._offered.pop(int(number), None)
            subscription = self._ids.pop(int(number), None)
            if subscription is not None:
                del self._subscribed[subscription]
        await self._choose()

    async def _choose(self) -> None:
        """Subscribe to what is needed now, and leave what is not."""
        wanted = set(self._link.offer(list(self._offered.values())).topics)
        new = [n for n, channel in self._offered.items() if channel.topic in wanted and n not in self._ids]
        left = [n for n in self._ids if self._offered[n].topic not in wanted]
        if left:
            subscriptions = [self._ids.pop(n) for n in left]
            for subscription in subscriptions:
                del self._subscribed[subscription]
            await self._send("unsubscribe", subscriptionIds=subscriptions)
        if new:
            for n in new:
                self._ids[n], self._subscribed[self._next_id] = self._next_id, self._offered[n]
                self._next_id += 1
            await self._send("subscribe", subscriptions=[{"id": self._ids[n], "channelId": n} for n in new])

    async def _send(self, kind: str, **content: Any) -> None:
        await self._socket.send(json.dumps({"op": kind, **content}))


def _channel(described: dict[str, Any]) -> Channel:
    """Return a channel from its description; schemas of protobuf come in base64."""
    encoding = str(described["encoding"])[:32]
    kind = checked_name(str(described["schemaName"]), "type")
    schema = str(described.get("schema") or "")
    if len(schema) > MAX_SCHEMA_BYTES:
        raise ValueError(f"a schema of {len(schema)} characters")
    content = schema.encode()
    if encoding == "protobuf":
        try:
            content = base64.b64decode(schema, validate=True)
        except binascii.Error as error:
            raise ValueError(f"a schema that is not base64: {error}") from error
    return Channel(
        topic=checked_name(str(described["topic"]), "topic"),
        type=ros_type(kind) if encoding in {"cdr", "ros1"} else kind,
        encoding=encoding,
        schema=content,
        schema_encoding=str(described.get("schemaEncoding") or _SCHEMA_OF.get(encoding, ""))[:32],
    )
