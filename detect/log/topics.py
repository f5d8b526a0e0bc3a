"""Which topic is the camera and which joints are the wheels, by type and name."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import listed, printable, suggestion

Side = Literal["left", "right"]
Joint = tuple[str, str]
"""A topic and a joint's name in it."""

_TOKENS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_WHEEL = re.compile(r"wheel|whl")
_NOT_DRIVEN = re.compile(r"caster|castor|steer|suspension")
_SIDE_TOKENS: dict[Side, frozenset[str]] = {
    "left": frozenset({"l", "lh", "lwheel", "wheell", "lwhl"}),
    "right": frozenset({"r", "rh", "rwheel", "wheelr", "rwhl"}),
}
_COMPRESSED = re.compile(r"/compressed(Depth)?$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """What a user may name where names alone do not decide; None leaves it to the names."""

    camera_topic: str | None = None
    joint_topic: str | None = None
    left_joint: str | None = None
    right_joint: str | None = None


def wheel_side(joint: str) -> Side | None:
    """Return which driven wheel a joint's name means, or None.

    ``wheel_left_joint``, ``left_wheel``, ``LeftWheel``, ``l_wheel_joint``, ``base_l_wheel``, ``rwheel`` are wheels;
    casters, steering and suspension joints are not.
    """
    lower = joint.lower()
    if not _WHEEL.search(lower) or _NOT_DRIVEN.search(lower):
        return None
    tokens = {token.lower() for token in _TOKENS.findall(joint)}
    sides = [side for side, short in _SIDE_TOKENS.items() if side in lower or tokens & short]
    return sides[0] if len(sides) == 1 else None


def same_topic(a: str, b: str) -> bool:
    """Tell whether two topic names are one: a leading slash does not matter."""
    return a.lstrip("/") == b.lstrip("/")


def choose_camera(name: str, counts: Mapping[str, int], all_topics: Mapping[str, str], wanted: str | None) -> str:
    """Return the camera's topic.

    Where a camera has a raw and a compressed topic (``X`` and ``X/compressed``), the raw one is taken: it has no
    compression noise. Topics without messages count only where no other has any.

    Parameters
    ----------
    name
        Of the file, for messages.
    counts
        Messages by image topic.
    all_topics
        Type by topic, everything in the log.
    wanted
        The topic that the user named.

    Raises
    ------
    DetectError
        If there is none, more than one, the named one is not there, or it has no messages.
    """
    if wanted is not None:
        found = [topic for topic in counts if same_topic(topic, wanted)]
        if not found:
            kind = next((f" (its type is {printable(k)})" for t, k in all_topics.items() if same_topic(t, wanted)), "")
            raise DetectError(
                f"{name}: no camera topic {printable(wanted)}{kind}, image topics in the log: {listed(counts)}; name "
                f"one of them with --camera-topic{suggestion(wanted, counts)}"
            )
        candidates = found
    else:
        candidates = [t for t, count in counts.items() if count] or list(counts)
        raw = {t for t in candidates if not _COMPRESSED.search(t)}
        candidates = [t for t in candidates if t in raw or _COMPRESSED.sub("", t) not in raw]
    if not candidates:
        raise DetectError(
            f"{name}: no camera topic, one of sensor_msgs/msg/Image or CompressedImage is needed (found: "
            f"{listed(f'{t} [{k}]' for t, k in all_topics.items())}); record the camera too"
        )
    if len(candidates) > 1:
        raise DetectError(
            f"{name}: {len(candidates)} camera topics ({listed(candidates)}), one is needed; name it with "
            "--camera-topic"
        )
    if not counts[candidates[0]]:
        raise DetectError(f"{name}: no messages on camera topic {printable(candidates[0])}; record again")
    return candidates[0]


def choose_wheels(
    name: str, joints: Mapping[str, Iterable[str]], all_topics: Mapping[str, str], topics: Topics
) -> tuple[Joint, Joint]:
    """Return the left and the right wheel's topic and joint.

    A topic that names both wheels is taken before a pair of topics that name one each.

    Parameters
    ----------
    name
        Of the file, for messages.
    joints
        Joint names by joint topic (empty where the topic has no messages).
    all_topics
        Type by topic, everything in the log.
    topics
        What the user named.

    Raises
    ------
    DetectError
        If there are none, more than one of a side, or a named one is not there.
    """
    if not joints:
        raise DetectError(
            f"{name}: no joint topic, one of sensor_msgs/msg/JointState is needed (found: "
            f"{listed(f'{t} [{k}]' for t, k in all_topics.items())}); record the wheels' joint states too"
        )
    if topics.joint_topic is not None:
        named = {t: j for t, j in joints.items() if same_topic(t, topics.joint_topic)}
        if not named:
            raise DetectError(
                f"{name}: no joint topic {printable(topics.joint_topic)}, joint topics in the log: {listed(joints)}; "
                f"name one of them with --joint-topic{suggestion(topics.joint_topic, joints)}"
            )
        joints = named
    every = {joint for names in joints.values() for joint in names}
    if not every:
        raise DetectError(f"{name}: no messages with joints on {listed(joints)}; record again while the robot drives")
    for side, wanted in (("left", topics.left_joint), ("right", topics.right_joint)):
        if wanted is not None and wanted not in every:
            raise DetectError(
                f"{name}: no joint {printable(wanted)} in {listed(joints)} (found: {listed(every)}); name the {side} "
                f"wheel with --{side}-joint{suggestion(wanted, every)}"
            )
    left = _candidates(joints, "left", topics.left_joint)
    right = _candidates(joints, "right", topics.right_joint)
    if not left or not right:
        which = "wheel joints" if not (left or right) else f"{'right' if left else 'left'} wheel joint"
        raise DetectError(
            f"{name}: no {which} in {listed(joints)} (found: {listed(every)}); name them with --left-joint and "
            "--right-joint"
        )
    both = {t for t, _ in left} & {t for t, _ in right}
    if both:
        left, right = [j for j in left if j[0] in both], [j for j in right if j[0] in both]
    if len(both) > 1:
        raise DetectError(
            f"{name}: {len(both)} joint topics with wheels ({listed(both)}), one is needed; name it with --joint-topic"
        )
    for side, found in (("left", left), ("right", right)):
        if len(found) > 1:
            what = listed(joint if both else f"{joint} in {topic}" for topic, joint in found)
            raise DetectError(
                f"{name}: {len(found)} joints can be the {side} wheel ({what}), one is needed; name it with "
                f"--{side}-joint or its topic with --joint-topic"
            )
    if left == right:
        raise DetectError(
            f"{name}: left and right wheel are both {printable(left[0][1])}, two joints are needed; name them with "
            "--left-joint and --right-joint"
        )
    return left[0], right[0]


def _candidates(joints: Mapping[str, Iterable[str]], side: Side, wanted: str | None) -> list[Joint]:
    pairs = sorted((topic, joint) for topic, names in joints.items() for joint in set(names))
    return [(t, j) for t, j in pairs if (j == wanted if wanted is not None else wheel_side(j) == side)]
