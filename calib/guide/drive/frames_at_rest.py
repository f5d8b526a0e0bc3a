"""Images of the current standstill as they came: those that a reader of the recording would look at, and few more."""

from typing import NamedTuple

import numpy as np

from boxcal.detect.log.containers.base import Channel
from boxcal.target.arrays import Ids

MOST_BYTES = 96 << 20
MOST_FRAMES = 40
"""Twice what a stop is measured from, so that every second one still leaves enough."""
BEFORE_NS = 1_500_000_000
"""Time before the newest image that is kept while the robot moves: a stand is noticed late."""


class HeldFrame(NamedTuple):
    """An image's message, undecoded.

    Attributes
    ----------
    t_ns : ns
        Its stamp on the wheels' clock.
    number
        Which image of the recording it is.
    channel, data
        The message.
    """

    t_ns: int
    number: int
    channel: Channel
    data: bytes


class FramesAtRest:
    """Holds the images of one stand, every second, fourth ... of the recording's when there are many."""

    def __init__(self) -> None:
        self._frames: dict[int, HeldFrame] = {}
        self._stride = 1
        self._from_ns = 0

    def add(self, frame: HeldFrame) -> None:
        """Hold an image; one of a stamp that is held already is a double and is left out."""
        if frame.t_ns in self._frames or frame.t_ns < self._from_ns or frame.number % self._stride:
            return
        self._frames[frame.t_ns] = frame
        while len(self._frames) > MOST_FRAMES or (len(self._frames) > 2 and self.size > MOST_BYTES):
            self._stride *= 2
            self._frames = {t: f for t, f in self._frames.items() if f.number % self._stride == 0}

    def forget_before(self, t_ns: int) -> None:
        """Let go of images before a time, ns: that of a new stand, or of the robot's moving."""
        self._from_ns = t_ns
        self._frames = {t: f for t, f in self._frames.items() if t >= t_ns}
        if len(self._frames) <= MOST_FRAMES // 4:
            self._stride = 1

    @property
    def size(self) -> int:
        """Bytes held."""
        return sum(len(f.data) for f in self._frames.values())

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest image, ns; 0 without one."""
        return max(self._frames, default=0)

    def any_between(self, first_ns: int, last_ns: int) -> bool:
        """Return whether an image of a time, ns, is held."""
        return any(first_ns <= t <= last_ns for t in self._frames)

    def of_stop(self, t_start_ns: int, t_end_ns: int, settle_s: float, most: int) -> list[HeldFrame]:
        """Return the images that a stop is measured from, as :func:`boxcal.detect.extract.frames_at` chooses them.

        Parameters
        ----------
        t_start_ns, t_end_ns : ns
            When the robot stood.
        settle_s : s
            Time at both ends that is left out if images remain.
        most
            Most images.
        """
        t = np.array(sorted(self._frames), dtype=np.int64)
        margin = round(settle_s * 1e9)
        chosen = _within(t, t_start_ns + margin, t_end_ns - margin)
        if chosen.size == 0:
            chosen = _within(t, t_start_ns, t_end_ns)
        numbers = np.array([self._frames[int(k)].number for k in chosen], dtype=np.int64)
        stride = self._stride
        while (kept := chosen[numbers % stride == 0]).size > most:
            stride *= 2
        kept = kept if kept.size else chosen[chosen.size // 2 :][:1]
        return [self._frames[int(k)] for k in kept]


def _within(t_ns: Ids, first: int, last: int) -> Ids:
    return t_ns[(t_ns >= first) & (t_ns <= last)]
