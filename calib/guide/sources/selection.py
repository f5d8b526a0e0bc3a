"""The topics that are listened to: one camera, all that may be wheels, and what describes the robot."""

from collections.abc import Iterable
from dataclasses import dataclass

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.topic_use import Use, use_of
from boxcal.detect.log.topics import Topics, choose_camera

_COMPRESSED = "/compressed"
MOST_TOPICS = 64
"""Topics that are listened to at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Topics to listen to.

    Attributes
    ----------
    camera
        Its topic, empty if there is none to choose yet.
    others
        Wheels and what describes the robot.
    problem
        Sentence that says what is missing or ambiguous, empty if nothing is.
    cameras
        Topics of images and videos that a user can choose from.
    is_video
        Whether the camera's topic is a video.
    """

    camera: str = ""
    others: tuple[str, ...] = ()
    problem: str = ""
    cameras: tuple[str, ...] = ()
    is_video: bool = False

    @property
    def topics(self) -> tuple[str, ...]:
        """All of them."""
        return (*([self.camera] if self.camera else []), *self.others)


def select(channels: Iterable[Channel], topics: Topics) -> Selection:
    """Return what to listen to of the topics that a server offers.

    Of a camera with raw and compressed images the compressed ones are taken: a network carries ten times as many. A
    video is taken where there are no images.

    Parameters
    ----------
    channels
        What is offered.
    topics
        Names that the user gave.
    """
    uses = {channel.topic: (use_of(channel, topics), channel.type) for channel in channels}
    pictures = [topic for topic, (use, _) in uses.items() if use is Use.IMAGE]
    smaller = {t.removesuffix(_COMPRESSED) for t in pictures if t.endswith(_COMPRESSED)}
    videos = [topic for topic, (use, _) in uses.items() if use is Use.VIDEO]
    choice = sorted([*(t for t in pictures if t not in smaller), *videos])
    if topics.camera_topic is None:
        pictures = [t for t in pictures if t not in smaller] or videos
    else:
        pictures += videos
    wheels = [topic for topic, (use, _) in uses.items() if use is Use.WHEELS]
    about = [topic for topic, (use, _) in uses.items() if use is Use.ABOUT]
    problems, camera = [], ""
    try:
        kinds = {topic: kind for topic, (_, kind) in uses.items()}
        camera = choose_camera("", dict.fromkeys(pictures, 1), kinds, topics.camera_topic)
    except DetectError as error:
        said = str(error).removeprefix(": ")
        problems.append(f"{said}; or choose one on the page" if len(choice) > 1 else said)
    if not wheels:
        problems.append(
            f"no topic of wheels among {len(uses)} (joint states, ticks or odometry are needed); name a wheel with "
            "--left-joint and --right-joint"
        )
    return Selection(
        camera=camera,
        others=tuple((wheels + about)[:MOST_TOPICS]),
        problem="; ".join(problems),
        cameras=tuple(choice),
        is_video=camera in videos,
    )
