"""The records of an MCAP file, one by one, with every size checked before memory is spent on it.

Records are parsed by the ``mcap`` library. The walk over them is our own because the library's readers trust the
sizes that a file claims (a chunk's, an attachment's, a message's), and because the place of each message is needed to
come back for the images: an index may be missing, or lie.

Format: the MCAP specification, https://mcap.dev/spec.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import printable

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 512 << 20
"""Largest record, and largest unpacked chunk, that is read (a raw image of 100 Mpx in colour fits)."""
MAX_MESSAGES = 200_000_000

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_READ = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.FOOTER}
_RECOVER = "recover what is there with `mcap recover`, or record again"


class Place(NamedTuple):
    """Where a message stands: its top-level record in the file, then (for a chunk) its offset in the unpacked data."""

    record: int
    inner: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """One message as it stands in the file."""

    channel: int
    log_ns: int
    data: memoryview
    place: Place


Record = Schema | Channel | Message


def walk(file: BinaryIO, name: str) -> Iterator[Record]:
    """Yield schemas, channels and messages in file order; everything else is skipped unread.

    Parameters
    ----------
    file
        Open for reading and seeking, at any position.
    name
        Of the file, for messages.

    Raises
    ------
    DetectError
        If the file is no MCAP, ends too early, or a record in it is damaged or claims an unreasonable size.
    """
    size = file.seek(0, 2)
    check_magic(file, name)
    at, messages = len(MAGIC), 0
    while True:
        opcode, body = _record(file, at, size, name)
        place, at = at, file.tell()
        if opcode == Opcode.FOOTER:
            break
        for record in _expand(opcode, body, place, name):
            messages += isinstance(record, Message)
            if messages > MAX_MESSAGES:
                raise DetectError(f"{name}: more than {MAX_MESSAGES} messages; record the camera and joints only")
            yield record
    if file.read(len(MAGIC)) != MAGIC:
        raise DetectError(f"{name}: truncated after its footer, the closing magic bytes are missing; {_RECOVER}")


def read_messages(file: BinaryIO, name: str, record: int) -> dict[int, Message]:
    """Return the messages of one top-level record (a chunk or a single message), by their offset in it.

    Raises
    ------
    DetectError
        As :func:`walk` does.
    """
    size = file.seek(0, 2)
    opcode, body = _record(file, record, size, name)
    return {r.place.inner: r for r in _expand(opcode, body, record, name) if isinstance(r, Message)}


def check_magic(file: BinaryIO, name: str) -> None:
    """Refuse a file that does not begin as an MCAP does, naming what it is where that shows."""
    file.seek(0)
    start = file.read(16)
    if start[: len(MAGIC)] == MAGIC:
        return
    if start.startswith(b"#ROSBAG"):
        found, remedy = "a ROS 1 bag", "convert it with `rosbags-convert --src in.bag --dst out --dst-storage mcap`"
    elif start.startswith(b"SQLite format 3"):
        found = "a ROS 2 bag in sqlite3 storage (.db3)"
        remedy = "convert its folder with `rosbags-convert --src in --dst out --dst-storage mcap`"
    elif not start:
        found, remedy = "an empty file", "record again"
    elif MAGIC.startswith(start):
        found, remedy = "an MCAP truncated in its first bytes", "record again"
    else:
        found, remedy = f"not an MCAP (begins with {start[:8].hex(' ')})", "record with `ros2 bag record -s mcap`"
    raise DetectError(f"{name}: {found}, an MCAP file is needed; {remedy}")


def _record(file: BinaryIO, at: int, size: int, name: str) -> tuple[int, bytes]:
    """Return opcode and content of the record at an offset; the content of a record of no interest is empty."""
    file.seek(at)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        raise DetectError(f"{name}: truncated at byte {size}, between two records; {_RECOVER}")
    opcode, length = _HEAD.unpack(head)
    if length > size - at - _HEAD.size:
        raise DetectError(
            f"{name}: truncated or damaged: the record at byte {at} claims {length} bytes, the file has "
            f"{size - at - _HEAD.size} more; {_RECOVER}"
        )
    if opcode not in _READ:
        file.seek(length, 1)
        return opcode, b""
    if length > MAX_RECORD_BYTES:
        raise DetectError(f"{name}: the record at byte {at} claims {length} bytes, at most {MAX_RECORD_BYTES} are read")
    return opcode, file.read(length)


def _expand(opcode: int, body: bytes, at: int, name: str) -> Iterator[Record]:
    try:
        if opcode == Opcode.CHUNK:
            data = _unpack(Chunk.read(ReadDataStream(BytesIO(body))))
            yield from _inside(data, at)
        elif opcode in _READ:
            record = _parse(opcode, memoryview(body), Place(at, -1))
            if record is not None:
                yield record
    except DetectError as error:
        raise DetectError(f"{name}: the record at byte {at} is damaged: {error}; {_RECOVER}") from error
    except (McapError, struct.error, ValueError, EOFError, RuntimeError, zstandard.ZstdError, MemoryError) as error:
        raise DetectError(
            f"{name}: the record at byte {at} is damaged ({type(error).__name__}: {printable(str(error))}); {_RECOVER}"
        ) from error


def _inside(data: bytes, at: int) -> Iterator[Record]:
    view, inner = memoryview(data), 0
    while inner < len(view):
        opcode, length = _HEAD.unpack_from(view, inner)
        start = inner + _HEAD.size
        if length > len(view) - start:
            raise DetectError(f"a record in its chunk claims {length} bytes, the chunk has {len(view) - start} more")
        record = _parse(opcode, view[start : start + length], Place(at, inner))
        if record is not None:
            yield record
        inner = start + length


def _parse(opcode: int, body: memoryview, place: Place) -> Record | None:
    if opcode == Opcode.MESSAGE:
        channel, _, log_ns, _ = _MESSAGE.unpack_from(body)
        return Message(channel=channel, log_ns=log_ns, data=body[_MESSAGE.size :], place=place)
    record: Record | None = None
    if opcode == Opcode.SCHEMA:
        record = Schema.read(ReadDataStream(BytesIO(body)))
    elif opcode == Opcode.CHANNEL:
        record = Channel.read(ReadDataStream(BytesIO(body)))
    return record


def _unpack(chunk: Chunk) -> bytes:
    """Return a chunk's data, never more than it claims, which is never more than the bound."""
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise DetectError(f"its chunk claims to unpack to {size} bytes, at most {MAX_RECORD_BYTES} are read")
    if chunk.compression == "zstd":
        stream = zstandard.ZstdDecompressor().stream_reader(chunk.data, read_across_frames=True)
        data = stream.read(size + 1) if size else b""
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1) if size else b""
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise DetectError(f"its chunk is compressed with {printable(chunk.compression)!r}, zstd and lz4 are read")
    if len(data) != size:
        found = f"more than {size}" if len(data) > size else f"{len(data)}"
        raise DetectError(f"its chunk claims to unpack to {size} bytes and unpacks to {found}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise DetectError("its chunk's checksum does not match")
    return bytes(data)
