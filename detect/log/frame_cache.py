"""Keeps the frames that will be wanted again, those taken at rest, so that a recording is read only once.

Whether the robot rests is judged from the wheels as far as they were read: whatever they count, they hardly changed in
the last tenth of a second against what they change while it drives. A wrong guess costs time only: a frame that was not
kept is read from the recording again.
"""

import shutil
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import IO

import numpy as np

from boxcal.detect.log.images import ImageSeries
from boxcal.detect.log.signals import Quantity, Signal
from boxcal.detect.log.video import holds_key
from boxcal.target.arrays import Ids, Mask

_LOOK_BACK_NS = 100_000_000
_AT_REST = 0.06
"""Part of the largest change in a look back that still is rest."""
_KEPT_A_STAND = 32
"""More than are looked at of a stop (20), as its ends are left out; of more, every second, fourth ... is kept."""
_MAX_BYTES = 8 << 30
_MAX_DISK = 0.5
"""Largest part of the temporary folder's free space that is taken."""
_MAX_MEMORY = 16 << 20
_MAX_STAND = 16 << 20
_MAX_GROUP_BYTES = 32 << 20


@dataclass(slots=True, kw_only=True)
class FrameCache:
    """Messages of frames that were taken at rest, the first in memory, the rest in a temporary file.

    Attributes
    ----------
    places
        By series (its identity) and number of the frame in it: where it lies in the file (-1: in memory), and its
        length.
    read_back
        Bytes that were read from the temporary file.
    """

    places: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    read_back: int = 0
    _held: dict[tuple[int, int], bytes] = field(default_factory=dict)
    _file: "IO[bytes] | None" = None
    _most: int = 0
    _in_memory: int = 0
    _largest: dict[int, float] = field(default_factory=dict)
    _stand: dict[int, list[int]] = field(default_factory=dict)
    _group: dict[int, list[tuple[int, bytes]]] = field(default_factory=dict)

    def offer(self, series: ImageSeries, first: int, frames: list[memoryview], rests: Mask) -> None:
        """Keep those of some frames that were taken at rest, unless too many of their stand are kept already.

        Parameters
        ----------
        series
            What they belong to.
        first
            Number of the first of them in it.
        frames
            Their messages, in order.
        rests : (N,) bool
            Whether the robot rested (:meth:`resting`).
        """
        key = id(series)
        stand = self._stand.setdefault(key, [])
        for number, (data, rest) in enumerate(zip(frames, rests.tolist(), strict=True), first):
            if series.is_video:
                self._remember(key, number, data)
            if not rest:
                self._put_away(key, stand)
                continue
            stand.append(number)
            stride = _stride(len(stand))
            if series.is_video:
                if number % stride == 0:
                    for earlier, packet in self._group.get(key, ()):
                        self._keep(key, earlier, packet, _MAX_MEMORY)
                    self._group[key] = []
                continue
            if len(stand) > 1 and stride > _stride(len(stand) - 1):
                for _ in self._let_go(key, [n for n in stand if n % stride]):
                    pass  # of so long a stand fewer will be looked at
            if number % stride == 0:
                self._keep(key, number, data, _MAX_MEMORY + _MAX_STAND)

    def close(self) -> None:
        """Close the temporary file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _remember(self, key: int, number: int, data: memoryview) -> None:
        """Hold a video's packets since its last image that needs none before it: a frame needs all of them."""
        group = self._group.setdefault(key, [])
        if holds_key(data):
            group.clear()
        group.append((number, bytes(data)))
        if sum(len(packet) for _, packet in group) > _MAX_GROUP_BYTES:
            group.clear()

    def _keep(self, key: int, number: int, data: bytes | memoryview, most: int) -> None:
        """Keep a frame: in memory while what is there stays below ``most`` bytes, else in the temporary file."""
        if (key, number) in self.places:
            return
        if self._in_memory + len(data) > most:
            self._write(key, number, data)
            return
        self._held[key, number] = bytes(data)
        self._in_memory += len(data)
        self.places[key, number] = (-1, len(data))

    def _write(self, key: int, number: int, data: bytes | memoryview) -> None:
        if self._file is None:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115  (lives as long as the recording)
            self._most = min(_MAX_BYTES, int(_MAX_DISK * shutil.disk_usage(tempfile.gettempdir()).free))
        place = self._file.seek(0, 2)
        if place + len(data) > self._most:
            return
        self._file.write(data)
        self.places[key, number] = (place, len(data))

    def _let_go(self, key: int, numbers: Iterable[int]) -> Iterator[tuple[int, bytes]]:
        """Yield those of some frames that are in memory, which leave it."""
        for number in numbers:
            data = self._held.pop((key, number), None)
            if data is not None:
                self._in_memory -= len(data)
                del self.places[key, number]
                yield number, data

    def _put_away(self, key: int, stand: list[int]) -> None:
        """Write the frames of a stand that is over to the file where memory holds enough of them already."""
        if self._in_memory > _MAX_MEMORY:
            for number, data in self._let_go(key, stand):
                self._write(key, number, data)
        stand.clear()

    def get(self, series: ImageSeries, number: int) -> bytes | None:
        """Return the message of a frame that was kept, else None."""
        found = self.places.get((id(series), number))
        if found is None:
            return None
        if found[0] < 0 or self._file is None:
            return self._held.get((id(series), number))
        self._file.seek(found[0])
        self.read_back += found[1]
        return self._file.read(found[1])

    def resting(self, stamps_ns: Ids, wheels: Iterable[Signal]) -> Mask:
        """Return whether the robot seems to rest at some times, (N,) bool; it does not where nothing is known."""
        known, rests = np.zeros(stamps_ns.size, dtype=np.bool_), np.ones(stamps_ns.size, dtype=np.bool_)
        for signal in wheels:
            if signal.low == signal.high:
                continue  # it tells nothing
            t_ns, values = signal.tail()
            now = np.searchsorted(t_ns, stamps_ns, side="right") - 1
            before = np.maximum(np.searchsorted(t_ns, stamps_ns - _LOOK_BACK_NS, side="right") - 1, 0)
            seen = now >= 0
            if signal.quantity is Quantity.VELOCITY:
                change, usual = np.abs(values[now]), 0.0
            else:
                change, usual = np.abs(values[now] - values[before]), signal.fastest * _LOOK_BACK_NS
            most = float(np.max(change[seen], initial=0.0))
            largest = self._largest[id(signal)] = max(self._largest.get(id(signal), 0.0), most, usual)
            known |= seen
            rests &= ~seen | (change <= _AT_REST * largest)
        return known & rests


def _stride(frames: int) -> int:
    """Return which of so many frames of a stand are kept: every one, every second, every fourth ..."""
    stride = 1
    while frames // stride > _KEPT_A_STAND:
        stride *= 2
    return stride
