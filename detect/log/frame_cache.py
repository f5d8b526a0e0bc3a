"""Keeps the frames that will be wanted again, those taken at rest, so that a recording is read only once.

Whether the robot rests is judged from the wheels as far as they were read: whatever they count, they hardly changed in
the last tenth of a second against what they change while it drives. A wrong guess costs time only: a frame that was not
kept is read from the recording again.
"""

import tempfile
from collections.abc import Iterable
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
_KEPT_A_STAND = 48
_MAX_BYTES = 1 << 30
_MAX_MEMORY = 48 << 20
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
    _size: int = 0
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
                stand.clear()
                continue
            stand.append(number)
            stride = 1
            while len(stand) // stride > _KEPT_A_STAND:
                stride *= 2
            if number % stride:
                continue
            for earlier, packet in self._group.get(key, ()):
                self._keep(key, earlier, packet)
            if series.is_video:
                self._group[key] = []
            else:
                self._keep(key, number, data)

    def close(self) -> None:
        """Close the temporary file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _remember(self, key: int, number: int, data: memoryview) -> None:
        """Hold a video's packets since its last picture that needs none before it: a frame needs all of them."""
        group = self._group.setdefault(key, [])
        if holds_key(data):
            group.clear()
        group.append((number, bytes(data)))
        if sum(len(packet) for _, packet in group) > _MAX_GROUP_BYTES:
            group.clear()

    def _keep(self, key: int, number: int, data: bytes | memoryview) -> None:
        if (key, number) in self.places or self._size + len(data) > _MAX_BYTES:
            return
        if self._size + len(data) <= _MAX_MEMORY:
            self._held[key, number] = bytes(data)
            self.places[key, number] = (-1, len(data))
        else:
            if self._file is None:
                self._file = tempfile.TemporaryFile()  # noqa: SIM115  (lives as long as the recording)
            place = self._file.seek(0, 2)
            self._file.write(data)
            self.places[key, number] = (place, len(data))
        self._size += len(data)

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
