"""The one pass over a recording: all wheel readings, where the images stand, and what it says of the robot."""

from dataclasses import dataclass, field

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Batch, Channel, Container, ros_type
from boxcal.detect.log.containers.mcap_indexed import IndexedMcap, Wanted
from boxcal.detect.log.frame_cache import FrameCache
from boxcal.detect.log.images import IMAGE_TYPES, PICTURE_FILE, ImageSeries, image_stamp_ns, raw_encoding
from boxcal.detect.log.readings import ROS, Handler, Readings
from boxcal.detect.log.safe_text import listed
from boxcal.detect.log.topics import Topics


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
    readings
        What all other messages give.
    cache
        Keeps frames that will be wanted again.
    claimed
        Images of each topic as the recording's index has them, where only some of it is read.
    """

    name: str
    topics: Topics
    types: dict[str, str] = field(default_factory=dict)
    encodings: set[str] = field(default_factory=set)
    images: dict[tuple[str, str], ImageSeries] = field(default_factory=dict)
    readings: Readings = field(init=False)
    cache: FrameCache = field(default_factory=FrameCache)
    claimed: dict[str, int] = field(default_factory=dict)
    _handlers: dict[int, tuple[Channel, Handler | None]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.readings = Readings(name=self.name, topics=self.topics)

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
        late: list[tuple[Handler, Batch]] = []
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
        return max(images, self.readings.decoded_of(topic))

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

    def _handler(self, channel: Channel) -> Handler | None:
        """Return what takes a channel's messages, None if nothing does."""
        found = self._handlers.get(id(channel))
        if found is None:
            found = self._handlers[id(channel)] = (channel, self._choose_handler(channel))
        return found[1]

    def _choose_handler(self, channel: Channel) -> Handler | None:
        kind = ros_type(channel.type) if channel.encoding != "protobuf" else channel.type
        note = "" if channel.encoding == "cdr" else f" ({channel.encoding or 'no encoding'})"
        self.types.setdefault(channel.topic, f"{kind or 'no schema'}{note}")
        self.encodings.add(channel.encoding)
        if channel.encoding == "picture" or (kind in IMAGE_TYPES and channel.encoding in {*ROS, "protobuf", "json"}):
            self.images.setdefault((channel.topic, kind), ImageSeries(channel=channel, kind=kind))
            return self._image
        return self.readings.handler(channel, kind)

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
                self.readings.problem(channel.topic, str(error))
                continue
            if not series.t_ns:
                series.encoding = self._encoding(channel, kind, bytes(data))
            series.add(stamp, log, record, start)
            frames.append(data)
        if channel.encoding != PICTURE_FILE:
            stamps = np.array(series.t_ns[first:], dtype=np.int64)
            self.cache.offer(series, first, frames, self.cache.resting(stamps, self.readings.wheel_signals()))
        self.readings.count(len(batch.starts))

    def _encoding(self, channel: Channel, kind: str, data: bytes) -> str:
        try:
            return raw_encoding(channel, kind, data)
        except DetectError as error:
            self.readings.problem(channel.topic, str(error))
            return ""
