"""Records of MCAP files: their heads, chunks and texts, with every size checked.

Format: the MCAP specification, https://mcap.dev/spec.
"""

import struct
import zlib
from typing import NamedTuple

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.packing import ERRORS, unpacked, unpacked_beginning
from boxcal.target.arrays import Ids

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS = 2, 3, 4, 5, 6, 8, 11
LAST_OPCODE = 15

HEAD = struct.Struct("<BQ")
LENGTH = struct.Struct("<Q")
HEAD_TYPE = np.dtype(
    [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("seq", "<u4"), ("log", "<u8"), ("pub", "<u8")]
)
CHUNK_FIELDS = struct.Struct("<QQQII")

_RECORD_AND_HEAD = HEAD.size


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
    start, end, size, crc, length = CHUNK_FIELDS.unpack_from(body)
    if length > 16:
        raise ValueError(f"a compression of {length} characters")
    at = CHUNK_FIELDS.size + length
    compression = bytes(body[CHUNK_FIELDS.size : at]).decode()
    (held,) = struct.unpack_from("<Q", body, at)
    if held > len(body) - at - 8:
        raise ValueError(f"{held} bytes of data claimed, {len(body) - at - 8} are there")
    return ChunkHead(start, end, size, crc, compression, at + 8)


def held_data(body: bytes | memoryview, fields: ChunkHead) -> memoryview:
    """Return the compressed data of a chunk record."""
    (count,) = struct.unpack_from("<Q", body, fields.data_at - 8)
    return memoryview(body)[fields.data_at : fields.data_at + count]


def is_chunk(body: memoryview) -> bool:
    """Return whether a record's content is a chunk with a right checksum."""
    try:
        fields = chunk_head(body)
        data = unpacked(held_data(body, fields), fields.compression, fields.size)
    except (struct.error, DetectError, *ERRORS):
        return False
    return bool(fields.crc) and zlib.crc32(data) == fields.crc


def beginning(body: bytes | memoryview) -> bytes:
    """Return what the data of a chunk record that was cut off unpacks to, as far as it is there."""
    try:
        _, _, size, _, length = CHUNK_FIELDS.unpack_from(body)
        at = CHUNK_FIELDS.size + length
        compression = bytes(body[CHUNK_FIELDS.size : at]).decode()
    except (struct.error, ValueError):
        return b""
    return unpacked_beginning(memoryview(body)[at + 8 :], compression, size)


def text_in(body: memoryview, at: int) -> tuple[str, int]:
    """Return the text that stands at an offset, behind its length, and where it ends."""
    (length,) = struct.unpack_from("<I", body, at)
    if length > len(body) - at - 4:
        raise ValueError(f"a text of {length} bytes")
    end = at + 4 + length
    return bytes(body[at + 4 : end]).decode(), end


def whole_records(data: bytes | memoryview) -> int:
    """Return where the last of the loose records that are whole in some memory ends."""
    at = 0
    while at + _RECORD_AND_HEAD <= len(data):
        opcode, length = HEAD.unpack_from(data, at)
        stop = at + _RECORD_AND_HEAD + length
        if opcode not in {MESSAGE, SCHEMA, CHANNEL} or stop > len(data):
            break
        at = stop
    return at


def records_in(view: memoryview, most: int) -> tuple[Ids, str]:
    """Return where the first records in memory begin, one behind the other, and what is wrong behind the last."""
    at, end, unpack = 0, len(view), LENGTH.unpack_from
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
