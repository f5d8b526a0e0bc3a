"""MCAP files: one pass over all messages, with every size checked before memory is spent on it.

The walk is our own because the ``mcap`` library's readers trust the sizes that a file claims (a chunk's, an
attachment's, a message's), make an object of every message, and give up at the first damage. Whatever is intact is
used: a damaged chunk is left out, a lost place is found again, a cut file gives what it holds up to the cut.

Format: the MCAP specification, https://mcap.dev/spec.
"""

import struct
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import BinaryIO, NamedTuple

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
from boxcal.detect.log.containers.mcap_salvage import next_record, summary_of
from boxcal.detect.log.containers.packing import ERRORS, unpacked, unpacked_beginning
from boxcal.detect.log.safe_text import printable
from boxcal.target.arrays import Ids

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS = 2, 3, 4, 5, 6, 8, 11
_LAST_OPCODE = 15

_HEAD = struct.Struct("<BQ")
_LENGTH = struct.Struct("<Q")
_HEAD_TYPE = np.dtype(
    [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("seq", "<u4"), ("log", "<u8"), ("pub", "<u8")]
)
_CHUNK = struct.Struct("<QQQII")
_RECORD_AND_HEAD = _HEAD.size
_BODY_AT = _HEAD_TYPE.itemsize
_MESSAGE_HEAD = np.arange(_BODY_AT)
_BLOCK = 1 << 20
_MAX_CHANNELS = 65_536


class ChunkHead(NamedTuple):
    """Header of an MCAP chunk: times (ns), unpacked size, checksum, compression, and where its data begins."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    data_at: int


def chunk_head(body: bytes | memoryview) -> ChunkHead:
    """Return a chunk record's fields (struct.error or ValueError if they are no chunk's)."""
    start, end, size, crc, length = _CHUNK.unpack_from(body)
    if length > 16:
        raise ValueError(f"a compression of {length} characters")
    at = _CHUNK.size + length
    compression = bytes(body[_CHUNK.size : at]).decode()
    (held,) = struct.unpack_from("<Q", body, at)
    if held > len(body) - at - 8:
        raise ValueError(f"{held} bytes of data claimed, {len(body) - at - 8} are there")
    return ChunkHead(start, end, size, crc, compression, at + 8)


class McapFile(HashedFile):
    """An MCAP file, open for reading."""

    kind = "MCAP"

    def __init__(self, file: BinaryIO, name: str, digest: str | None = None) -> None:
        super().__init__(file, name, digest)
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        self._counts: dict[int, int] = {}
        self._chunks_seen: set[int] = set()
        self._asked_summary = False
        self._true_length: dict[int, int] = {}
        self._packed = False

    def batches(self) -> Iterator[list[Batch]]:
        """Yield all messages in file order: of each chunk a list with a batch a channel."""
        walk = _Window(self._file, self._size, self._passed)
        walk.skip(len(MAGIC))
        while True:
            at = walk.at
            head = walk.peek(_RECORD_AND_HEAD)
            if len(head) < _RECORD_AND_HEAD:
                self.damage.add(f"truncated at byte {self._size}")
                break
            opcode, length = _HEAD.unpack(head)
            if opcode == FOOTER and length == 20:
                if walk.left < _RECORD_AND_HEAD + length + len(MAGIC):
                    self.damage.add("truncated after its footer")
                break
            if length > walk.left - _RECORD_AND_HEAD or opcode == 0:
                if not (yield from self._lost_place(walk, at, opcode, length)):
                    break
            elif opcode in {MESSAGE, SCHEMA, CHANNEL} and length <= _BLOCK // 2:
                yield from self._loose(walk)
            elif opcode in {CHUNK, MESSAGE, SCHEMA, CHANNEL}:
                yield from self._record(walk, at, opcode, length)
            elif opcode > _LAST_OPCODE and (body := self._chunk_by_another_name(walk, length)) is not None:
                self.damage.add(f"the record at byte {at} is a chunk by another name (a flipped bit), it was read")
                walk.skip(_RECORD_AND_HEAD + length)
                yield from self._chunk(body, at)
            else:
                walk.skip(_RECORD_AND_HEAD + length)
        yield from self._missed_chunks()
        if self._known_digest is None:
            walk.finish()
        self._compare_with_statistics()

    def read(self, places: Iterable[Place]) -> Iterator[bytes]:
        """Yield messages at places that :meth:`batches` gave (DetectError if the file changed)."""
        for record, inner in places:
            in_chunk = record in self._chunks_seen or self._is_chunk_at(record)
            if in_chunk and self._held[0] != record:
                self._held = (record, self._chunk_content(record))
            data, at = (self._held[1], inner - _BODY_AT) if in_chunk else (self._loose_at(record + inner), 0)
            try:
                opcode, length = _HEAD.unpack_from(data, at)
                if (
                    opcode != MESSAGE
                    or length < _BODY_AT - _RECORD_AND_HEAD
                    or at + _RECORD_AND_HEAD + length > len(data)
                ):
                    raise ValueError
            except (struct.error, ValueError) as error:
                raise DetectError(
                    "changed while it was read", source=self.name, remedy="close its recorder and try again"
                ) from error
            yield bytes(data[at + _BODY_AT : at + _RECORD_AND_HEAD + length])

    def _chunk_content(self, record: int) -> bytes | memoryview:
        """Return what the chunk at an offset of the file unpacks to, as an earlier pass saw it."""
        self._file.seek(record)
        head = self._file.read(_RECORD_AND_HEAD)
        length = _HEAD.unpack(head)[1] if len(head) == _RECORD_AND_HEAD else 0
        body = self._file.read(min(self._true_length.get(record, length), MAX_RECORD_BYTES))
        try:
            fields = chunk_head(body)
            return unpacked(_held(body, fields), fields.compression, fields.size)
        except (struct.error, DetectError, *ERRORS):
            return _beginning(body)

    def _is_chunk_at(self, record: int) -> bool:
        """Tell whether a record is a chunk, of a file that was opened again."""
        self._file.seek(record)
        found = self._file.read(1)
        if found and found[0] not in {MESSAGE, SCHEMA, CHANNEL}:
            self._chunks_seen.add(record)
            return True
        return False

    def _loose_at(self, start: int) -> bytes:
        """Return the message record that stands in no chunk and whose content begins at an offset of the file."""
        self._file.seek(max(start - _BODY_AT, 0))
        head = self._file.read(_RECORD_AND_HEAD)
        length = _HEAD.unpack(head)[1] if len(head) == _RECORD_AND_HEAD else 0
        return head + self._file.read(min(length, MAX_RECORD_BYTES))

    def _loose(self, walk: "_Window") -> Iterator[list[Batch]]:
        """Yield messages that stand in no chunk, many at a time."""
        base = walk.at
        data = walk.peek(_BLOCK)
        end = _whole_records(data)
        walk.skip(end)
        yield from self._content(memoryview(data)[:end], base, chunk=False)

    def _record(self, walk: "_Window", at: int, opcode: int, length: int) -> Iterator[list[Batch]]:
        if length > MAX_RECORD_BYTES:
            self.damage.add(f"the record at byte {at} claims {length} bytes, at most {MAX_RECORD_BYTES} are read")
            walk.skip(_RECORD_AND_HEAD + length)
            return
        if opcode == CHUNK:
            walk.skip(_RECORD_AND_HEAD)
            body = walk.peek(length)
            walk.skip(length)
            yield from self._chunk(memoryview(body), at)
        else:
            body = walk.peek(_RECORD_AND_HEAD + length)
            walk.skip(_RECORD_AND_HEAD + length)
            yield from self._content(memoryview(body), at, chunk=False)

    def _chunk(self, body: bytes | memoryview, at: int) -> Iterator[list[Batch]]:
        fields: ChunkHead | None = None
        try:
            fields = chunk_head(body)
            data = unpacked(_held(body, fields), fields.compression, fields.size)
            if fields.crc and zlib.crc32(data) != fields.crc:
                raise DetectError("its checksum does not match")
        except (struct.error, DetectError, *ERRORS) as error:
            span = None if fields is None else (fields.start_ns, fields.end_ns)
            kind = "" if isinstance(error, DetectError) else f"{type(error).__name__}: "
            why = kind + printable(str(error)[:200])
            self.damage.add(f"the chunk at byte {at} is damaged ({why}) and was left out", span_ns=span)
            return
        self._budget.take(unpacked=len(data))
        yield from self._content(data, at)

    def _content(
        self, data: bytes | memoryview, at: int, *, chunk: bool = True, whole: bool = True
    ) -> Iterator[list[Batch]]:
        """Yield the messages of a chunk's unpacked data, or of records that stand in no chunk."""
        if chunk:
            self._chunks_seen.add(at)
        view = memoryview(data)
        marks, problem = _records_in(view, self._budget.messages_left + _MAX_CHANNELS)
        if problem and whole:
            self.damage.add(f"the {'chunk' if chunk else 'record'} at byte {at} is damaged inside: {problem}")
        yield self._batches_of(view, marks, at)

    def _batches_of(self, view: memoryview, marks: Ids, at: int) -> list[Batch]:
        """Return the messages among records in memory, a batch a channel; take schemas and channels."""
        memory = np.frombuffer(view, dtype=np.uint8)
        opcodes = memory[marks]
        for mark, opcode in zip(marks, opcodes, strict=True) if np.any(opcodes != MESSAGE) else ():
            if opcode in {SCHEMA, CHANNEL}:
                (length,) = _LENGTH.unpack_from(view, mark + 1)
                self.describe(int(opcode), view[mark + _RECORD_AND_HEAD : mark + _RECORD_AND_HEAD + length])
        marks = marks[(opcodes == MESSAGE) & (marks <= len(view) - _BODY_AT)]
        heads = memory[marks[:, None] + _MESSAGE_HEAD].copy().view(_HEAD_TYPE)[:, 0]
        lengths = heads["length"].astype(np.int64)
        good = lengths >= _BODY_AT - _RECORD_AND_HEAD
        if not np.all(good):
            self.damage.add(f"the chunk at byte {at} is damaged inside: a message of {lengths[~good][0]} bytes")
            marks, heads, lengths = marks[good], heads[good], lengths[good]
        self._budget.take(messages=len(marks))
        starts, ends, log_ns = marks + _BODY_AT, marks + _RECORD_AND_HEAD + lengths, heads["log"].astype(np.int64)
        batches = []
        for number in np.unique(heads["channel"]).tolist():
            of_channel = heads["channel"] == number
            self._counts[number] = self._counts.get(number, 0) + int(np.sum(of_channel))
            channel = self._channel(number)
            if channel is not None:
                batches.append(Batch(channel, view, starts[of_channel], ends[of_channel], log_ns[of_channel], at))
        return batches

    def describe(self, opcode: int, body: memoryview) -> None:
        """Take a schema or channel record; a damaged one is passed over and counted."""
        try:
            if opcode == SCHEMA:
                (number,) = struct.unpack_from("<H", body)
                name, at = _string(body, 2)
                encoding, at = _string(body, at)
                (length,) = struct.unpack_from("<I", body, at)
                text = bytes(body[at + 4 : at + 4 + length]) if length <= MAX_SCHEMA_BYTES else b""
                self._schemas[number] = (checked_name(name, "type"), encoding, text)
                return
            number, schema = struct.unpack_from("<HH", body)
            if number in self._channels or len(self._channels) >= _MAX_CHANNELS:
                return
            topic, at = _string(body, 4)
            encoding, at = _string(body, at)
        except (struct.error, ValueError) as error:
            self.damage.add(f"a {'schema' if opcode == SCHEMA else 'channel'} is damaged ({type(error).__name__})")
            return
        name, language, text = self._schemas.get(schema, ("", "", b""))
        self._channels[number] = Channel(
            topic=checked_name(topic, "topic"),
            type=ros_type(name) if encoding in {"cdr", "ros1"} else name,
            encoding=encoding,
            schema=text,
            schema_encoding=language,
            packed=self._packed,
        )

    @property
    def channels(self) -> list[Channel]:
        """All channels that were described so far."""
        return list(self._channels.values())

    def messages_are_packed(self) -> None:
        """Take each message as compressed by itself, as a bag folder's metadata may say."""
        self._packed = True

    def _channel(self, number: int) -> Channel | None:
        """Return a channel, if need be from the file's summary; None if the file does not describe it."""
        found = self._channels.get(number)
        if found is None and not self._asked_summary:
            self._asked_summary = True
            for opcode, body in summary_of(self._file, self._size):
                if opcode in {SCHEMA, CHANNEL}:
                    self.describe(opcode, memoryview(body))
            found = self._channels.get(number)
        if found is None:
            self.damage.add(f"messages of channel {number}, which the file does not describe, were left out")
        return found

    def _lost_place(self, walk: "_Window", at: int, opcode: int, length: int) -> Generator[list[Batch], None, bool]:
        """Go on behind a record that cannot be one; return whether there is anything more."""
        left = walk.left - _RECORD_AND_HEAD
        claim = f"the record at byte {at} claims {length} bytes, the file has {left} more"
        if opcode == CHUNK:
            indexed = self._indexed_chunks().get(at)
            if indexed is not None and indexed - _RECORD_AND_HEAD <= left:
                self.damage.add(f"{claim}; its length was taken from the file's index")
                self._true_length[at] = indexed - _RECORD_AND_HEAD
                yield from self._record(walk, at, opcode, indexed - _RECORD_AND_HEAD)
                return True
            if not _ends_whole(self._file, self._size):
                self.damage.add(f"truncated: {claim}")
                data = _beginning(memoryview(walk.peek(min(walk.left, MAX_RECORD_BYTES)))[_RECORD_AND_HEAD:])
                if data:
                    yield from self._content(data, at, whole=False)
                return False
        found = next_record(walk, self._size)
        if found is None:
            self.damage.add(f"truncated or damaged: {claim}")
            return False
        self.damage.add(f"bytes {at} to {found} are no records")
        walk.skip(found - walk.at)
        return True

    def _chunk_by_another_name(self, walk: "_Window", length: int) -> memoryview | None:
        """Return the content of a record that is a chunk in all but its opcode, else None."""
        if not _CHUNK.size < length <= MAX_RECORD_BYTES:
            return None
        body = memoryview(walk.peek(_RECORD_AND_HEAD + length))[_RECORD_AND_HEAD:]
        return body if _is_chunk(body) else None

    def _indexed_chunks(self) -> dict[int, int]:
        """Return the length of each chunk record by its offset, as the file's summary has them."""
        return {
            int(at): int(length)
            for opcode, body in summary_of(self._file, self._size)
            if opcode == CHUNK_INDEX and len(body) >= 32
            for at, length in [struct.unpack_from("<QQ", body, 16)]
        }

    def _missed_chunks(self) -> Iterator[list[Batch]]:
        """Yield what stands in chunks that the file's index names and the walk did not see as chunks."""
        claimed = self._statistics()
        if claimed is None or claimed <= sum(self._counts.values()):
            return
        for at, length in sorted(self._indexed_chunks().items()):
            if at in self._chunks_seen or not _RECORD_AND_HEAD < length <= min(MAX_RECORD_BYTES, self._size - at):
                continue
            self._file.seek(at + _RECORD_AND_HEAD)
            body = memoryview(self._file.read(length - _RECORD_AND_HEAD))
            if _is_chunk(body):
                self.damage.add(f"the chunk at byte {at} has a damaged head, it was read by the file's index")
                self._true_length[at] = length - _RECORD_AND_HEAD
                yield from self._chunk(body, at)

    def _statistics(self) -> int | None:
        """Return how many messages the file's statistics claim, None if it has none."""
        for opcode, body in summary_of(self._file, self._size):
            if opcode == STATISTICS and len(body) >= 8:
                return int(struct.unpack_from("<Q", body)[0])
        return None

    def _compare_with_statistics(self) -> None:
        claimed, seen = self._statistics(), sum(self._counts.values())
        if claimed is not None and seen < claimed < 1 << 40:
            self.damage.add(f"{claimed - seen} of its {claimed} messages are missing", messages=claimed - seen)


def _held(body: bytes | memoryview, fields: ChunkHead) -> memoryview:
    """Return the compressed data of a chunk record."""
    (count,) = struct.unpack_from("<Q", body, fields.data_at - 8)
    return memoryview(body)[fields.data_at : fields.data_at + count]


def _is_chunk(body: memoryview) -> bool:
    """Tell whether a record's content is a chunk with a right checksum."""
    try:
        fields = chunk_head(body)
        data = unpacked(_held(body, fields), fields.compression, fields.size)
    except (struct.error, DetectError, *ERRORS):
        return False
    return bool(fields.crc) and zlib.crc32(data) == fields.crc


def _beginning(body: bytes | memoryview) -> bytes:
    """Return what the data of a chunk record that was cut off unpacks to, as far as it is there."""
    try:
        _, _, size, _, length = _CHUNK.unpack_from(body)
        at = _CHUNK.size + length
        compression = bytes(body[_CHUNK.size : at]).decode()
    except (struct.error, ValueError):
        return b""
    return unpacked_beginning(memoryview(body)[at + 8 :], compression, size)


def _ends_whole(file: BinaryIO, size: int) -> bool:
    """Tell whether a file ends as an MCAP that was closed does."""
    file.seek(max(size - len(MAGIC), 0))
    return file.read(len(MAGIC)) == MAGIC


def _string(body: memoryview, at: int) -> tuple[str, int]:
    """Return the text that stands at an offset, behind its length, and where it ends."""
    (length,) = struct.unpack_from("<I", body, at)
    if length > len(body) - at - 4:
        raise ValueError(f"a text of {length} bytes")
    end = at + 4 + length
    return bytes(body[at + 4 : end]).decode(), end


def _whole_records(data: bytes | memoryview) -> int:
    """Return where the last of the loose records that are whole in some memory ends."""
    at = 0
    while at + _RECORD_AND_HEAD <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        stop = at + _RECORD_AND_HEAD + length
        if opcode not in {MESSAGE, SCHEMA, CHANNEL} or stop > len(data):
            break
        at = stop
    return at


def _records_in(view: memoryview, most: int) -> tuple[Ids, str]:
    """Return where the first records in memory begin, one behind the other, and what is wrong behind the last."""
    at, end, unpack = 0, len(view), _LENGTH.unpack_from
    marks: list[int] = []
    mark = marks.append
    while at + _RECORD_AND_HEAD <= end and len(marks) <= most:
        (length,) = unpack(view, at + 1)
        stop = at + _RECORD_AND_HEAD + length
        if stop > end:
            left = end - at - _RECORD_AND_HEAD
            problem = f"a record in its chunk claims {length} bytes, the chunk has {left} more"
            return np.array(marks, dtype=np.int64), problem
        mark(at)
        at = stop
    return np.array(marks, dtype=np.int64), ""


class _Window:
    """A file read once from front to end, with a look ahead; all that passes is hashed."""

    def __init__(self, file: BinaryIO, size: int, passed: Callable[[bytes], bytes]) -> None:
        self._file, self._passed, self._buffer = file, passed, b""
        self.at, self.size = 0, size
        file.seek(0)
        self._file_at = 0

    @property
    def left(self) -> int:
        """Bytes from here to the end of the file."""
        return self.size - self.at

    def peek(self, count: int) -> bytes:
        """Return the next bytes, fewer at the file's end, without passing them."""
        held = len(self._buffer)
        if held < count:
            more = self._pull(count - held)
            self._buffer = self._buffer + more if held else more
        return self._buffer if len(self._buffer) <= count else self._buffer[:count]

    def skip(self, count: int) -> None:
        """Pass bytes."""
        self.at += count
        held = len(self._buffer)
        self._buffer = self._buffer[count:] if count < held else b""
        count -= held
        while count > 0 and (passed := len(self._pull(min(count, _BLOCK)))):
            count -= passed

    def finish(self) -> None:
        """Hash what was not passed."""
        while self._pull(_BLOCK):
            pass

    def _pull(self, count: int) -> bytes:
        if self._file.tell() != self._file_at:  # others looked elsewhere
            self._file.seek(self._file_at)
        block = self._file.read(count)
        self._file_at += len(block)
        return self._passed(block)
