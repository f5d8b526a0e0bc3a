"""Choice of the wheel signals of a recording: by the user's names, else by what names mean and what moves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.named_wheels import named_wheels
from boxcal.detect.log.no_wheels import no_wheels
from boxcal.detect.log.safe_text import listed, printable, suggestion
from boxcal.detect.log.signals import OdometrySignal, Quantity, Signal
from boxcal.detect.log.topics import Topics, same_topic
from boxcal.detect.log.wheel_groups import WheelGroup, wheel_groups

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
    if topics.joints:
        group = named_wheels(name, signals, topics)
        return _choice(group, [group])
    groups = wheel_groups(signals)
    moving = [g for g in groups if g.moves]
    for quantity in (Quantity.POSITION, Quantity.TICKS, Quantity.VELOCITY):
        of_kind = [g for g in moving if g.quantity is quantity]
        if of_kind:
            chosen = _one(name, of_kind)
            return _choice(chosen, groups)
    found = _moving_odometry(name, odometry)
    if found is not None:
        return WheelChoice(odometry=found, notes=_still_notes(groups, f"the odometry in {printable(found.topic)}"))
    raise no_wheels(name, signals, joints, groups, odometry, all_topics)


def _one(name: str, groups: Sequence[WheelGroup]) -> WheelGroup:
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


def _same(a: WheelGroup, b: WheelGroup) -> bool:
    """Return whether two groups carry the same readings, as where one topic repeats another."""
    for mine, others in ((a.right, b.right), (a.left, b.left)):
        if len(mine) != len(others):
            return False
        for one, other in zip(mine, others, strict=True):
            _, at, at_other = np.intersect1d(one.t_ns, other.t_ns, return_indices=True)
            if at.size < 2 or float(np.max(np.abs(one.values[at] - other.values[at_other]))) > _ALIKE:
                return False
    return True


def _choice(chosen: WheelGroup, groups: Sequence[WheelGroup]) -> WheelChoice:
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


def _still_notes(still: Sequence[WheelGroup], taken: str) -> tuple[str, ...]:
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
    """Return whether the name of odometry says that it is reckoned from the wheels alone."""
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
