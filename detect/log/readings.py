"""Wheel readings, odometry and descriptions of the robot in a recording: a reader for each kind of message."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Batch, Channel, ros_type
from boxcal.detect.log.containers.packing import message_unpacked
from boxcal.detect.log.joint_states import JointReader
from boxcal.detect.log.metadata import METADATA_TYPES, Metadata
from boxcal.detect.log.ros_messages import decoder_of, joints_of, stamp_of, text_at, value_at
from boxcal.detect.log.safe_text import printable
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
ROS = {"cdr", "ros1"}
"""Encodings of ROS' own messages."""
_POSE = ("position.x", "position.y", "orientation.x", "orientation.y", "orientation.z", "orientation.w")
Handler = Callable[[Batch], None]
"""Takes some messages of one channel."""


@dataclass(slots=True, kw_only=True, eq=False)
class Readings:
    """Wheel readings, odometry and descriptions of the robot, taken message by message.

    Attributes
    ----------
    name
        Of the recording, for messages.
    topics
        What the user named: such joints are kept whatever their names mean.
    signals
        By topic and joint or field; a joint without readings that can be a wheel is there too, empty.
    odometry
        By topic.
    metadata
        What the recording says of the robot.
    problems
        Messages that did not decode, images too: what and how many, by topic.
    """

    name: str
    topics: Topics
    signals: dict[str, dict[str, Signal]] = field(default_factory=dict)
    odometry: dict[str, OdometrySignal] = field(default_factory=dict)
    metadata: Metadata = field(default_factory=Metadata)
    problems: dict[str, tuple[str, int]] = field(default_factory=dict)
    _taken: int = 0
    _names: int = 0

    def handler(self, channel: Channel, kind: str) -> Handler | None:
        """Return what takes the messages of a channel of some type, None if nothing of them is wanted."""
        named = [path for path in (named_field(j, channel.topic) for j in self.topics.joints) if path]
        if named:
            fields = tuple(Field(path=path, name=path, quantity=Quantity.TICKS) for path in named)
            return self._fields_handler(channel, fields)
        if kind == JOINTS or kind in FOXGLOVE_JOINTS:
            self.signals.setdefault(channel.topic, {})
            fast = kind == JOINTS and channel.encoding in ROS
            return self._joints_handler(channel) if fast else self._decoded_joints_handler(channel)
        if kind in ODOMETRY:
            return self._odometry_handler(channel)
        if kind in METADATA_TYPES:
            return self._metadata_handler(channel, kind)
        fields = fields_of(kind, channel.topic)
        return self._fields_handler(channel, fields) if fields else None

    def problem(self, topic: str, what: str, count: int = 1) -> None:
        """Note messages of a topic that did not decode."""
        first, before = self.problems.get(topic, (what, 0))
        self.problems[topic] = (first, before + count)

    def count(self, readings: int) -> None:
        """Count readings or images (DetectError beyond all measure)."""
        self._taken += readings
        if self._taken > MAX_SAMPLES:
            raise DetectError(
                f"more than {MAX_SAMPLES} wheel readings and images", source=self.name, remedy="split the log"
            )

    def decoded_of(self, topic: str) -> int:
        """Return how many messages of a topic gave something, as far as they were read."""
        readings = max((s.count for s in self.signals.get(topic, {}).values()), default=0)
        return max(readings, len(self.odometry[topic].poses) if topic in self.odometry else 0)

    def forget_signals(self, but: Collection[Signal] = ()) -> None:
        """Let go of all readings of wheels but those of some signals: a long drive has a million of each."""
        for of_topic in self.signals.values():
            for signal in of_topic.values():
                if signal not in but:
                    signal.forget()

    def wheel_signals(self) -> list[Signal]:
        """Return the signals that show whether the robot rests: velocities only where nothing else moves."""
        found = [s for of_topic in self.signals.values() for s in of_topic.values() if s.count]
        moving = [s for s in found if s.quantity is not Quantity.VELOCITY and s.high > s.low]
        return moving or found

    def _signal(self, topic: str, name: str, make: Callable[[], Signal]) -> Signal:
        of_topic = self.signals.setdefault(topic, {})
        found = of_topic.get(name)
        if found is None:
            self._names += 1
            if self._names > MAX_NAMES:
                raise DetectError(f"more than {MAX_NAMES} different joints; the log is damaged", source=self.name)
            found = of_topic[name] = make()
        return found

    def _joints_handler(self, channel: Channel) -> Handler:
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
                self.problem(channel.topic, reader.problem, reader.damaged)
                reader.damaged = 0

        return take

    def _decoded_joints_handler(self, channel: Channel) -> Handler | None:
        """Return what takes joint messages that are decoded one by one: JSON, and Foxglove's."""
        try:
            decode = decoder_of(channel)
        except DetectError as error:
            self.problem(channel.topic, str(error))
            return None

        def take(batch: Batch) -> None:
            for data, log in batch.messages():
                try:
                    message = decode(data)
                    t, found = np.array([stamp_of(message) or 0]), joints_of(message)
                except DetectError as error:
                    self.problem(channel.topic, str(error))
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
            self.count(len(t_ns))
        if velocity is not None:
            speed = self._signal(
                topic,
                f"{joint}\0velocity",
                lambda: Signal(topic=topic, name=joint, quantity=Quantity.VELOCITY, side=side),
            )
            speed.add(t_ns, log_ns, velocity)
            self.count(len(t_ns))

    def _fields_handler(self, channel: Channel, fields: tuple[Field, ...]) -> Handler | None:
        try:
            decode = decoder_of(channel)
        except DetectError as error:
            self.problem(channel.topic, str(error))
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
                    self.problem(channel.topic, str(error))
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
                self.count(len(t))

        return take

    def _odometry_handler(self, channel: Channel) -> Handler | None:
        try:
            decode = decoder_of(channel)
        except DetectError as error:
            self.problem(channel.topic, str(error))
            return None
        found = self.odometry.setdefault(channel.topic, OdometrySignal(topic=channel.topic))
        path, frame = ODOMETRY[ros_type(channel.type) if channel.encoding != "protobuf" else channel.type]

        def take(batch: Batch) -> None:
            for data, log in batch.messages():
                try:
                    message = decode(data)
                    x, y, qx, qy, qz, qw = (value_at(message, path + p) for p in _POSE)
                except DetectError as error:
                    self.problem(channel.topic, str(error))
                    continue
                if not np.all(np.abs([x, y, qx, qy, qz, qw]) < _FARTHEST):
                    continue
                found.t_ns.append(stamp_of(message) or 0)
                found.log_ns.append(log)
                found.poses.append((x, y, float(np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))))
                self.count(1)
            if not found.base_frame and found.poses:
                found.base_frame = text_at(message, frame)

        return take

    def _metadata_handler(self, channel: Channel, kind: str) -> Handler | None:
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
                    self.problem(channel.topic, str(error))

        return take


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
