"""Names that a user may give for topics and joints, and the choice of the camera topic."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import listed, printable, suggestion

Joint = tuple[str, str]
"""A topic and a joint's (or field's) name in it."""
_TRANSPORT = re.compile(r"/(compressed|compressedDepth|theora|ffmpeg|zstd|h264|video)$")
_ORDER = ("", "/zstd", "/compressed", "/ffmpeg", "/h264", "/video", "/theora")
"""Transports, the best first: raw images have no compression noise, videos have most."""
_DEPTH = re.compile(r"depth|disparity|compressedDepth$|point_?cloud", re.IGNORECASE)
_INFRARED = re.compile(r"infra|(^|[/_])ir([/_]|$)|thermal|fisheye_rect", re.IGNORECASE)
_DERIVED = re.compile(r"rect|annotat|overlay|debug|result|detections?_image|tag|marker", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Topics and joints named by the user; None leaves the choice to the names in the log.

    A wheel is a joint, or any number in any topic: ``/wheel_ticks.ticks_left``, ``/encoders.data[0]``.
    """

    camera_topic: str | None = None
    joint_topic: str | None = None
    left_joint: str | None = None
    right_joint: str | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        """The wheels that were named, right first."""
        return tuple(j for j in (self.right_joint, self.left_joint) if j is not None)


def same_topic(a: str, b: str) -> bool:
    """Return whether two topic names are one: a leading slash does not matter."""
    return a.lstrip("/") == b.lstrip("/")


def named_field(wheel: str, topic: str) -> str:
    """Return the field of a topic that a user's name for a wheel means, empty if it means none of this topic."""
    of_topic, dot, path = wheel.lstrip("/").partition(".")
    return path if dot and of_topic == topic.lstrip("/") else ""


def choose_camera(
    name: str,
    counts: Mapping[str, int],
    all_topics: Mapping[str, str],
    wanted: str | None,
    depth: Collection[str] = (),
) -> str:
    """Return the camera's topic.

    Depth images are none. Where a camera has several transports (``X``, ``X/compressed`` ...) the raw one is taken: it
    has no compression noise. Infrared and derived images are taken only where there is no other. Topics without
    messages count only where no other has any.

    Parameters
    ----------
    name
        Of the recording, for messages.
    counts
        Messages by image topic.
    all_topics
        Type by topic, everything in the recording.
    wanted
        The topic that the user named.
    depth
        Image topics whose pixels are distances.

    Raises
    ------
    DetectError
        If there is none, more than one, the named one is not there, or it has no messages.
    """
    if wanted is not None:
        candidates = [topic for topic in counts if same_topic(topic, wanted)]
        if not candidates or not counts[candidates[0]]:
            others = [t for t in counts if same_topic(without_transport(t), without_transport(wanted)) and counts[t]]
            candidates = sorted(others, key=transport_rank)[:1] or candidates
        if not candidates:
            kind = next((f" (its type is {printable(k)})" for t, k in all_topics.items() if same_topic(t, wanted)), "")
            raise DetectError(
                f"no camera topic {printable(wanted)}{kind}, image topics in the log: {listed(counts)}",
                source=name,
                remedy=f"name one of them with --camera-topic{suggestion(wanted, counts)}",
            )
    else:
        candidates = _likely(counts, depth)
    if not candidates:
        only = f"; of images only depth: {listed(counts)}" if counts else ""
        raise DetectError(
            "no camera topic, one of sensor_msgs/msg/Image or CompressedImage is needed (found: "
            f"{listed(f'{t} [{k}]' for t, k in all_topics.items())}{only})",
            source=name,
            remedy="record the camera too",
        )
    if len(candidates) > 1:
        raise DetectError(
            f"{len(candidates)} camera topics ({listed(candidates)})",
            source=name,
            needed="one is needed",
            remedy="name it with --camera-topic; fleet-calibrate calibrates several with --all-cameras",
        )
    if not counts[candidates[0]]:
        raise DetectError(f"no messages on camera topic {printable(candidates[0])}", source=name, remedy="record again")
    return candidates[0]


def _likely(counts: Mapping[str, int], depth: Collection[str]) -> list[str]:
    """Return the topics that can be the camera by their names."""
    found = [t for t in counts if not _DEPTH.search(t) and t not in depth]
    found = [t for t in found if counts[t]] or found
    for kind in (_INFRARED, _DERIVED):
        found = [t for t in found if not kind.search(t)] or found
    best: dict[str, str] = {}
    for topic in sorted(found, key=transport_rank):
        best.setdefault(without_transport(topic), topic)
    return list(best.values())


def distances(topic: str) -> bool:
    """Return whether a topic holds distances, by its name."""
    return _DEPTH.search(topic) is not None


def without_transport(topic: str) -> str:
    """Return a topic without the transport at its end: one camera's ``X``, ``X/compressed`` ... are all ``X``."""
    return _TRANSPORT.sub("", topic)


def says_raw(topic: str) -> bool:
    """Return whether a topic's name says that its images are the camera's own: ``image_raw``, with any transport."""
    last = re.split(r"[/_]", without_transport(topic).lower())[-1]
    return last == "raw" and _DERIVED.search(topic) is None


def made_from_another(topic: str, others: Collection[str]) -> bool:
    """Return whether a topic's name says that its images are made from those of another one beside it."""
    folder = topic.rpartition("/")[0]
    beside = (other for other in others if other.rpartition("/")[0] == folder)
    return _DERIVED.search(topic) is not None and any(not _DERIVED.search(other) for other in beside)


def transport_rank(topic: str) -> int:
    """Return how little a topic's transport spoils images: 0 for raw images."""
    found = _TRANSPORT.search(topic)
    suffix = found.group(0) if found else ""
    return _ORDER.index(suffix) if suffix in _ORDER else len(_ORDER)
