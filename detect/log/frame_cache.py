"""Keeps the frames that will be wanted again, those taken at rest, so that a recording is read only once.

Whether the robot rests is told from the wheels as far as they were read: whatever they count, they hardly changed in
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

_LOOK_BACK_NS = 100_000_000
_AT_REST = 0.06
"""Part of the largest change in a look back that still is rest."""
_KEPT_A_STAND = 48
_MAX_BYTES = 1 << 30
_MAX_GROUP_BYTES = 32 << 20


@dataclass(slots=True, kw_only=True)
class FrameCache:
    """Messages of frames that were taken at rest, in a temporary file.

    Attributes
    ----------
    places
        By series (its identity) and number of the frame in it: where it lies in the file, and its length.
    """

    places: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    _file: "IO[bytes] | None" = None
    _size: int = 0
    _largest: dict[int, float] = field(default_factory=dict)
    _stand: dict[int, list[int]] = field(default_factory=dict)
    _group: dict[int, list[tuple[int, bytes]]] = field(default_factory=dict)

    def offer(
        self, series: ImageSeries, number: int, stamp_ns: int, data: memoryview, wheels: Iterable[Signal]
    ) -> None:
        """Keep a frame if the robot seems to rest, and too many of this stand are not kept yet."""
        key = id(series)
        if series.is_video:
            self._remember(key, number, data)
        if not self._rests(stamp_ns, wheels):
            self._stand[key] = []
            return
        stand = self._stand.setdefault(key, [])
        stride = 1
        while len(stand) // stride > _KEPT_A_STAND:
            stride *= 2
        stand.append(number)
        if number % stride:
            return
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
        if self._file is None:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115  (lives as long as the recording)
        self._file.seek(self._size)
        self._file.write(data)
        self.places[key, number] = (self._size, len(data))
        self._size += len(data)

    def get(self, series: ImageSeries, number: int) -> bytes | None:
        """Return the message of a frame that was kept, else None."""
        found = self.places.get((id(series), number))
        if found is None or self._file is None:
            return None
        self._file.seek(found[0])
        return self._file.read(found[1])

    def _rests(self, stamp_ns: int, wheels: Iterable[Signal]) -> bool:
        known = False
        for signal in wheels:
            t_ns, values = signal.tail()
            now = int(np.searchsorted(t_ns, stamp_ns, side="right")) - 1
            before = int(np.searchsorted(t_ns, stamp_ns - _LOOK_BACK_NS, side="right")) - 1
            if now < 0:
                continue
            known = True
            if signal.quantity is Quantity.VELOCITY:
                change = abs(float(values[now]))
            else:
                change = float(np.ptp(values[max(before, 0) : now + 1]))
            usual = signal.fastest * _LOOK_BACK_NS if signal.quantity is not Quantity.VELOCITY else 0.0
            largest = self._largest[id(signal)] = max(self._largest.get(id(signal), 0.0), change, usual)
            if change > _AT_REST * largest and change > 0:
                return False
        return known
