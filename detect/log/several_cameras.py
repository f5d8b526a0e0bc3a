"""Image topics of a recording that are cameras of their own, and why the others are not."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import DEPTH_ENCODINGS
from boxcal.detect.log.opener import open_container
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.scan import Scan
from boxcal.detect.log.topics import Topics, distances, made_from_another, transport_rank, without_transport

MOST = 16
"""More image topics than this are not read as cameras of one robot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageTopics:
    """Image topics of one recording.

    Attributes
    ----------
    cameras
        Topics that may each be a camera, in the order of their names.
    left_out
        Why another one is none, by topic.
    """

    cameras: tuple[str, ...]
    left_out: Mapping[str, str]


def image_topics(path: Path) -> ImageTopics:
    """Return the image topics of a recording, told apart by their names and kinds of images.

    Raises
    ------
    DetectError
        If it cannot be read, or has no camera, or more than :data:`MOST`.
    """
    container = open_container(path, hashed=False)
    scan = Scan(name=path.name, topics=Topics())
    try:
        scan.take_all(container)
        scan.refuse_other_worlds()
        depth = {topic for (topic, _), series in scan.images.items() if series.encoding in DEPTH_ENCODINGS}
        found = chosen(scan.image_counts(), depth)
    except OSError as error:
        raise DetectError(
            f"cannot be read ({error.strerror or error})", source=path.name, remedy="check the file"
        ) from error
    finally:
        container.close()
        scan.cache.close()
    if not found.cameras:
        raise DetectError(
            "no camera topic, one of sensor_msgs/msg/Image or CompressedImage is needed",
            source=path.name,
            remedy="record the cameras too",
        )
    if len(found.cameras) > MOST:
        raise DetectError(
            f"{len(found.cameras)} camera topics, {MOST} at most are read together",
            source=path.name,
            remedy="name the cameras, each with --camera-topic",
        )
    return found


def chosen(counts: Mapping[str, int], depth: Collection[str] = ()) -> ImageTopics:
    """Return which image topics are cameras, by their names, their numbers of messages and which show distances."""
    left_out: dict[str, str] = {}
    best: dict[str, str] = {}
    for topic in sorted(counts, key=lambda t: (transport_rank(t), t)):
        stem = without_transport(topic)
        if not counts[topic]:
            left_out[topic] = "no messages"
        elif topic in depth or distances(topic):
            left_out[topic] = "distances, no pictures"
        elif stem in best:
            left_out[topic] = f"the pictures of {printable(best[stem])} once more"
        else:
            best[stem] = topic
    cameras = sorted(best.values())
    made = [topic for topic in cameras if made_from_another(topic, cameras)]
    left_out |= dict.fromkeys(made, "by its name made from the pictures of a topic beside it")
    return ImageTopics(cameras=tuple(t for t in cameras if t not in made), left_out=left_out)
