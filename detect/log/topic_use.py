"""Possible use of a topic, decided before any of its messages: what a live reader subscribes to."""

from enum import StrEnum

from boxcal.detect.log.containers.base import Channel, ros_type
from boxcal.detect.log.images import FOXGLOVE, IMAGE_TYPES, VIDEO_PACKET
from boxcal.detect.log.metadata import METADATA_TYPES, Metadata
from boxcal.detect.log.readings import JOINTS
from boxcal.detect.log.tick_messages import FOXGLOVE_JOINTS, ODOMETRY, fields_of
from boxcal.detect.log.topics import Topics, named_field

_ENCODINGS = {"cdr", "ros1", "protobuf", "json"}


class Use(StrEnum):
    """Uses that a topic may have for a calibration."""

    IMAGE = "image"
    VIDEO = "video"
    WHEELS = "wheels"
    ABOUT = "about the robot"
    NONE = "none"


def use_of(channel: Channel, topics: Topics) -> Use:
    """Return what a topic's messages are for, by their type and what the user named.

    Parameters
    ----------
    channel
        The topic with its type and encoding.
    topics
        Names that the user gave; a field of any topic can be a wheel.
    """
    if channel.encoding not in _ENCODINGS:
        return Use.NONE
    kind = ros_type(channel.type) if channel.encoding != "protobuf" else channel.type
    if kind in IMAGE_TYPES:
        return Use.VIDEO if FOXGLOVE.get(kind, kind) == VIDEO_PACKET else Use.IMAGE
    named = any(named_field(wheel, channel.topic) for wheel in topics.joints)
    if named or kind == JOINTS or kind in FOXGLOVE_JOINTS or kind in ODOMETRY or fields_of(kind, channel.topic):
        return Use.WHEELS
    if kind in METADATA_TYPES and Metadata().wants(kind, channel.topic):
        return Use.ABOUT
    return Use.NONE
