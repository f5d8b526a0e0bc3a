"""ROS 1 bags (format 2.0): one pass over chunks and messages, with or without the index that a crash leaves out.

``rosbags`` reads bags by their index and refuses those without one (``*.bag.active``, truncated ones), so the walk is
our own; the messages are decoded by ``rosbags``. Format: http://wiki.ros.org/Bags/Format/2.0.
"""

import struct
from collections.abc import Iterable, Iterator
from typing import BinaryIO

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import (
    MAX_RECORD_BYTES,
    MAX_SCHEMA_BYTES,
    Batch,
    Channel,
    Place,
    checked_name,
    ros_type,
)
from boxcal.detect.log.containers.hashing import HashedFile
from boxcal.detect.log.containers.packing import ERRORS, unpacked, unpacked_beginning
from boxcal.detect.log.safe_text import printable

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")
_NS = 1_000_000_000
_MAX_HEADER_BYTES = 1 << 20
_MAX_CONNECTIONS = 65_536
_Lists = tuple[list[int], list[int], list[int]]


class Ros1Bag(HashedFile):
    """A ROS 1 bag, open for reading."""

    kind = "ROS 1 bag"

    def __init__(self, file: BinaryIO, name: str, digest: str | None = None) -> None:
        super().__init__(file, name, digest)
        self._unknown: set[int] = set()

    def batches(self) -> Iterator[list[Batch]]:
        """Yield all messages, of each chunk a list with a batch a connection."""
        self._file.seek(0)
        self._take(len(MAGIC))
        at = len(MAGIC)
        while at < self._size:
            head = self._take(4)
            length = _LENGTH.unpack(head)[0] if len(head) == 4 else -1
            if not 0 <= length <= min(_MAX_HEADER_BYTES, self._size - at):
                self.damage.add(f"truncated or damaged at byte {at}")
                break
            fields, size = _fields(self._take(length)), self._take(4)
            held = _LENGTH.unpack(size)[0] if len(size) == 4 else -1
            data_at = at + 8 + length
            left = self._size - data_at
            op = fields.get(b"op", b"\0")[0]
            if not 0 <= held <= MAX_RECORD_BYTES or (held > left and op != _CHUNK):
                self.damage.add(
                    f"truncated or damaged at byte {at}: a record claims {held} bytes, {max(left, 0)} are left"
                )
                break
            data = self._take(min(held, left))
            if op == _CHUNK:
                yield from self._chunk(fields, data, at, held)
            elif op == _CONNECTION:
                self._connection(fields, data)
            at = data_at + held
        while self._take(1 << 20):
            pass

    def read(self, places: Iterable[Place]) -> Iterator[bytes]:
        """Yield messages at places that :meth:`batches` gave."""
        for record, inner in places:
            try:
                if self._held[0] != record:
                    self._file.seek(record)
                    fields = _fields(self._file.read(_LENGTH.unpack(self._file.read(4))[0]))
                    held = _LENGTH.unpack(self._file.read(4))[0]
                    self._held = (record, self._content(fields, self._file.read(min(held, MAX_RECORD_BYTES))))
                data = self._held[1]
                (length,) = _LENGTH.unpack_from(data, inner - 4)
            except struct.error as error:
                raise DetectError(
                    "changed while it was read", source=self.name, remedy="close its recorder and try again"
                ) from error
            yield bytes(data[inner : inner + length])

    def _take(self, count: int) -> bytes:
        return self._passed(self._file.read(count))

    def _content(self, fields: dict[bytes, bytes], data: bytes) -> bytes | memoryview:
        """Return what a chunk unpacks to; of one that is damaged or cut off, what its beginning does."""
        compression = fields.get(b"compression", b"none").decode("ascii", "replace")
        size = _stated_size(fields) or 0
        compression = "" if compression == "none" else compression
        try:
            return unpacked(data, compression, size)
        except (DetectError, *ERRORS):
            return unpacked_beginning(data, compression, size)

    def _chunk(self, fields: dict[bytes, bytes], data: bytes, at: int, claimed: int) -> Iterator[list[Batch]]:
        content = self._content(fields, data)
        self._budget.take(unpacked=len(content))
        if len(data) < claimed:
            self.damage.add(f"truncated in the chunk at byte {at}")
        elif len(content) != _stated_size(fields):
            self.damage.add(f"the chunk at byte {at} is damaged, what its beginning holds is used")
        lists: dict[int, _Lists] = {}
        try:
            self._index(memoryview(content), lists)
        except DetectError:
            raise
        except (struct.error, ValueError, IndexError) as error:
            if len(data) == claimed:
                self.damage.add(f"the chunk at byte {at} is damaged inside ({printable(str(error))})")
        batches = []
        for number, messages in lists.items():
            channel = self._channels.get(number)
            if channel is not None:
                starts, ends, log_ns = (np.array(m, dtype=np.int64) for m in messages)
                batches.append(Batch(channel, content, starts, ends, log_ns, at))
            elif number not in self._unknown:
                self._unknown.add(number)
                self.damage.add(f"messages of connection {number}, which the file does not describe, were left out")
        yield batches

    def _index(self, view: memoryview, lists: dict[int, _Lists]) -> None:
        """Note where the messages lie in a chunk's content; take its connections."""
        at, end, count = 0, len(view), 0
        while at + 8 <= end:
            (length,) = _LENGTH.unpack_from(view, at)
            head_end = at + 4 + length
            if head_end + 4 > end:
                raise ValueError("a record's head goes beyond the chunk")
            (held,) = _LENGTH.unpack_from(view, head_end)
            start, stop = head_end + 4, head_end + 4 + held
            if stop > end:
                raise ValueError("a record goes beyond the chunk")
            fields = _fields(view[at + 4 : head_end])
            op = fields.get(b"op", b"\0")[0]
            if op == _MESSAGE:
                (number,) = _LENGTH.unpack(fields.get(b"conn", b""))
                sec, nsec = _TIME.unpack(fields.get(b"time", b""))
                found = lists.setdefault(number, ([], [], []))
                found[0].append(start)
                found[1].append(stop)
                found[2].append(sec * _NS + nsec)
                count += 1
            elif op == _CONNECTION:
                self._connection(fields, bytes(view[start:stop]))
            at = stop
        self._budget.take(messages=count)

    def _connection(self, fields: dict[bytes, bytes], data: bytes) -> None:
        try:
            (number,) = _LENGTH.unpack(fields.get(b"conn", b""))
            if number in self._channels or len(self._channels) >= _MAX_CONNECTIONS:
                return
            about = _fields(data)
            text = about.get(b"message_definition", b"")
            self._channels[number] = Channel(
                topic=checked_name(fields.get(b"topic", about.get(b"topic", b"")).decode(), "topic"),
                type=ros_type(checked_name(about.get(b"type", b"").decode(), "type")),
                encoding="ros1",
                schema=text if len(text) <= MAX_SCHEMA_BYTES else b"",
                schema_encoding="ros1msg",
            )
        except (struct.error, ValueError) as error:
            self.damage.add(f"a connection is damaged ({type(error).__name__})")


def _stated_size(fields: dict[bytes, bytes]) -> int | None:
    """Return the size that a chunk's head states for its unpacked content, None if it states none."""
    size = fields.get(b"size", b"")
    return int(_LENGTH.unpack(size)[0]) if len(size) == _LENGTH.size else None


def _fields(data: bytes | memoryview) -> dict[bytes, bytes]:
    """Return the ``name=value`` fields of a record's head; what is damaged ends them."""
    out: dict[bytes, bytes] = {}
    at = 0
    while at + 4 <= len(data):
        (length,) = _LENGTH.unpack_from(data, at)
        at += 4
        name, separator, value = bytes(data[at : at + length]).partition(b"=")
        if not separator or at + length > len(data):
            break
        out[name] = value
        at += length
    if out.get(b"op") == b"":
        del out[b"op"]
    return out
