"""Wheel signals of a recording that belong together: those of both sides in one topic, or one topic a side."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from boxcal.detect.log.signals import Quantity, Signal
from boxcal.detect.log.wheel_names import SIDES, Side, wheel_side


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelGroup:
    """Signals of both sides that belong together.

    Attributes
    ----------
    right, left
        One signal a wheel.
    """

    right: tuple[Signal, ...]
    left: tuple[Signal, ...]

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics of the signals, each once."""
        return tuple(dict.fromkeys(s.topic for s in (*self.right, *self.left)))

    @property
    def quantity(self) -> Quantity:
        """Kind of the signals' numbers."""
        return self.right[0].quantity

    @property
    def moves(self) -> bool:
        """Whether any wheel moves."""
        return any(s.moves for s in self.right) or any(s.moves for s in self.left)

    @property
    def count(self) -> int:
        """Number of readings of the wheel that has fewest."""
        return min(s.count for s in (*self.right, *self.left))


def wheel_groups(signals: Mapping[str, Mapping[str, Signal]]) -> list[WheelGroup]:
    """Return the pairs of sides: in one topic, else over two."""
    out: list[WheelGroup] = []
    for quantity in Quantity:
        alone: dict[Side, list[Signal]] = {"right": [], "left": []}
        for of_topic in signals.values():
            found = {side: _of_side(of_topic.values(), side, quantity) for side in SIDES}
            if found["right"] and found["left"]:
                out.append(WheelGroup(right=found["right"], left=found["left"]))
            else:
                for side in SIDES:
                    alone[side] += found[side]
        if alone["right"] and alone["left"] and not any(g.quantity is quantity for g in out):
            out.append(WheelGroup(right=tuple(alone["right"]), left=tuple(alone["left"])))
    return out


def _of_side(of_topic: Iterable[Signal], side: Side, quantity: Quantity) -> tuple[Signal, ...]:
    """Return a topic's wheels of a side: those called wheels, else motors and tracks."""
    found = [s for s in of_topic if s.side == side and s.quantity is quantity and s.count]
    wheels = [s for s in found if s.quantity is not Quantity.POSITION or wheel_side(s.name)]
    return tuple(sorted(wheels or found, key=lambda s: s.name))
