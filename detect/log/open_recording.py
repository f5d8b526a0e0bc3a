"""Opening of a recording: one pass over its messages, then the choice of camera and wheels and their assembly."""

import weakref
from pathlib import Path

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Container, Damage
from boxcal.detect.log.containers.mcap_indexed import IndexedMcap
from boxcal.detect.log.frame_cache import FrameCache
from boxcal.detect.log.frame_times import frame_times
from boxcal.detect.log.frames import FrameSource
from boxcal.detect.log.images import frame_id_of
from boxcal.detect.log.losses import MOST_STRAYS, Loss, LossKind
from boxcal.detect.log.opener import open_container
from boxcal.detect.log.readings import problems_said
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.safe_text import listed, printable
from boxcal.detect.log.scan import Scan
from boxcal.detect.log.stand_images import fetch_images
from boxcal.detect.log.topics import Topics, choose_camera
from boxcal.detect.log.wheel_assembly import assemble_wheels
from boxcal.detect.log.wheel_choice import WheelChoice, choose_wheels
from boxcal.detect.log.wheel_samples import WheelSamples, WheelUnits

DEPTH_ENCODINGS = {"16UC1", "32FC1", "16SC1", "64FC1"}


def open_recording(
    path: Path,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    nominal: tuple[float, float] | None = None,
    *,
    hashed: bool = True,
) -> Recording:
    """Read a recording of any kind: all wheel readings, and where the images are.

    Parameters
    ----------
    path
        A file (MCAP, sqlite3, ROS 1 bag, compressed or not), a bag folder, or a folder of images.
    topics
        Names where the recording is ambiguous.
    units
        What the wheel readings mean; rad, rolling forward, if None.
    nominal : m
        Wheel radius and separation of the driver that reckons the odometry, where the recording has only that.
    hashed
        Whether the SHA-256 of its bytes is wanted.

    Raises
    ------
    DetectError
        If the recording cannot be read, or lacks camera, wheels, messages or a common time; all that is missing is
        said together, with what to do.
    """
    container = open_container(path, hashed=hashed)
    scan = Scan(name=path.name, topics=topics or Topics())
    try:
        scan.take_all(container)
        return _closing(_assembled(scan, container, path, units or WheelUnits(), nominal))
    except OSError as error:
        _close(container, scan)
        raise DetectError(
            f"cannot be read ({error.strerror or error})", source=path.name, remedy="check the file"
        ) from error
    except BaseException:
        _close(container, scan)
        raise


def read_wheels(
    path: Path,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    nominal: tuple[float, float] | None = None,
) -> WheelSamples:
    """Return the wheel samples of a recording that need not show a camera (see :func:`open_recording`)."""
    container = open_container(path, hashed=False)
    scan = Scan(name=path.name, topics=topics or Topics())
    try:
        scan.take_all(container)
        scan.refuse_other_worlds()
        choice = choose_wheels(path.name, scan.readings.signals, scan.readings.odometry, scan.types, scan.topics)
        nominal = nominal or scan.readings.metadata.nominal_wheels()
        return assemble_wheels(path.name, choice, units or WheelUnits(), nominal).wheels
    finally:
        _close(container, scan)


def _close(container: Container, scan: Scan) -> None:
    container.close()
    scan.cache.close()


def _closing(recording: Recording) -> Recording:
    """Return the recording; its files are closed when nobody holds it any more."""
    source = recording.source
    weakref.finalize(source, _close_files, source.container, source.cache)
    return recording


def _close_files(container: Container, cache: FrameCache) -> None:
    container.close()
    cache.close()


def _assembled(
    scan: Scan,
    container: Container,
    path: Path,
    units: WheelUnits,
    nominal: tuple[float, float] | None,
    *,
    all_images: bool = False,
) -> Recording:
    name, types, damage = scan.name, scan.types, container.damage
    _refuse_nothing_intact(scan, damage)
    scan.refuse_other_worlds()
    try:
        camera, choice = _chosen(scan, types)
        nominal = nominal or scan.readings.metadata.nominal_wheels()
        indexed = isinstance(container, IndexedMcap) and container.has_index
        if not indexed:  # with an index, the choice may have to be made anew about all images
            scan.readings.forget_signals(but=(*choice.right, *choice.left))
        wheels = assemble_wheels(name, choice, units, nominal)
        if not indexed:
            scan.readings.forget_signals()
    except DetectError as error:
        raise _with_losses(error, name, damage) from error
    rest = None
    if isinstance(container, IndexedMcap) and indexed:
        fetch_images(scan, container, camera, wheels, all_of_them=all_images)
        if not all_images:

            def rest() -> Recording:
                return _closing(_assembled(scan, container, path, units, nominal, all_images=True))

    images = scan.images_of(camera)
    t_ns, numbers, offset, notes = frame_times(images, wheels, camera)
    source = FrameSource(series=images, container=container, cache=scan.cache)
    problems = _problems_of(scan, camera, choice)
    undecoded, strays = _undecoded(scan, problems)
    losses = (*_losses(damage), *undecoded)
    return Recording(
        path=path,
        kind=container.kind,
        sha256=container.sha256(),
        camera_topic=camera,
        camera_frame=_camera_frame(source),
        odometry_frame=next((o.base_frame for o in scan.readings.odometry.values() if o.base_frame), ""),
        wheel_topics=choice.topics,
        quantity=choice.quantity,
        nominal=wheels.nominal,
        wheels=wheels.wheels,
        frame_t_ns=t_ns,
        frame_numbers=numbers,
        clock_offset_ns=offset,
        metadata=scan.readings.metadata,
        notes=(*(loss.text for loss in losses), *strays, *_beside(scan, problems), *wheels.notes, *notes),
        lost_messages=damage.messages + sum(count for _, count in problems.values()),
        lost_s=damage.seconds,
        units=wheels.units,
        source=source,
        losses=(*losses, *wheels.losses),
        rest=rest,
    )


def _refuse_nothing_intact(scan: Scan, damage: Damage) -> None:
    if not scan.types and damage.notes:
        raise DetectError(
            damage.notes[0],
            source=scan.name,
            needed="a recording with intact messages is needed",
            remedy="recover what is there with `mcap recover`, or record again",
        )


def _chosen(scan: Scan, types: dict[str, str]) -> tuple[str, WheelChoice]:
    """Return the camera's topic and the wheels; what keeps either from being chosen is said together."""
    depth = {t for (t, _), s in scan.images.items() if s.encoding in DEPTH_ENCODINGS and _several(scan)}
    problems: list[DetectError] = []
    camera, choice = "", None
    try:
        camera = choose_camera(scan.name, scan.image_counts(), types, scan.topics.camera_topic, depth)
    except DetectError as error:
        problems.append(error)
    try:
        choice = choose_wheels(scan.name, scan.readings.signals, scan.readings.odometry, types, scan.topics)
    except DetectError as error:
        problems.append(error)
    if choice is None or problems:
        undecoded = problems_said(scan.readings.problems)
        if len(problems) == 1 and not undecoded:
            raise problems[0]
        raise DetectError(
            "; and ".join([str(e).removeprefix(f"{scan.name}: ") for e in problems] + undecoded[:3]), source=scan.name
        )
    return camera, choice


def _several(scan: Scan) -> bool:
    return len({topic for topic, _ in scan.images}) > 1


def _camera_frame(source: FrameSource) -> str:
    """Return the camera's frame by the first image that decodes."""
    for number in range(min(3, len(source.series.t_ns))):
        try:
            return frame_id_of(source.series.channel, source.message(number))
        except DetectError as error:
            if error.source:
                raise
    return ""


def _problems_of(scan: Scan, camera: str, choice: WheelChoice) -> dict[str, tuple[str, int]]:
    """Return the problems in the topics that are used; an arm's broken topic harms nothing."""
    used = {camera, *choice.topics}
    return {topic: problem for topic, problem in scan.readings.problems.items() if topic in used}


def _beside(scan: Scan, problems: dict[str, tuple[str, int]]) -> tuple[str, ...]:
    """Return a sentence on topics that nothing needs and of which messages do not decode, if there are any."""
    topics = [topic for topic in scan.readings.problems if topic not in problems]
    return (f"not used, and not all of their messages decode: {listed(topics)}",) if topics else ()


def _undecoded(scan: Scan, problems: dict[str, tuple[str, int]]) -> tuple[list[Loss], list[str]]:
    """Return the losses of topics of which many messages do not decode, and a sentence for each of the others."""
    lost, strays = [], []
    for topic, (what, count) in problems.items():
        total = count + scan.decoded_of(topic)
        if count > MOST_STRAYS * total:
            text = f"{printable(topic)}: {count} of {total} messages do not decode ({what}); the others were used"
            lost.append(Loss(kind=LossKind.UNDECODED, text=text))
        else:
            strays += problems_said({topic: (what, count)})
    return lost, strays


def _with_losses(error: DetectError, name: str, damage: Damage) -> DetectError:
    """Return an error that says what of the recording was lost, too."""
    lost = "".join(f"; {loss.text}" for loss in _losses(damage))
    return DetectError(str(error).removeprefix(f"{name}: ") + lost, source=name) if lost else error


def _losses(damage: Damage) -> tuple[Loss, ...]:
    """Return what was lost, in one sentence; nothing if nothing was."""
    if not damage.notes:
        return ()
    lost = [f"{damage.messages} messages"] if damage.messages else []
    lost += [f"{damage.seconds:.1f} s"] if damage.seconds else []
    known = f" (lost: {', '.join(lost)})" if lost else ""
    text = f"the recording is damaged: {'; '.join(damage.notes)}{known}; what is intact was used"
    return (Loss(kind=LossKind.DAMAGED, text=text),)
