"""Errors that say why a recording has no wheels."""

from collections.abc import Mapping, Sequence

from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import listed, printable
from boxcal.detect.log.signals import OdometrySignal, Signal
from boxcal.detect.log.wheel_groups import WheelGroup
from boxcal.detect.log.wheel_names import SIDES

NAME_WHEELS = "name them with --left-joint and --right-joint"


def without_readings(name: str, signal: Signal) -> DetectError:
    """Return that a joint which may be a wheel has no positions."""
    return DetectError(
        f"joint {printable(signal.name)} in {printable(signal.topic)}: no positions",
        source=name,
        needed="wheel angles in rad are needed",
        remedy="make the driver publish them",
    )


def no_wheels(  # noqa: PLR0917  everything that was found
    name: str,
    signals: Mapping[str, Mapping[str, Signal]],
    joints: Mapping[str, Mapping[str, Signal]],
    groups: Sequence[WheelGroup],
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
        return without_readings(name, empty[0])
    missing = [side for side in SIDES if not sides[side]]
    which = "wheel joints" if len(missing) != 1 else f"{missing[0]} wheel joint"
    return DetectError(f"no {which} in {listed(signals)} (found: {listed(every)})", source=name, remedy=NAME_WHEELS)
