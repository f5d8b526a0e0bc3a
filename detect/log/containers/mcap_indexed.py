"""MCAP files behind URLs: by summary and chunk index only what is wanted is fetched.

First the chunks that hold wheels and what the recording says of the robot, and one of each image topic; then, when it
is known when the robot stood, the chunks with images of those times. Chunks are the smallest piece: they are compressed
as one, and messages lie too close to each other to be fetched alone.
"""

import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import BinaryIO, cast

from boxcal.detect.log.containers.base import Batch, Channel
from boxcal.detect.log.containers.mcap import McapFile
from boxcal.detect.log.containers.mcap_records import CHANNEL, CHUNK, CHUNK_INDEX, SCHEMA, STATISTICS
from boxcal.detect.log.containers.mcap_salvage import summary_of
from boxcal.detect.log.remote.range_file import RangeFile
from boxcal.target.arrays import Ids

_HEAD = struct.Struct("<BQ")
_INDEX = struct.Struct("<QQQQ")
_PAIR = struct.Struct("<HQ")
_TAIL = 32 << 10
_MOST = 0.85
"""Where more than this part of a file is wanted it is read from front to end, with all that this can put right."""


class Wanted(Enum):
    """Uses of a channel's messages."""

    FIRST = "needed from front to end"
    IMAGES = "needed where the robot stands"
    NOTHING = "not needed"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Chunk:
    start_ns: int
    end_ns: int
    at: int
    end: int
    channels: frozenset[int]


class IndexedMcap(McapFile):
    """An MCAP file behind a URL with an index of its chunks, open for reading."""

    def __init__(self, file: RangeFile, name: str, digest: str | None = None) -> None:
        super().__init__(cast("BinaryIO", file), name, digest)
        self._range = file
        file.prefetch([(self._size - _TAIL, self._size)])
        self._chunks: list[_Chunk] = []
        self._claimed: dict[int, int] = {}
        for opcode, body in summary_of(self._file, self._size):
            view = memoryview(body)
            if opcode in {SCHEMA, CHANNEL}:
                self.describe(opcode, view)
            elif opcode == CHUNK_INDEX and (found := _chunk(view, self._size)) is not None:
                self._chunks.append(found)
            elif opcode == STATISTICS and len(view) >= 42:
                (length,) = struct.unpack_from("<I", view, 42)
                pairs = view[46 : 46 + length]
                self._claimed = dict(_PAIR.iter_unpack(pairs[: len(pairs) // _PAIR.size * _PAIR.size]))
        self._chunks.sort(key=lambda c: c.at)
        self._fetched: set[int] = set()
        self._wanted: Callable[[Channel], Wanted] | None = None

    @property
    def has_index(self) -> bool:
        """Whether the file's summary names its chunks and what is in them."""
        return bool(self._chunks) and all(c.channels for c in self._chunks) and bool(self._channels)

    def image_counts(self, wanted: Callable[[Channel], Wanted]) -> dict[str, int]:
        """Return the number of messages of each image topic, by the file's statistics."""
        counts: dict[str, int] = {}
        for number, channel in self._channels.items():
            if wanted(channel) is Wanted.IMAGES:
                counts[channel.topic] = counts.get(channel.topic, 0) + self._claimed.get(number, 0)
        return counts

    def wanted_batches(self, wanted: Callable[[Channel], Wanted]) -> Iterator[list[Batch]]:
        """Yield the messages of the chunks that are needed in any case; of all where that is nearly the whole file.

        Parameters
        ----------
        wanted
            What a channel is for.
        """
        use = {number: wanted(channel) for number, channel in self._channels.items()}
        first = {number for number, what in use.items() if what is Wanted.FIRST}
        chosen = [c for c in self._chunks if c.channels & first]
        for number in (n for n, what in use.items() if what is Wanted.IMAGES):
            chosen += [c for c in self._chunks if number in c.channels][:1]
        if sum(c.end - c.at for c in set(chosen)) > _MOST * self._size:
            self._fetched.update(c.at for c in self._chunks)
            yield from self.batches()
            return
        yield from self._of(chosen)

    def batches_at(self, topic: str, windows_ns: Ids) -> Iterator[list[Batch]]:
        """Yield the messages of the chunks with a topic's images that were recorded within windows (W, 2), ns."""
        numbers = {number for number, channel in self._channels.items() if channel.topic == topic}
        chosen = [
            c
            for c in self._chunks
            if c.channels & numbers and any(c.start_ns <= b and c.end_ns >= a for a, b in windows_ns.tolist())
        ]
        yield from self._of(chosen)

    def _of(self, chunks: Iterable[_Chunk]) -> Iterator[list[Batch]]:
        todo = sorted({c for c in chunks if c.at not in self._fetched}, key=lambda c: c.at)
        self._fetched.update(c.at for c in todo)
        self._range.prefetch((c.at, c.end) for c in todo)
        for c in todo:
            self._file.seek(c.at)
            record = memoryview(self._file.read(c.end - c.at))
            if record[0] != CHUNK or _HEAD.unpack_from(record)[1] != len(record) - _HEAD.size:
                self.damage.add(f"no chunk stands at byte {c.at}, where the file's index names one")
                continue
            yield from self._chunk(record[_HEAD.size :], c.at)

    def sha256(self) -> str:
        """Return the file's tag and size, which stand for its hash; DetectError if it changed while it was read."""
        self._range.refuse_change()
        return self._range.state.identity


def _chunk(body: memoryview, size: int) -> _Chunk | None:
    """Return what an entry of the chunk index says; None if it cannot be true."""
    try:
        start_ns, end_ns, at, length = _INDEX.unpack_from(body)
        (count,) = struct.unpack_from("<I", body, _INDEX.size)
    except struct.error:
        return None
    pairs = body[_INDEX.size + 4 : _INDEX.size + 4 + count]
    if len(pairs) != count or count % _PAIR.size or not 8 <= at < at + length <= size or length <= _HEAD.size:
        return None
    channels = frozenset(number for number, _ in _PAIR.iter_unpack(pairs))
    return _Chunk(start_ns=start_ns, end_ns=end_ns, at=at, end=at + length, channels=channels)
