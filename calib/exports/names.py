"""Names in the files for other programs: frames, the camera's topic, the wheels' controller."""

import re
from dataclasses import dataclass

from boxcal.calib.settings import Settings
from boxcal.detect.log.source import Source

BODY, OPTICAL, TOPIC = "base_footprint", "camera_optical_frame", "/camera/image_raw"
"""Frames and topic where nobody names others: ROS' REP 105 and REP 103, and what camera drivers call it."""
_FRAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*")
_TOPIC = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*")
_OPTICAL_ENDS = ("_optical_frame", "_optical_link", "_optical", "_frame", "_link")


@dataclass(frozen=True, slots=True, kw_only=True)
class Names:
    """Names in the files for others.

    Attributes
    ----------
    base
        Frame on the floor below the middle of the axle, x forward.
    optical
        The camera's optical frame (x right, y down, z forward): what its images name.
    topic
        Of the camera's images.
    controller
        Name of the node that drives the wheels.
    prefix
        Of both frames, in their names already.
    left_joint, right_joint
        Of the wheels, in the robot's description.
    """

    base: str = BODY
    optical: str = OPTICAL
    topic: str = TOPIC
    controller: str = "diff_drive_controller"
    prefix: str = ""
    left_joint: str = "left_wheel_joint"
    right_joint: str = "right_wheel_joint"

    @property
    def bare_base(self) -> str:
        """The base frame without its prefix."""
        return self.base.removeprefix(self.prefix)

    @property
    def bare_optical(self) -> str:
        """The camera's optical frame without its prefix."""
        return self.optical.removeprefix(self.prefix)

    @property
    def link(self) -> str:
        """The frame of the camera's mount (x along the view, y left, z up), by ROS' convention."""
        stem = next((self.optical.removesuffix(end) for end in _OPTICAL_ENDS if self.optical.endswith(end)), "")
        name = f"{stem or self.optical}_link"
        return f"{stem or self.optical}_mount_link" if name == self.optical else name

    @property
    def joint(self) -> str:
        """Stems of the names of the camera's joints."""
        return self.link.removesuffix("_link")


def names_for(settings: Settings, source: Source) -> Names:
    """Return the names as the user gave them, else as the log has them, else ROS' usual ones.

    The base frame is not taken from the log: the result is about a frame on the floor, and a log's base frame often
    lies at the height of the axle.
    """
    base = settings.base_frame or BODY
    optical = settings.camera_frame or _valid(source.camera_frame.lstrip("/"), _FRAME, OPTICAL)
    prefix = settings.prefix
    return Names(
        base=_prefixed(prefix, base),
        optical=_prefixed(prefix, optical),
        topic=settings.topics.camera_topic or _valid(source.camera_topic, _TOPIC, TOPIC),
        controller=settings.controller,
        prefix=prefix,
        left_joint=_valid(settings.topics.left_joint or "", _FRAME, "left_wheel_joint"),
        right_joint=_valid(settings.topics.right_joint or "", _FRAME, "right_wheel_joint"),
    )


def valid_frame(name: str, default: str) -> str:
    """Return a frame's name, or the default where ROS has no such names."""
    return _valid(name, _FRAME, default)


def valid_topic(name: str, default: str) -> str:
    """Return a topic's name, or the default where ROS has no such names."""
    return _valid(name, _TOPIC, default)


def _valid(name: str, pattern: re.Pattern[str], default: str) -> str:
    return name if pattern.fullmatch(name) else default


def _prefixed(prefix: str, name: str) -> str:
    return name if name.startswith(prefix) else prefix + name
