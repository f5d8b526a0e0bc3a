"""Wheel signals that the user named, or one of them, and what the names say of the other."""

from collections.abc import Mapping, Sequence

from boxcal.detect.errors import DetectError
from boxcal.detect.log.no_wheels import NAME_WHEELS, without_readings
from boxcal.detect.log.safe_text import listed, printable, suggestion
from boxcal.detect.log.signals import Quantity, Signal
from boxcal.detect.log.topics import Topics, named_field
from boxcal.detect.log.wheel_groups import WheelGroup
from boxcal.detect.log.wheel_names import Side


def named_wheels(name: str, signals: Mapping[str, Mapping[str, Signal]], topics: Topics) -> WheelGroup:
    """Return the wheels that the user named, or the one that was named and what the names say of the other.

    Parameters
    ----------
    name
        Of the recording, for messages.
    signals
        By topic and joint or field.
    topics
        What the user named.

    Raises
    ------
    DetectError
        If a named joint is not there, may be several, or neither wheel ever moves.
    """
    chosen: dict[Side, tuple[Signal, ...]] = {}
    every = sorted({s.name for of in signals.values() for s in of.values()})
    for side, wanted in (("left", topics.left_joint), ("right", topics.right_joint)):
        found: list[Signal] = []
        for topic, of_topic in signals.items():
            path = "" if wanted is None else named_field(wanted, topic)
            found += [
                s
                for s in of_topic.values()
                if (s.name in {wanted, path} if wanted is not None else s.side == side) and s.name
            ]
        if wanted is not None and not found:
            raise DetectError(
                f"no joint {printable(wanted)} in {listed(signals)} (found: {listed(every)})",
                source=name,
                remedy=f"name the {side} wheel with --{side}-joint{suggestion(wanted, every)}",
            )
        if not found:
            raise DetectError(
                f"no {side} wheel joint in {listed(signals)} (found: {listed(every)})", source=name, remedy=NAME_WHEELS
            )
        chosen["left" if side == "left" else "right"] = tuple(_by_quantity(found))
    right, left = chosen["right"], chosen["left"]
    shared = {s.topic for s in right} & {s.topic for s in left}
    if shared:
        right, left = (tuple(s for s in w if s.topic in shared) for w in (right, left))
    for side, wheels in (("left", left), ("right", right)):
        if len({s.topic for s in wheels}) > 1 or len(wheels) > 1:
            raise DetectError(
                f"{len(wheels)} joints can be the {side} wheel ({listed(f'{s.name} in {s.topic}' for s in wheels)})",
                source=name,
                needed="one is needed",
                remedy=f"name it with --{side}-joint or its topic with --joint-topic",
            )
    if right[0] is left[0]:
        raise DetectError(
            f"left and right wheel are both {printable(left[0].name)}",
            source=name,
            needed="two joints are needed",
            remedy=NAME_WHEELS,
        )
    for side, wheels in (("right", right), ("left", left)):
        if not wheels[0].count:
            raise without_readings(name, wheels[0])
        if not (right[0].moves or left[0].moves):
            raise DetectError(
                f"the {side} wheel {printable(wheels[0].name)} in {printable(wheels[0].topic)} never moves",
                source=name,
                needed="wheel readings that change while the robot drives are needed",
                remedy="check its driver, or name another joint",
            )
    return WheelGroup(right=right, left=left)


def _by_quantity(found: Sequence[Signal]) -> list[Signal]:
    """Return the signals of the best quantity: positions that move, else ticks, else velocities, else what is there."""
    for quantity in (Quantity.POSITION, Quantity.TICKS, Quantity.VELOCITY):
        of_kind = [s for s in found if s.quantity is quantity and s.moves]
        if of_kind:
            return of_kind
    return [s for s in found if s.count] or list(found[:1])
