"""The one pass over a recording: all wheel readings, where the images stand, and what it says of the robot."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Batch, Channel, Container, ros_type
from boxcal.detect.log.containers.mcap_indexed import IndexedMcap, Wanted
from boxcal.detect.log.containers.packing import message_unpacked
from boxcal.detect.log.frame_cache import FrameCache
from boxcal.detect.log.images import IMAGE_TYPES, PICTURE_FILE, ImageSeries, image_stamp_ns, raw_encoding
from boxcal.detect.log.joint_states import JointReader
from boxcal.detect.log.metadata import METADATA_TYPES, Metadata
from boxcal.detect.log.ros_messages import decoder_of, joints_of, stamp_of, text_at, value_at
from boxcal.detect.log.safe_text import listed, printable
from boxcal.detect.log.signals import OdometrySignal, Quantity, Signal
from boxcal.detect.log.tick_messages import FOXGLOVE_JOINTS, ODOMETRY, Field, fields_of
from boxcal.detect.log.topics import Topics, named_field
from boxcal.detect.log.wheel_names import drive_side, wheel_side
from boxcal.target.arrays import Array, Ids

JOINTS = "sensor_msgs/msg/JointState"
MAX_SAMPLES = 8_000_000
"""Most wheel readings and images together that are taken from one recording."""
MAX_NAMES = 20_000
"""Most different joints in one recording."""
_FARTHEST = 1e7
"""Odometry that says to be farther than this, m, is damaged."""
_ROS = {"cdr", "ros1"}
_POSE = ("position.x", "position.y", "orientation.x", "orientation.y", "orientation.z", "orientation.w")
_Handler = Callable[[Batch], None]


@dataclass(slots=True, kw_only=True, eq=False)
class Scan:
    """Takes a recording's messages, piece by piece.

    Attributes
    ----------
    name
        Of the recording, for messages.
    topics
        What the user named: such joints are kept whatever their names mean.
    types
        Type of every topic that was seen, with its encoding where that is not CDR.
    images
        By topic and type.
    signals
        By topic and joint or field; a joint without readings that can be a wheel is there too, empty.
    odometry
        By topic.
    metadata
        What the recording says of the robot.
    cache
        Keeps frames that will be wanted again.
    problems
        Messages that did not decode: what and how many, by topic.
    claimed
        Images of each topic as the recording's index has them, where only some of it is read.
    """

    name: str
    topics: Topics
    types: dict[str, str] = field(default_factory=dict)
    encodings: set[str] = field(default_factory=set)
    images: dict[tuple[str, str], ImageSeries] = field(default_factory=dict)
    signals: dict[str, dict[str, Signal]] = field(default_factory=dict)
    odometry: dict[str, OdometrySignal] = field(default_factory=dict)
    metadata: Metadata = field(default_factory=Metadata)
    cache: FrameCache = field(default_factory=FrameCache)
    problems: dict[str, tuple[str, int]] = field(default_factory=dict)
    claimed: dict[str, int] = field(default_factory=dict)
    _handlers: dict[int, tuple[Channel, _Handler | None]] = field(default_factory=dict)
    _taken: int = 0
    _names: int = 0

    def take_all(self, container: Container) -> None:
        """Read a recording from front to end, or what its index says is needed (DetectError if it holds too much)."""
        if isinstance(container, IndexedMcap) and container.has_index:
            self.claimed = container.image_counts(self.wanted)
            pieces = container.wanted_batches(self.wanted)
        else:
            pieces = container.batches()
        for piece in pieces:
            self.take(piece)
        for channel in getattr(container, "channels", []):
            self._handler(channel)

    def take(self, piece: list[Batch]) -> None:
        """Take some messages (DetectError if there are unreasonably many)."""
        late: list[tuple[_Handler, Batch]] = []
        for batch in piece:
            handler = self._handler(batch.channel)
            if handler is None:
                continue
            if handler == self._image:
                late.append((handler, batch))
            else:
                handler(batch)
        for handler, batch in late:  # whether the robot stands must be known before its images are looked at
            handler(batch)

    def wanted(self, channel: Channel) -> Wanted:
        """Return what a channel's messages are for."""
        handler = self._handler(channel)
        return Wanted.NOTHING if handler is None else Wanted.IMAGES if handler == self._image else Wanted.FIRST

    def image_counts(self) -> dict[str, int]:
        """Return every image topic's number of messages, as far as they were read or the recording claims."""
        counts: dict[str, int] = {}
        for (topic, _), series in self.images.items():
            counts[topic] = counts.get(topic, 0) + len(series.t_ns)
        return {topic: max(count, self.claimed.get(topic, 0)) for topic, count in counts.items()}

    def decoded_of(self, topic: str) -> int:
        """Return how many messages of a topic gave something, as far as they were read."""
        images = sum(len(series.t_ns) for (t, _), series in self.images.items() if t == topic)
        readings = max((s.count for s in self.signals.get(topic, {}).values()), default=0)
        return max(images, readings, len(self.odometry[topic].poses) if topic in self.odometry else 0)

    def forget_signals(self, but: Collection[Signal] = ()) -> None:
        """Let go of all readings of wheels but those of some signals: a long drive has a million of each."""
        for of_topic in self.signals.values():
            for signal in of_topic.values():
                if signal not in but:
                    signal.forget()

    def images_of(self, topic: str) -> ImageSeries:
        """Return the images of a topic; of two types in one topic, the one with more."""
        return max((s for (t, _), s in self.images.items() if t == topic), key=lambda s: len(s.t_ns))

    def refuse_other_worlds(self) -> None:
        """Refuse a recording in which nothing can be read (DetectError with what its messages are)."""
        if not self.types:
            raise DetectError(
                "no topics", source=self.name, needed="a camera and wheel readings are needed", remedy="record again"
            )
        if not self.encodings & {"cdr", "ros1", "protobuf", "json", "picture"}:
            raise DetectError(
                f"its messages are {listed(e or 'of no encoding' for e in self.encodings)} "
                f"({listed(self.types.values())})",
                source=self.name,
                needed="CDR, ROS 1, protobuf or JSON is needed",
                remedy="record with ROS 2",
            )

    def _handler(self, channel: Channel) -> _Handler | None:
        """Return what takes a channel's messages, None if nothing does."""
        found = self._handlers.get(id(channel))
        if found is None:
            found = self._handlers[id(channel)] = (channel, self._choose_handler(channel))
        return found[1]

    def _choose_handler(self, channel: Channel) -> _Handler | None:
        kind = ros_type(channel.type) if channel.encoding != "protobuf" else channel.type
        note = "" if channel.encoding == "cdr" else f" ({channel.encoding or 'no encoding'})"
        self.types.setdefault(channel.topic, f"{kind or 'no schema'}{note}")
        self.encodings.add(channel.encoding)
        if channel.encoding == "picture" or (kind in IMAGE_TYPES and channel.encoding in {*_ROS, "protobuf", "json"}):
            self.images.setdefault((channel.topic, kind), ImageSeries(channel=channel, kind=kind))
            return self._image
        named = [path for path in (named_field(j, channel.topic) for j in self.topics.joints) if path]
        if named:
            fields = tuple(Field(path=path, name=path, quantity=Quantity.TICKS) for path in named)
            return self._fields_handler(channel, fields)
        if kind == JOINTS or kind in FOXGLOVE_JOINTS:
            self.signals.setdefault(channel.topic, {})
            fast = kind == JOINTS and channel.encoding in _ROS
            return self._joints_handler(channel) if fast else self._decoded_joints_handler(channel)
        if kind in ODOMETRY:
            return self._odometry_handler(channel)
        if kind in METADATA_TYPES:
            return self._metadata_handler(channel, kind)
        fields = fields_of(kind, channel.topic)
        return self._fields_handler(channel, fields) if fields else None

    def _problem(self, topic: str, what: str, count: int = 1) -> None:
        first, before = self.problems.get(topic, (what, 0))
        self.problems[topic] = (first, before + count)

    def _count(self, readings: int) -> None:
        self._taken += readings
        if self._taken > MAX_SAMPLES:
            raise DetectError(
                f"more than {MAX_SAMPLES} wheel readings and images", source=self.name, remedy="split the log"
            )

    def _signal(self, topic: str, name: str, make: Callable[[], Signal]) -> Signal:
        of_topic = self.signals.setdefault(topic, {})
        found = of_topic.get(name)
        if found is None:
            self._names += 1
            if self._names > MAX_NAMES:
                raise DetectError(f"more than {MAX_NAMES} different joints; the log is damaged", source=self.name)
            found = of_topic[name] = make()
        return found

    def _joints_handler(self, channel: Channel) -> _Handler:
        reader = JointReader(ros1=channel.encoding == "ros1")

        def take(batch: Batch) -> None:
            for block in reader.blocks(_opened(batch)):
                for k, joint in enumerate(block.names):
                    self._joint(
                        channel.topic,
                        joint,
                        block.t_ns,
                        block.log_ns,
                        None if block.positions is None else block.positions[:, k],
                        None if block.velocities is None else block.velocities[:, k],
                    )
            if reader.damaged:
                self._problem(channel.topic, reader.problem, reader.damaged)
                reader.damaged = 0

        return take

    def _decoded_joints_handler(self, channel: Channel) -> _Handler | None:
        """Return what takes joint messages that are decoded one by one: JSON, and Foxglove's."""
        try:
            decode = decoder_of(channel)
        except DetectError as error:
            self._problem(channel.topic, str(error))
            return None

        def take(batch: Batch) -> None:
            for data, log in batch.messages():
                try:
                    message = decode(data)
                    t, found = np.array([stamp_of(message) or 0]), joints_of(message)
                except DetectError as error:
                    self._problem(channel.topic, str(error))
                    continue
                for joint, position, velocity in found:
                    self._joint(channel.topic, joint, t, np.array([log]), position, velocity)

        return take

    def _joint(  # noqa: PLR0917  the columns of a block
        self, topic: str, joint: str, t_ns: Ids, log_ns: Ids, position: Array | None, velocity: Array | None
    ) -> None:
        """Take one joint's numbers, if it can be a wheel; note its name in any case."""
        side = wheel_side(joint) or drive_side(joint)
        found = self._signal(
            topic, joint, lambda: Signal(topic=topic, name=joint, quantity=Quantity.POSITION, side=side)
        )
        if side is None and joint not in self.topics.joints:
            return
        if position is not None:
            found.add(t_ns, log_ns, position)
            self._count(len(t_ns))
        if velocity is not None:
            speed = self._signal(
                topic,
                f"{joint}\0velocity",
                lambda: Signal(topic=topic, name=joint, quantity=Quantity.VELOCITY, side=side),
            )
            speed.add(t_ns, log_ns, velocity)
            self._count(len(t_ns))

    def _fields_handler(self, channel: Channel, fields: tuple[Field, ...]) -> _Handler | None:
        try:
            decode = decoder_of(channel)
        except DetectError as error:
            self._problem(channel.topic, str(error))
            return None
        for f in fields:
            self._signal(channel.topic, f.name, lambda f=f: f.signal(channel.topic))  # type: ignore[misc]

        def take(batch: Batch) -> None:
            stamps: list[int] = []
            logs: list[int] = []
            rows: list[list[float]] = []
            stamped = True
            for data, log in batch.messages():
                try:
                    message = decode(data)
                    row = [value_at(message, f.path) for f in fields]
                except DetectError as error:
                    self._problem(channel.topic, str(error))
                    continue
                stamp = stamp_of(message)
                stamped = stamped and stamp is not None
                stamps.append(log if stamp is None else stamp)
                logs.append(log)
                rows.append(row)
            if not rows:
                return
            if fields[0].resolution and (turn := value_at(message, fields[0].resolution)) > 0:
                self.signals[channel.topic][fields[0].name].ticks_per_turn = turn
            values, t, log_ns = np.array(rows), np.array(stamps, dtype=np.int64), np.array(logs, dtype=np.int64)
            for k, f in enumerate(fields):
                signal = self.signals[channel.topic][f.name]
                signal.stamped = signal.stamped and stamped
                signal.add(t, log_ns, values[:, k])
                self._count(len(t))

        return take

    def _odometry_handler(self, channel: Channel) -> _Handler | None:
        try:
            decode = decoder_of(channel)
        except DetectError as error:
            self._problem(channel.topic, str(error))
            return None
        found = self.odometry.setdefault(channel.topic, OdometrySignal(topic=channel.topic))
        path, frame = ODOMETRY[ros_type(channel.type) if channel.encoding != "protobuf" else channel.type]

        def take(batch: Batch) -> None:
            for data, log in batch.messages():
                try:
                    message = decode(data)
                    x, y, qx, qy, qz, qw = (value_at(message, path + p) for p in _POSE)
                except DetectError as error:
                    self._problem(channel.topic, str(error))
                    continue
                if not np.all(np.abs([x, y, qx, qy, qz, qw]) < _FARTHEST):
                    continue
                found.t_ns.append(stamp_of(message) or 0)
                found.log_ns.append(log)
                found.poses.append((x, y, float(np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))))
                self._count(1)
            if not found.base_frame and found.poses:
                found.base_frame = text_at(message, frame)

        return take

    def _metadata_handler(self, channel: Channel, kind: str) -> _Handler | None:
        try:
            decode = decoder_of(channel)
        except DetectError:
            return None  # metadata is a gift: without it nothing is missing

        def take(batch: Batch) -> None:
            for data, _ in batch.messages():
                if not self.metadata.wants(kind, channel.topic):
                    return
                try:
                    self.metadata.take(kind, channel.topic, decode(data))
                except DetectError as error:
                    self._problem(channel.topic, str(error))

        return take

    def _image(self, batch: Batch) -> None:
        channel = batch.channel
        kind = ros_type(channel.type) if channel.encoding != "protobuf" else channel.type
        series = self.images[channel.topic, kind]
        first = len(series.t_ns)
        frames: list[memoryview] = []
        rows = zip(batch.starts.tolist(), batch.ends.tolist(), batch.log_ns.tolist(), batch.records(), strict=True)
        for start, end, log, record in rows:
            data = memoryview(batch.data)[start:end]
            try:
                stamp = image_stamp_ns(channel, kind, data, log)
            except DetectError as error:
                self._problem(channel.topic, str(error))
                continue
            if not series.t_ns:
                series.encoding = self._encoding(channel, kind, bytes(data))
            series.add(stamp, log, record, start)
            frames.append(data)
        if channel.encoding != PICTURE_FILE:
            stamps = np.array(series.t_ns[first:], dtype=np.int64)
            self.cache.offer(series, first, frames, self.cache.resting(stamps, self._wheel_signals()))
        self._count(len(batch.starts))

    def _wheel_signals(self) -> list[Signal]:
        """Return the signals that tell whether the robot rests: velocities only where nothing else moves."""
        found = [s for of_topic in self.signals.values() for s in of_topic.values() if s.count]
        moving = [s for s in found if s.quantity is not Quantity.VELOCITY and s.high > s.low]
        return moving or found

    def _encoding(self, channel: Channel, kind: str, data: bytes) -> str:
        try:
            return raw_encoding(channel, kind, data)
        except DetectError as error:
            self._problem(channel.topic, str(error))
            return ""


def _opened(batch: Batch) -> Batch:
    """Return a batch whose messages are not compressed one by one."""
    if not batch.channel.packed:
        return batch
    content = [message_unpacked(data) for data, _ in batch.messages()]
    ends = np.cumsum([len(c) for c in content], dtype=np.int64)
    return batch._replace(data=b"".join(content), starts=np.concatenate([[0], ends[:-1]]), ends=ends)


def problems_said(problems: dict[str, tuple[str, int]]) -> list[str]:
    """Return a sentence for each topic whose messages did not all decode."""
    return [
        f"{printable(topic)}: {count} message{'s' if count > 1 else ''} left out ({what})"
        for topic, (what, count) in problems.items()
    ]
