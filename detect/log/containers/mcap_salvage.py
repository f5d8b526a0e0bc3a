"""Salvage of damaged MCAP files: their summary, and where records go on behind a lost place."""

import struct
from collections.abc import Iterator
from typing import BinaryIO, Protocol

import numpy as np

_HEAD = struct.Struct("<BQ")
_FOOTER_BYTES = 9 + 20 + 8
_MAX_SUMMARY_BYTES = 32 << 20
_OPCODES = 15
_CHAIN = 3
"""So many records must follow each other before a place counts as found."""
_BLOCK = 1 << 20
_MAX_LENGTH = 1 << 28
_MAGIC = b"\x89MCAP0\r\n"


class Walk(Protocol):
    """A place in a file, with a look ahead."""

    at: int

    def peek(self, count: int) -> bytes:
        """Return the next bytes without passing them."""

    def skip(self, count: int) -> None:
        """Pass bytes."""


def summary_of(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of the records of a file's summary; nothing if it has none or it is damaged."""
    if size < _FOOTER_BYTES + 8:
        return
    file.seek(size - _FOOTER_BYTES)
    footer = file.read(_FOOTER_BYTES)
    opcode, length = _HEAD.unpack_from(footer)
    if opcode != 2 or length != 20 or not footer.endswith(_MAGIC):
        return
    (start,) = struct.unpack_from("<Q", footer, _HEAD.size)
    if not 8 < start < size - _FOOTER_BYTES or size - start > _MAX_SUMMARY_BYTES:
        return
    file.seek(start)
    data, at = file.read(size - _FOOTER_BYTES - start), 0
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        stop = at + _HEAD.size + length
        if stop > len(data):
            return
        yield opcode, data[at + _HEAD.size : stop]
        at = stop


def next_record(walk: Walk, size: int) -> int | None:
    """Return where records go on behind the walk's place, None if nowhere; the walk goes there or to the end."""
    first = True
    while True:
        data = walk.peek(_BLOCK)
        if len(data) < _HEAD.size + 1:
            return None
        for at in _candidates(data):
            if at == 0 and first:
                continue
            if _chain(data, int(at), walk.at, size):
                return walk.at + int(at)
        if len(data) < _BLOCK:
            return None
        first = False
        walk.skip(len(data) - _HEAD.size)


def _candidates(data: bytes) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Return the offsets at which a record's head can stand: a known opcode and a length below the largest."""
    values = np.frombuffer(data, dtype=np.uint8)
    n = len(values) - _HEAD.size + 1
    fits = (values[:n] >= 1) & (values[:n] <= _OPCODES)
    for byte in range(5, _HEAD.size):  # little endian: what is above 2^28 to 2^32 must be zero
        fits &= values[byte : byte + n] == 0
    return np.flatnonzero(fits)


def _chain(data: bytes, at: int, base: int, size: int) -> bool:
    """Return whether some records follow each other from an offset on, as far as the memory reaches."""
    for _ in range(_CHAIN):
        if base + at == size - len(_MAGIC):
            return True
        if at + _HEAD.size > len(data):
            return base + len(data) < size
        opcode, length = _HEAD.unpack_from(data, at)
        if not 1 <= opcode <= _OPCODES or length > _MAX_LENGTH or base + at + _HEAD.size + length > size:
            return False
        at += _HEAD.size + length
    return True
