"""The first pass over a log: all wheel readings, and where the images stand."""

from array import array
from dataclasses import dataclass, field

import numpy as np
from mcap.records import Channel, Schema

from boxcal.detect.errors import DetectError
from boxcal.detect.log.mcap_records import Message, Record
from boxcal.detect.log.messages import COMPRESSED_IMAGE, JOINTS, RAW_IMAGE, decode_joints, header_stamp_ns
from boxcal.detect.log.safe_text import listed, printable
from boxcal.detect.log.topics import Topics, wheel_side

MAX_SAMPLES = 20_000_000
"""Most joint readings and images together that are taken from one log."""
MAX_NAMES = 20_000
"""Most different joints in one log."""
_KINDS = {JOINTS, RAW_IMAGE, COMPRESSED_IMAGE}


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """What one joint, or one topic's images, gave: stamps (ns) with positions (rad), or with places in the file."""

    t_ns: "array[int]" = field(default_factory=lambda: array("q"))
    value: "array[float]" = field(default_factory=lambda: array("d"))
    record: "array[int]" = field(default_factory=lambda: array("q"))
    inner: "array[int]" = field(default_factory=lambda: array("q"))


@dataclass(slots=True, kw_only=True)
class Scan:
    """Takes a log's records one by one.

    Attributes
    ----------
    name
        Of the file, for messages.
    topics
        What the user named: such joints are kept whatever their names mean.
    schemas, channels
        By id, as the log describes them.
    kinds
        Message type by id, of the channels that are read.
    images
        By topic and type.
    joints
        By topic and joint; a joint without readings that can be a wheel is there too, empty.
    """

    name: str
    topics: Topics
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    kinds: dict[int, str] = field(default_factory=dict)
    images: dict[tuple[str, str], Series] = field(default_factory=dict)
    joints: dict[str, dict[str, Series]] = field(default_factory=dict)
    _taken: int = 0
    _names: int = 0

    def take(self, record: Record) -> None:
        """Take one record (DetectError if it does not decode, or there are unreasonably many)."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self._channel(record)
        elif record.channel not in self.channels:
            raise DetectError(
                f"{self.name}: a message of channel {record.channel}, which the file does not describe; recover what "
                "is there with `mcap recover`, or record again"
            )
        elif record.channel in self.kinds:
            self._message(record, self.channels[record.channel].topic, self.kinds[record.channel])

    def types(self) -> dict[str, str]:
        """Return every topic's type."""
        return {c.topic: self._type(c) or "no schema" for c in self.channels.values()}

    def image_counts(self) -> dict[str, int]:
        """Return every image topic's number of messages."""
        counts: dict[str, int] = {}
        for (topic, _), series in self.images.items():
            counts[topic] = counts.get(topic, 0) + len(series.t_ns)
        return counts

    def images_of(self, topic: str) -> tuple[str, Series]:
        """Return type and images of a topic; of two types in one topic, the one with more."""
        found = [(len(series.t_ns), kind) for (t, kind), series in self.images.items() if t == topic]
        kind = max(found)[1]
        return kind, self.images[topic, kind]

    def refuse_other_worlds(self) -> None:
        """Refuse a log that ROS 2 did not write (DetectError with what its messages are)."""
        if any(c.message_encoding == "cdr" for c in self.channels.values()):
            return
        if not self.channels:
            raise DetectError(f"{self.name}: no topics, a camera and joint states are needed; record again")
        found = listed(
            f"{c.message_encoding or 'no encoding'} of {self._type(c) or 'no schema'}" for c in self.channels.values()
        )
        raise DetectError(
            f"{self.name}: not a ROS 2 log: its messages are {found}, CDR is needed; record with ROS 2, or convert a "
            "ROS 1 log with `rosbags-convert`"
        )

    def _type(self, channel: Channel) -> str:
        """Return a channel's type as ROS 2 writes it (``package/msg/Type``); empty without a schema."""
        schema = self.schemas.get(channel.schema_id)
        return "" if schema is None else str(schema.name)

    def _channel(self, channel: Channel) -> None:
        self.channels[channel.id] = channel
        self.kinds.pop(channel.id, None)
        kind = self._type(channel)
        if channel.message_encoding != "cdr" or kind not in _KINDS:
            return
        self.kinds[channel.id] = kind
        if kind == JOINTS:
            self.joints.setdefault(channel.topic, {})
        else:
            self.images.setdefault((channel.topic, kind), Series())

    def _message(self, message: Message, topic: str, kind: str) -> None:
        try:
            if kind == JOINTS:
                self._joint(message, self.joints[topic])
            else:
                series = self.images[topic, kind]
                series.t_ns.append(header_stamp_ns(message.data))
                series.record.append(message.place.record)
                series.inner.append(message.place.inner)
                self._taken += 1
        except DetectError as error:
            where = f"{self.name}: {printable(topic)} at log time {message.log_ns / 1e9:.3f} s"
            raise DetectError(f"{where}: {error}") from error
        if self._taken > MAX_SAMPLES:
            raise DetectError(f"{self.name}: more than {MAX_SAMPLES} joint readings and images; split the log")

    def _joint(self, message: Message, joints: dict[str, Series]) -> None:
        state = decode_joints(message.data)
        for k, joint in enumerate(state.names):
            series = joints.get(joint)
            if series is None:
                self._names += 1
                if self._names > MAX_NAMES:
                    raise DetectError(f"more than {MAX_NAMES} different joints; the log is damaged")
                series = joints[joint] = Series()
            if state.positions.size and np.isfinite(state.positions[k]) and self._wanted(joint):
                series.t_ns.append(state.t_ns)
                series.value.append(float(state.positions[k]))
                self._taken += 1

    def _wanted(self, joint: str) -> bool:
        return joint in {self.topics.left_joint, self.topics.right_joint} or wheel_side(joint) is not None
