"""An MCAP file that another program is still writing, read as far as it has got."""

import struct
from collections.abc import Iterator
from typing import BinaryIO

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import MAX_RECORD_BYTES, Batch
from boxcal.detect.log.containers.mcap import McapFile
from boxcal.detect.log.containers.mcap_records import CHANNEL, CHUNK, FOOTER, MAGIC, MESSAGE, SCHEMA

_HEAD = struct.Struct("<BQ")
_AT_ONCE = 32 << 20
"""Bytes read in one go, so that a long file that is opened late does not fill the memory."""


class GrowingMcap(McapFile):
    """An MCAP file read piece by piece while it grows.

    A record that is not whole yet is waited for; a chunk that is damaged is passed over as in a finished file.

    Parameters
    ----------
    file
        Open for reading, without a buffer of its own.
    name
        Of the file, for messages.
    """

    def __init__(self, file: BinaryIO, name: str) -> None:
        super().__init__(file, name, "")
        self._at = len(MAGIC)
        self.finished = False

    def grown(self) -> Iterator[list[Batch]]:
        """Yield the messages that have come since the last call, at most some 32 MB at a time.

        Raises
        ------
        DetectError
            If the file became shorter, is no MCAP, or claims a record too large to read.
        """
        self._size = self._file.seek(0, 2)
        if self._size < self._at:
            if self._at == len(MAGIC):
                return
            raise DetectError("became shorter while it was read", source=self.name, remedy="start again")
        self._budget.size = self._size
        self._file.seek(0)
        if self._file.read(len(MAGIC)) != MAGIC:
            raise DetectError("not an MCAP", source=self.name, remedy="record with `ros2 bag record -s mcap`")
        end = min(self._size, self._at + _AT_ONCE)
        while not self.finished and self._at < end:
            self._file.seek(self._at)
            head = self._file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return
            opcode, length = _HEAD.unpack(head)
            if opcode == FOOTER:
                self.finished = True
                return
            if length > MAX_RECORD_BYTES:
                raise DetectError(
                    f"the record at byte {self._at} claims {length} bytes, at most {MAX_RECORD_BYTES} are read",
                    source=self.name,
                    remedy="record with smaller chunks",
                )
            if self._at + _HEAD.size + length > self._size:
                return
            at, self._at = self._at, self._at + _HEAD.size + length
            if opcode == CHUNK:
                yield from self._chunk(self._file.read(length), at)
            elif opcode in {MESSAGE, SCHEMA, CHANNEL}:
                yield from self._content(memoryview(head + self._file.read(length)), at, chunk=False)
