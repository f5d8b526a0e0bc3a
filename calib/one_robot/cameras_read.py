"""Drives of a robot as each of its cameras saw them, and the image topics that are no camera of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.calib.one_robot.camera_names import camera_names
from boxcal.calib.one_robot.reading import read
from boxcal.calib.settings import CORRESPONDENCES, Job, listed
from boxcal.detect.correspondences import Correspondences, load_correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import Pictures
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.several_cameras import MOST, image_topics
from boxcal.detect.log.topics import same_topic, without_transport


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraDrives:
    """Drives of a robot as one of its cameras saw them.

    Attributes
    ----------
    name
        Of the camera.
    topic
        Of its images.
    drives
        In the order of the logs.
    photographs
        Small photographs of each drive's stops, by the time (ns) at which they began.
    """

    name: str
    topic: str
    drives: tuple[Correspondences, ...]
    photographs: tuple[Mapping[int, bytes], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadCameras:
    """All cameras of a robot that saw the box.

    Attributes
    ----------
    cameras
        Those that did, the first in order is the robot's own.
    left_out
        Why an image topic is not among them, by topic.
    """

    cameras: tuple[CameraDrives, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)


Keep = Callable[[dict[int, bytes]], Pictures | None]
"""Returns what keeps photographs of stops in a place for them, None if none are kept."""


def job_of(job: Job, topic: str) -> Job:
    """Return the job with one camera's topic."""
    settings = job.settings
    topics = replace(settings.topics, camera_topic=topic)
    return replace(job, settings=replace(settings, topics=topics))


def read_cameras(job: Job, tell: Callable[[str, float], None], keep: Keep) -> ReadCameras:
    """Return what each camera of a robot saw; a camera that cannot be used is left out, with why.

    Parameters
    ----------
    job
        The robot; its settings say which cameras.
    tell
        Called with what is read, and the fraction of all that is done.
    keep
        What keeps photographs.

    Raises
    ------
    DetectError, CalibError
        If no camera can be used, or two topics that were named show one camera.
    """
    if all(log.suffix == CORRESPONDENCES for log in job.logs):
        return _saved(job)
    topics, left_out = _topics(job)
    cameras: list[CameraDrives] = []
    first: DetectError | CalibError | None = None
    for number, (topic, name) in enumerate(zip(topics, camera_names(topics), strict=True)):
        photos: list[dict[int, bytes]] = [{} for _ in job.logs]
        drives = []
        try:
            for k, log in enumerate(job.logs):
                begun = (number * len(job.logs) + k) / (len(topics) * len(job.logs))
                tell(f"reading {printable(topic)} of {listed([log])}", begun)
                drives.append(read(log, job_of(job, topic), pictures=keep(photos[k])))
        except (DetectError, CalibError) as error:
            first = first or error
            left_out[topic] = str(error).removeprefix(f"{error.source}: ") if error.source else str(error)
            continue
        cameras.append(CameraDrives(name=name, topic=topic, drives=tuple(drives), photographs=tuple(photos)))
    if first is not None and not cameras:
        raise first
    return ReadCameras(cameras=tuple(cameras), left_out=left_out)


def _topics(job: Job) -> tuple[list[str], dict[str, str]]:
    """Return the topics to look at, and why others are none to look at."""
    if job.settings.all_cameras:
        found = image_topics(job.logs[0])
        return list(found.cameras), dict(found.left_out)
    topics = list(job.settings.cameras)
    for k, topic in enumerate(topics):
        twice = next((t for t in topics[:k] if same_topic(without_transport(t), without_transport(topic))), None)
        if twice is not None:
            raise _one_camera(twice, topic, listed(job.logs), "by their names")
    if len(topics) > MOST:
        raise CalibError(f"{len(topics)} cameras are named, {MOST} at most can be calibrated together")
    return topics, {}


def _one_camera(a: str, b: str, source: str, why: str) -> CalibError:
    return CalibError(
        f"{printable(a)} and {printable(b)} show one camera ({why})", source=source, remedy="name one of them only"
    )


def one_camera(a: CameraDrives, b: CameraDrives) -> CalibError:
    """Return that two topics show one camera, found from where it stands at all stops."""
    return _one_camera(a.topic, b.topic, a.drives[0].source.log, "they see the box from one place at every stop")


def _saved(job: Job) -> ReadCameras:
    """Return the cameras that saved correspondences hold: those in the folder of the first, and in its cameras' own."""
    log = job.logs[0]
    if len(job.logs) > 1:
        raise CalibError(
            "saved correspondences of several cameras and several drives are not told apart",
            source=listed(job.logs),
            remedy="give the recordings",
        )
    found: dict[str, Path] = {}
    for path in (log, *sorted(log.parent.glob(f"*/{log.name}"))):
        found.setdefault(load_correspondences(path).source.camera_topic, path)
    wanted = job.settings.cameras
    topics = [t for t in found if not wanted or any(same_topic(t, w) for w in wanted)]
    left_out = {w: "no correspondences of it were saved" for w in wanted if not any(same_topic(w, t) for t in topics)}
    if not topics:
        raise CalibError("no correspondences of these cameras", source=log.name, remedy="give the recording")
    ordered: Sequence[str] = sorted(topics, key=lambda t: _place(t, wanted)) if wanted else topics
    cameras = [
        CameraDrives(name=name, topic=topic, drives=(read(found[topic], job_of(job, topic)),))
        for topic, name in zip(ordered, camera_names(ordered), strict=True)
    ]
    return ReadCameras(cameras=tuple(cameras), left_out=left_out)


def _place(topic: str, wanted: Sequence[str]) -> int:
    return next(k for k, w in enumerate(wanted) if same_topic(topic, w))
