"""Common interface of all kinds of recordings: messages in one pass, and single messages by their place."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import printable
from boxcal.target.arrays import Ids

MAX_RECORD_BYTES = 128 << 20
"""Largest record, and largest unpacked chunk, that is read: a raw colour image of 25 Mpx fits."""
MAX_SCHEMA_BYTES = 1 << 20
"""Longest description of a message type that is kept; the longest of ROS' own have 20 kB."""
MAX_NAME_BYTES = 1024
"""Longest name of a topic or type."""
_FREE_MESSAGES, _BYTES_A_MESSAGE = 500_000, 8
_FREE_BYTES, _UNPACKING = 256 << 20, 200
"""What a file may hold: so many messages and bytes, and then what its size lets expect: a message takes 8 bytes at
least, and no recording that is meant to be read is compressed to a 200th."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Channel:
    """One publisher's stream of messages, as the recording describes it.

    Attributes
    ----------
    topic
        Its name.
    type
        Message type: ``package/msg/Type`` for ROS, its full name for protobuf and JSON.
    encoding
        Of the messages: ``cdr`` (ROS 2), ``ros1``, ``protobuf`` or ``json``.
    schema, schema_encoding
        The definition of the type and its language, empty where the recording has none.
    packed
        Whether each message is compressed by itself (zstd).
    """

    topic: str
    type: str
    encoding: str
    schema: bytes = b""
    schema_encoding: str = ""
    packed: bool = False


class Batch(NamedTuple):
    """Messages of one channel that stand in one piece of memory.

    Attributes
    ----------
    channel
        What they are.
    data
        Memory that holds them.
    starts, ends : (N,)
        Where each message lies in it.
    log_ns : (N,) ns
        When each was recorded.
    record : int or (N,)
        The place in the file that ``data`` comes from, or that each message does; with a start it finds a message
        again.
    """

    channel: Channel
    data: bytes | memoryview
    starts: Ids
    ends: Ids
    log_ns: Ids
    record: int | Ids

    def messages(self) -> Iterator[tuple[bytes, int]]:
        """Yield the bytes and the time of recording of each message."""
        for start, end, log in zip(self.starts.tolist(), self.ends.tolist(), self.log_ns.tolist(), strict=True):
            yield bytes(self.data[start:end]), log

    def records(self) -> list[int]:
        """Return the place of each message."""
        return [self.record] * len(self.starts) if isinstance(self.record, int) else self.record.tolist()


class Place(NamedTuple):
    """Place of a message: a record of the recording, and an offset in what the record holds."""

    record: int
    inner: int


@dataclass(slots=True, kw_only=True)
class Damage:
    """Parts of a recording that could not be read, with the reason.

    Attributes
    ----------
    notes
        A sentence for each loss, without the file's name.
    messages
        How many messages are known to be lost.
    spans_ns
        Times (first, last) whose messages were lost, where the file says so.
    """

    notes: list[str] = field(default_factory=list)
    messages: int = 0
    spans_ns: list[tuple[int, int]] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Length of the lost times, s."""
        return sum(end - start for start, end in self.spans_ns) / 1e9

    def add(self, note: str, *, messages: int = 0, span_ns: tuple[int, int] | None = None) -> None:
        """Note a loss; the first few are reported, all are counted."""
        if len(self.notes) < 5:
            self.notes.append(note)
        self.messages += messages
        if span_ns is not None and 0 < span_ns[0] <= span_ns[1] < span_ns[0] + 10**14:
            self.spans_ns.append(span_ns)


class Container(Protocol):
    """One kind of recording, open for reading."""

    name: str
    kind: str
    damage: Damage

    def batches(self) -> Iterator[list[Batch]]:
        """Yield all messages, piece by piece in the order in which they stand; whatever is intact is given."""

    def read(self, places: Iterable[Place]) -> Iterator[bytes]:
        """Yield the messages at places that an earlier pass gave, in the order asked for."""

    def sha256(self) -> str:
        """Return the hash of the recording's bytes, known once all batches were read."""

    def close(self) -> None:
        """Close its files."""


@dataclass(slots=True)
class Budget:
    """Bounds what a recording may unpack to, so that a small file cannot take all memory or time."""

    name: str
    size: int
    messages: int = 0
    unpacked: int = 0

    @property
    def messages_left(self) -> int:
        """Number of further messages that the file may hold."""
        return _FREE_MESSAGES + self.size // _BYTES_A_MESSAGE - self.messages

    def take(self, *, messages: int = 0, unpacked: int = 0) -> None:
        """Count messages and unpacked bytes (DetectError beyond what the file's size lets expect)."""
        self.messages += messages
        self.unpacked += unpacked
        if self.messages_left < 0:
            raise DetectError(
                f"more than {self.messages - 1} messages in {self.size} bytes",
                source=self.name,
                needed="a recording of a robot's topics",
                remedy="record again",
            )
        if self.unpacked > _FREE_BYTES + self.size * _UNPACKING:
            raise DetectError(
                f"{self.size} bytes that unpack to more than {self.unpacked >> 20} MB",
                source=self.name,
                needed="a recording of a robot's topics",
                remedy="record again",
            )


def checked_name(name: str, what: str) -> str:
    """Return a topic's or type's name (DetectError if it is unreasonably long)."""
    if len(name) > MAX_NAME_BYTES:
        raise DetectError(f"a {what} with a name of {len(name)} characters ({printable(name)}); the log is damaged")
    return name


def ros_type(name: str) -> str:
    """Return a ROS type's name as ROS 2 writes it: ``package/msg/Type``."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name
