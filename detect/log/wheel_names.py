"""Wheel side meant by a joint's name, in the habits of public robots."""

import re
from typing import Literal

Side = Literal["right", "left"]

_TOKENS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_WHEEL = re.compile(r"wheel|whl")
_DRIVE = re.compile(r"motor|track|drive")
_NOT_DRIVEN = re.compile(r"caster|castor|steer|suspension")
_LIMB = re.compile(r"arm|gripper|finger|hand|elbow|wrist|shoulder|neck|head|hip|knee|ankle|camera|lidar")
_NOT_READING = re.compile(
    r"cmd|command|target|desired|goal|setpoint|pwm|effort|current|power|volt|temp|speed|vel|rpm|rate"
)
_ENCODER = re.compile(r"tick|encoder|enc_|_enc|count|wheel|whl|odom_")
_SIDE_TOKENS: dict[Side, frozenset[str]] = {
    "right": frozenset({"r", "rh", "rwheel", "wheelr", "rwhl", "fr", "rr", "br", "mr", "rmotor", "renc", "rencoder"}),
    "left": frozenset({"l", "lh", "lwheel", "wheell", "lwhl", "fl", "rl", "bl", "ml", "lmotor", "lenc", "lencoder"}),
}
SIDES: tuple[Side, Side] = ("right", "left")
"""The one order of the wheels."""


def wheel_side(joint: str) -> Side | None:
    """Return which driven wheel a joint's name means, or None.

    ``wheel_left_joint``, ``left_wheel``, ``LeftWheel``, ``l_wheel_joint``, ``base_l_wheel``, ``rwheel``, ``wheel_FL``
    are wheels; casters, steering and suspension joints are not.
    """
    return _side(joint) if _WHEEL.search(joint.lower()) and not _NOT_DRIVEN.search(joint.lower()) else None


def drive_side(joint: str) -> Side | None:
    """Return which side's motor or track a joint's name means (``motor_left``, ``left_track``), or None."""
    lower = joint.lower()
    driven = _DRIVE.search(lower) and not (_NOT_DRIVEN.search(lower) or _LIMB.search(lower))
    return _side(joint) if driven else None


def encoder_side(topic: str) -> Side | None:
    """Return which wheel's encoder a topic's name means (``/left_ticks``, ``/lwheel``, ``/encoder/right``), or None."""
    lower = topic.lower()
    if not _ENCODER.search(lower) or any(p.search(lower) for p in (_NOT_READING, _NOT_DRIVEN, _LIMB)):
        return None
    return _side(topic)


def _side(name: str) -> Side | None:
    tokens = {token.lower() for token in _TOKENS.findall(name)}
    sides: list[Side] = [side for side in SIDES if side in name.lower() or tokens & _SIDE_TOKENS[side]]
    return sides[0] if len(sides) == 1 else None
