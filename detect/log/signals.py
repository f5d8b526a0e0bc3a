"""Candidate wheel signals of a recording: numbers over time, before the wheels are chosen."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from boxcal.detect.log.wheel_names import Side
from boxcal.target.arrays import Array, Ids

_LARGEST = 1e15
"""Readings beyond this (rad, rad/s or ticks) are damage: a double holds no tenth of a unit there."""
LATEST_NS = 1 << 62
"""Times beyond this, ns (the year 2116), are damage: differences of two must not overflow."""
_MANY = 64
"""So many pieces are joined for good: a live drive asks for all its readings several times a second."""
_FEW = 4
"""Fewer readings in a piece do not determine its usual speed."""


class Quantity(StrEnum):
    """Kinds of numbers that a signal may hold."""

    POSITION = "positions"
    VELOCITY = "velocities"
    TICKS = "ticks"
    ODOMETRY = "odometry"


@dataclass(slots=True, kw_only=True, eq=False)
class Signal:
    """Numbers of one joint or field of a topic over time; it grows while a recording is read.

    Attributes
    ----------
    topic, name
        Where they come from: topic, and joint or field.
    quantity
        What they are.
    side
        The wheel that the name or the message type says; None if neither does.
    ticks_per_turn
        Of a wheel, where the message type says; None if it does not.
    fastest
        Mean change in a nanosecond in the fastest piece.
    stamped
        Whether the messages carry times; else those of recording are taken.
    dropped
        How many readings were left out: no numbers, or numbers or times beyond all measure.
    dropped_first
        How many of them came before the first that was not.
    """

    topic: str
    name: str
    quantity: Quantity
    side: Side | None = None
    ticks_per_turn: float | None = None
    stamped: bool = True
    dropped: int = 0
    dropped_first: int = 0
    _t: list[Ids] = field(default_factory=list)
    _log: list[Ids] = field(default_factory=list)
    _values: list[Array] = field(default_factory=list)
    _tail: tuple[int, Ids, Array] | None = None
    count: int = 0
    fastest: float = 0.0
    low: float = np.inf
    high: float = -np.inf

    def add(self, t_ns: Ids, log_ns: Ids, values: Array) -> None:
        """Take readings: stamps (N,) ns, times of recording (N,) ns, values (N,); what is no number is left out."""
        good = (np.abs(values) < _LARGEST) & (t_ns > -LATEST_NS) & (t_ns < LATEST_NS)  # NaN is neither
        if log_ns.size and max(int(log_ns.max()), -int(log_ns.min())) > LATEST_NS:
            log_ns = np.clip(log_ns, -LATEST_NS, LATEST_NS)  # else the arrays of a message's joints stay one
        if not np.all(good):
            self.dropped += int(np.sum(~good))
            if not self.count:
                self.dropped_first += int(np.argmax(good)) if np.any(good) else good.size
            t_ns, log_ns, values = t_ns[good], log_ns[good], values[good]
        if not values.size:
            return
        self._t.append(t_ns)
        self._log.append(log_ns)
        self._values.append(values)
        self.count += int(values.size)
        if values.size > _FEW:
            travel, time = float(np.sum(np.abs(np.diff(values)))), int(t_ns[-1] - t_ns[0])
            self.fastest = max(self.fastest, travel / time if time > 0 else 0.0)
        self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))

    @property
    def moves(self) -> bool:
        """Whether the numbers ever change; a velocity that is never anything but zero does not."""
        return self.high > self.low or (self.quantity is Quantity.VELOCITY and self.count > 0 and self.low != 0)

    @property
    def t_ns(self) -> Ids:
        """Header stamps in order of arrival, (N,) ns."""
        return np.asarray(_joined(self._t, np.int64), dtype=np.int64)

    @property
    def log_ns(self) -> Ids:
        """Times of recording, (N,) ns."""
        return np.asarray(_joined(self._log, np.int64), dtype=np.int64)

    @property
    def values(self) -> Array:
        """The numbers, (N,)."""
        return np.asarray(_joined(self._values, np.float64), dtype=np.float64)

    def forget(self) -> None:
        """Let go of the readings, which are wanted no more; what is known of them all stays."""
        self._t, self._log, self._values, self._tail = [], [], [], None

    def tail(self) -> tuple[Ids, Array]:
        """Return stamps and values of the last piece or two, for what is decided while reading."""
        if self._tail is None or self._tail[0] != self.count:
            t_ns, values = _joined(self._t[-2:], np.int64), _joined(self._values[-2:], np.float64)
            self._tail = (self.count, t_ns, values)
        return self._tail[1:]


@dataclass(slots=True, kw_only=True, eq=False)
class OdometrySignal:
    """Poses of one odometry topic over time.

    Attributes
    ----------
    topic
        Its name.
    t_ns, log_ns : ns
        Stamps and times of recording.
    poses
        x, y (m) and heading (rad), not unwrapped.
    base_frame
        The frame whose pose it is.
    """

    topic: str
    base_frame: str = ""
    t_ns: list[int] = field(default_factory=list)
    log_ns: list[int] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)

    @property
    def moves(self) -> bool:
        """Whether the pose ever changes."""
        return len(self.poses) > 1 and bool(np.any(np.ptp(np.array(self.poses), axis=0) > 0))


def _joined(parts: list[Any], kind: type) -> Any:
    """Return the pieces as one array; many are kept as one and the last two, so that a live drive joins each once."""
    if len(parts) > _MANY:
        before = len(parts) - 2
        parts[:before] = [np.concatenate(parts[:before])]
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=kind)
