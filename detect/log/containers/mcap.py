"""MCAP files: one pass over all messages, with every size checked before memory is spent on it.

The walk is our own because the ``mcap`` library's readers trust the sizes that a file claims (a chunk's, an
attachment's, a message's), make an object of every message, and give up at the first damage. Whatever is intact is
used: a damaged chunk is left out, a lost place is found again, a cut file gives what it holds up to the cut.

Format: the MCAP specification, https://mcap.dev/spec.
"""

import struct
import zlib
from collections.abc import Generator, Iterable, Iterator
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
from boxcal.detect.log.containers.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_FIELDS,
    CHUNK_INDEX,
    FOOTER,
    HEAD,
    HEAD_TYPE,
    LAST_OPCODE,
    LENGTH,
    MAGIC,
    MESSAGE,
    SCHEMA,
    STATISTICS,
    ChunkHead,
    beginning,
    chunk_head,
    held_data,
    is_chunk,
    records_in,
    text_in,
    whole_records,
)
from boxcal.detect.log.containers.mcap_salvage import next_record, summary_of
from boxcal.detect.log.containers.mcap_window import Window
from boxcal.detect.log.containers.packing import ERRORS, unpacked
from boxcal.detect.log.safe_text import printable
from boxcal.target.arrays import Ids

_RECORD_AND_HEAD = HEAD.size
_BODY_AT = HEAD_TYPE.itemsize
_MESSAGE_HEAD = np.arange(_BODY_AT)
_BLOCK = 1 << 20
_MAX_CHANNELS = 65_536


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
        walk = Window(self._file, self._size, self._passed)
        walk.skip(len(MAGIC))
        while True:
            at = walk.at
            head = walk.peek(_RECORD_AND_HEAD)
            if len(head) < _RECORD_AND_HEAD:
                self.damage.add(f"truncated at byte {self._size}")
                break
            opcode, length = HEAD.unpack(head)
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
            elif opcode > LAST_OPCODE and (body := self._chunk_by_another_name(walk, length)) is not None:
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
                opcode, length = HEAD.unpack_from(data, at)
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
        length = HEAD.unpack(head)[1] if len(head) == _RECORD_AND_HEAD else 0
        body = self._file.read(min(self._true_length.get(record, length), MAX_RECORD_BYTES))
        try:
            fields = chunk_head(body)
            return unpacked(held_data(body, fields), fields.compression, fields.size)
        except (struct.error, DetectError, *ERRORS):
            return beginning(body)

    def _is_chunk_at(self, record: int) -> bool:
        """Return whether a record is a chunk, of a file that was opened again."""
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
        length = HEAD.unpack(head)[1] if len(head) == _RECORD_AND_HEAD else 0
        return head + self._file.read(min(length, MAX_RECORD_BYTES))

    def _loose(self, walk: "Window") -> Iterator[list[Batch]]:
        """Yield messages that stand in no chunk, many at a time."""
        base = walk.at
        data = walk.peek(_BLOCK)
        end = whole_records(data)
        walk.skip(end)
        yield from self._content(memoryview(data)[:end], base, chunk=False)

    def _record(self, walk: "Window", at: int, opcode: int, length: int) -> Iterator[list[Batch]]:
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
            data = unpacked(held_data(body, fields), fields.compression, fields.size)
            if fields.crc and zlib.crc32(data) != fields.crc:
                raise DetectError("its checksum does not match")
        except (struct.error, DetectError, *ERRORS) as error:
            span = None if fields is None else (fields.start_ns, fields.end_ns)
            why = printable(str(error)[:200]) or type(error).__name__
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
        marks, problem = records_in(view, self._budget.messages_left + _MAX_CHANNELS)
        if problem and whole:
            self.damage.add(f"the {'chunk' if chunk else 'record'} at byte {at} is damaged inside: {problem}")
        yield self._batches_of(view, marks, at)

    def _batches_of(self, view: memoryview, marks: Ids, at: int) -> list[Batch]:
        """Return the messages among records in memory, a batch a channel; take schemas and channels."""
        memory = np.frombuffer(view, dtype=np.uint8)
        opcodes = memory[marks]
        for mark, opcode in zip(marks, opcodes, strict=True) if np.any(opcodes != MESSAGE) else ():
            if opcode in {SCHEMA, CHANNEL}:
                (length,) = LENGTH.unpack_from(view, mark + 1)
                self.describe(int(opcode), view[mark + _RECORD_AND_HEAD : mark + _RECORD_AND_HEAD + length])
        marks = marks[(opcodes == MESSAGE) & (marks <= len(view) - _BODY_AT)]
        heads = memory[marks[:, None] + _MESSAGE_HEAD].copy().view(HEAD_TYPE)[:, 0]
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
                name, at = text_in(body, 2)
                encoding, at = text_in(body, at)
                (length,) = struct.unpack_from("<I", body, at)
                text = bytes(body[at + 4 : at + 4 + length]) if length <= MAX_SCHEMA_BYTES else b""
                self._schemas[number] = (checked_name(name, "type"), encoding, text)
                return
            number, schema = struct.unpack_from("<HH", body)
            if number in self._channels or len(self._channels) >= _MAX_CHANNELS:
                return
            topic, at = text_in(body, 4)
            encoding, at = text_in(body, at)
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

    def _lost_place(self, walk: "Window", at: int, opcode: int, length: int) -> Generator[list[Batch], None, bool]:
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
                data = beginning(memoryview(walk.peek(min(walk.left, MAX_RECORD_BYTES)))[_RECORD_AND_HEAD:])
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

    def _chunk_by_another_name(self, walk: "Window", length: int) -> memoryview | None:
        """Return the content of a record that is a chunk in all but its opcode, else None."""
        if not CHUNK_FIELDS.size < length <= MAX_RECORD_BYTES:
            return None
        body = memoryview(walk.peek(_RECORD_AND_HEAD + length))[_RECORD_AND_HEAD:]
        return body if is_chunk(body) else None

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
            if is_chunk(body):
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


def _ends_whole(file: BinaryIO, size: int) -> bool:
    """Return whether a file ends as an MCAP that was closed does."""
    file.seek(max(size - len(MAGIC), 0))
    return file.read(len(MAGIC)) == MAGIC
