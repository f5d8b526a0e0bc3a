"""Choice of the wheel signals of a recording: by the user's names, else by what names mean and what moves."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import listed, printable, suggestion
from boxcal.detect.log.signals import OdometrySignal, Quantity, Signal
from boxcal.detect.log.topics import Topics, named_field, same_topic
from boxcal.detect.log.wheel_names import SIDES, Side, wheel_side

_NAME_WHEELS = "name them with --left-joint and --right-joint"
_FILTERED = ("filtered", "ekf", "ukf", "visual", "slam", "fused", "map", "laser", "lidar", "icp", "vio", "gps")
"""Words in the names of odometry that is not the wheels' alone."""
_OF_WHEELS = ("unfiltered", "wheel", "encoder", "raw")
"""Words in the names of odometry that is the wheels' alone, where a filter's has the plain name."""
_ALIKE = 1e-6
"""Two topics say the same of a wheel if their readings at common stamps are this close, rad."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelChoice:
    """The signals that are taken for the wheels.

    Attributes
    ----------
    right, left
        One signal a wheel; of robots with four or six wheels those of a side. Empty with odometry.
    odometry
        The odometry topic that stands for wheels, None if there are wheels.
    notes
        What a user should know of the choice.
    """

    right: tuple[Signal, ...] = ()
    left: tuple[Signal, ...] = ()
    odometry: OdometrySignal | None = None
    notes: tuple[str, ...] = ()

    @property
    def quantity(self) -> Quantity:
        """Kind of the chosen signals' numbers."""
        return Quantity.ODOMETRY if self.odometry is not None else self.right[0].quantity

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics of the chosen signals, each once."""
        if self.odometry is not None:
            return (self.odometry.topic,)
        return tuple(dict.fromkeys(s.topic for s in (*self.right, *self.left)))


def choose_wheels(
    name: str,
    signals: Mapping[str, Mapping[str, Signal]],
    odometry: Mapping[str, OdometrySignal],
    all_topics: Mapping[str, str],
    topics: Topics,
) -> WheelChoice:
    """Return the wheels of a recording.

    Positions are taken before ticks, ticks before velocities, these before odometry; but what never moves only if
    nothing else does. A topic that names both wheels is taken before a pair of topics that name one each.

    Parameters
    ----------
    name
        Of the recording, for messages.
    signals
        By topic and joint or field.
    odometry
        By topic.
    all_topics
        Type by topic, everything in the recording.
    topics
        What the user named.

    Raises
    ------
    DetectError
        If there are no wheels, more than one choice, a named one is not there, or none ever moves.
    """
    joints = {topic: {s.name: s for s in of.values()} for topic, of in signals.items()}
    if topics.joint_topic is not None:
        signals, odometry = _only_topic(name, signals, odometry, topics.joint_topic)
    named = {side: wheel for side, wheel in (("right", topics.right_joint), ("left", topics.left_joint)) if wheel}
    if named:
        return _named(name, signals, topics)
    groups = _groups(signals)
    moving = [g for g in groups if g.moves]
    for quantity in (Quantity.POSITION, Quantity.TICKS, Quantity.VELOCITY):
        of_kind = [g for g in moving if g.quantity is quantity]
        if of_kind:
            chosen = _one(name, of_kind)
            return _choice(chosen, groups)
    found = _moving_odometry(name, odometry)
    if found is not None:
        return WheelChoice(odometry=found, notes=_still_notes(groups, f"the odometry in {printable(found.topic)}"))
    raise _no_wheels(name, signals, joints, groups, odometry, all_topics)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Group:
    """Signals of both sides that belong together."""

    right: tuple[Signal, ...]
    left: tuple[Signal, ...]

    @property
    def topics(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(s.topic for s in (*self.right, *self.left)))

    @property
    def quantity(self) -> Quantity:
        return self.right[0].quantity

    @property
    def moves(self) -> bool:
        return any(s.moves for s in self.right) or any(s.moves for s in self.left)

    @property
    def count(self) -> int:
        return min(s.count for s in (*self.right, *self.left))


def _groups(signals: Mapping[str, Mapping[str, Signal]]) -> list[_Group]:
    """Return the pairs of sides: in one topic, else over two."""
    out: list[_Group] = []
    for quantity in Quantity:
        alone: dict[Side, list[Signal]] = {"right": [], "left": []}
        for of_topic in signals.values():
            found = {side: _of_side(of_topic.values(), side, quantity) for side in SIDES}
            if found["right"] and found["left"]:
                out.append(_Group(right=found["right"], left=found["left"]))
            else:
                for side in SIDES:
                    alone[side] += found[side]
        if alone["right"] and alone["left"] and not any(g.quantity is quantity for g in out):
            out.append(_Group(right=tuple(alone["right"]), left=tuple(alone["left"])))
    return out


def _of_side(of_topic: Iterable[Signal], side: Side, quantity: Quantity) -> tuple[Signal, ...]:
    """Return a topic's wheels of a side: those called wheels, else motors and tracks."""
    found = [s for s in of_topic if s.side == side and s.quantity is quantity and s.count]
    wheels = [s for s in found if s.quantity is not Quantity.POSITION or wheel_side(s.name)]
    return tuple(sorted(wheels or found, key=lambda s: s.name))


def _one(name: str, groups: Sequence[_Group]) -> _Group:
    """Return the one group, or that with most readings of groups that say the same (DetectError if they do not)."""
    ordered = sorted(groups, key=lambda g: -g.count)
    first = ordered[0]
    if any(not _same(first, other) for other in ordered[1:]):
        where = [t for g in ordered for t in g.topics]
        raise DetectError(
            f"{len(groups)} joint topics with wheels ({listed(where)})",
            source=name,
            needed="one is needed",
            remedy="name it with --joint-topic",
        )
    if len(first.right) != len(first.left) or (len(first.topics) > 1 and len(first.right) > 1):
        side = "left" if len(first.left) > 1 else "right"
        wheels = first.left if len(first.left) > 1 else first.right
        what = listed(f"{s.name} in {s.topic}" if len(first.topics) > 1 else s.name for s in wheels)
        raise DetectError(
            f"{len(wheels)} joints can be the {side} wheel ({what})",
            source=name,
            needed="one is needed",
            remedy=f"name it with --{side}-joint or its topic with --joint-topic",
        )
    return first


def _same(a: _Group, b: _Group) -> bool:
    """Tell whether two groups carry the same readings, as where one topic repeats another."""
    for mine, others in ((a.right, b.right), (a.left, b.left)):
        if len(mine) != len(others):
            return False
        for one, other in zip(mine, others, strict=True):
            _, at, at_other = np.intersect1d(one.t_ns, other.t_ns, return_indices=True)
            if at.size < 2 or float(np.max(np.abs(one.values[at] - other.values[at_other]))) > _ALIKE:
                return False
    return True


def _choice(chosen: _Group, groups: Sequence[_Group]) -> WheelChoice:
    right, left = (_that_move(side) for side in (chosen.right, chosen.left))
    others = [g for g in groups if not set(g.topics) <= set(chosen.topics)]
    notes = _still_notes(others, f"{listed(chosen.topics)}")
    if chosen.quantity is Quantity.VELOCITY:
        notes += (
            f"wheel angles are integrated velocities of {listed(chosen.topics)}: there are no positions that move",
        )
    if len(right) > 1 or len(left) > 1:
        notes += (
            f"{len(right)} right and {len(left)} left wheels were averaged; of a skid-steered robot the wheel "
            "separation is an effective one, which depends on the floor and on how it turns",
        )
    return WheelChoice(right=right, left=left, notes=notes)


def _that_move(wheels: tuple[Signal, ...]) -> tuple[Signal, ...]:
    return tuple(s for s in wheels if s.moves) or wheels


def _still_notes(still: Sequence[_Group], taken: str) -> tuple[str, ...]:
    where = [t for g in still if not g.moves for t in g.topics]
    return (f"the wheels in {listed(where)} never move; {taken} does and was taken",) if where else ()


def _moving_odometry(name: str, odometry: Mapping[str, OdometrySignal]) -> OdometrySignal | None:
    moving = [o for o in odometry.values() if o.moves]
    pure = [o for o in moving if _of_wheels(o.topic)]
    pure = pure or [o for o in moving if not any(word in o.topic.lower() for word in _FILTERED)] or moving
    if len(pure) > 1:
        raise DetectError(
            f"no wheel readings, and {len(pure)} odometry topics ({listed(o.topic for o in pure)})",
            source=name,
            needed="one is needed",
            remedy="name that of the wheels alone with --joint-topic",
        )
    return pure[0] if pure else None


def _of_wheels(topic: str) -> bool:
    """Tell whether the name of odometry says that it is reckoned from the wheels alone."""
    rest = topic.lower()
    said = any(word in rest for word in _OF_WHEELS)
    return said and not any(word in rest.replace("unfiltered", "") for word in _FILTERED)


def _only_topic(
    name: str, signals: Mapping[str, Mapping[str, Signal]], odometry: Mapping[str, OdometrySignal], wanted: str
) -> tuple[dict[str, Mapping[str, Signal]], dict[str, OdometrySignal]]:
    some = {t: s for t, s in signals.items() if same_topic(t, wanted)}
    poses = {t: o for t, o in odometry.items() if same_topic(t, wanted)}
    if not some and not poses:
        there = [*signals, *odometry]
        raise DetectError(
            f"no joint topic {printable(wanted)}, joint topics in the log: {listed(there)}",
            source=name,
            remedy=f"name one of them with --joint-topic{suggestion(wanted, there)}",
        )
    return some, poses


def _named(name: str, signals: Mapping[str, Mapping[str, Signal]], topics: Topics) -> WheelChoice:
    """Return the wheels that the user named, or the one that was named and what the names say of the other."""
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
                f"no {side} wheel joint in {listed(signals)} (found: {listed(every)})", source=name, remedy=_NAME_WHEELS
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
            remedy=_NAME_WHEELS,
        )
    for side, wheels in (("right", right), ("left", left)):
        if not wheels[0].count:
            raise _without_readings(name, wheels[0])
        if not (right[0].moves or left[0].moves):
            raise DetectError(
                f"the {side} wheel {printable(wheels[0].name)} in {printable(wheels[0].topic)} never moves",
                source=name,
                needed="wheel readings that change while the robot drives are needed",
                remedy="check its driver, or name another joint",
            )
    group = _Group(right=right, left=left)
    return _choice(group, [group])


def _by_quantity(found: Sequence[Signal]) -> list[Signal]:
    """Return the signals of the best quantity: positions that move, else ticks, else velocities, else what is there."""
    for quantity in (Quantity.POSITION, Quantity.TICKS, Quantity.VELOCITY):
        of_kind = [s for s in found if s.quantity is quantity and s.moves]
        if of_kind:
            return of_kind
    return [s for s in found if s.count] or list(found[:1])


def _without_readings(name: str, signal: Signal) -> DetectError:
    return DetectError(
        f"joint {printable(signal.name)} in {printable(signal.topic)}: no positions",
        source=name,
        needed="wheel angles in rad are needed",
        remedy="make the driver publish them",
    )


def _no_wheels(  # noqa: PLR0917  everything that was found
    name: str,
    signals: Mapping[str, Mapping[str, Signal]],
    joints: Mapping[str, Mapping[str, Signal]],
    groups: Sequence[_Group],
    odometry: Mapping[str, OdometrySignal],
    all_topics: Mapping[str, str],
) -> DetectError:
    """Return why a recording has no wheels, by the truest of the causes."""
    if groups:
        wheels = listed(s.name for g in groups for s in (*g.right, *g.left))
        still = f"; the odometry in {listed(odometry)} never moves either" if odometry else ""
        return DetectError(
            f"the wheels ({wheels} in {listed(t for g in groups for t in g.topics)}) never move{still}",
            source=name,
            needed="wheel readings that change while the robot drives are needed",
            remedy="record the topic of the wheels' driver (a joint_state_publisher fills joints with zeros)",
        )
    if odometry:
        return DetectError(
            f"no wheel readings, and the odometry in {listed(odometry)} never moves",
            source=name,
            needed="wheel readings that change while the robot drives are needed",
            remedy="record the wheels' joint states, ticks or odometry",
        )
    if not joints:
        return DetectError(
            "no joint topic, one of sensor_msgs/msg/JointState is needed (found: "
            f"{listed(f'{t} [{k}]' for t, k in all_topics.items())})",
            source=name,
            remedy="record the wheels' joint states, ticks or odometry too",
        )
    every = sorted({s.name for of in signals.values() for s in of.values()})
    if not every:
        return DetectError(
            f"no messages with joints on {listed(signals)}", source=name, remedy="record again while the robot drives"
        )
    sides = {side: [s for of in signals.values() for s in of.values() if s.side == side] for side in SIDES}
    empty = [s for s in (*sides["right"], *sides["left"]) if not s.count]
    if empty and sides["right"] and sides["left"]:
        return _without_readings(name, empty[0])
    missing = [side for side in SIDES if not sides[side]]
    which = "wheel joints" if len(missing) != 1 else f"{missing[0]} wheel joint"
    return DetectError(f"no {which} in {listed(signals)} (found: {listed(every)})", source=name, remedy=_NAME_WHEELS)
