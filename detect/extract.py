"""From a log to correspondences: open it, find the stops, look at each, keep what can be used."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from boxcal.detect.alignment.compilation import prepare
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DEPTHS, DeepGrey, bits_of
from boxcal.detect.image.response_curve import Response
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.opener import robot_name_of
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.source import source_of
from boxcal.detect.log.standstill_clock import clock_offset_by_pictures
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import WheelUnits
from boxcal.detect.stops import MIN_STOPS, Stop, StopSettings, find_stops
from boxcal.detect.tags.averaging import FLOOR_PX, AveragedCorners, covariances
from boxcal.detect.tags.box_at_stops import BoxAtStops, KnownBox
from boxcal.detect.tags.detections import TagSettings
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.detect.tags.on_the_move import LEAST_WITHOUT_STOPS, TOO_FEW_PLACES
from boxcal.detect.tags.predicted_views import Predictor
from boxcal.detect.tags.seen_as_built import Seen, SeenStop, as_built
from boxcal.one_thread import one_thread
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target
from boxcal.target.files.target_json import given_target, target_sha256

_SOME_FRAMES = 5
_LEAST_OFFSET_NS = 300_000_000

Progress = Callable[[str, float], None]
"""Takes a line that says how far the work is."""
Pictures = Callable[[int, DeepGrey], None]
"""Takes the time, ns, at which a stop began, and a frame of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractSettings:
    """Settings of the extraction of correspondences from a log.

    Attributes
    ----------
    stops, tags
        How stops and tags are found.
    response
        The camera response function (``srgb`` or ``linear``); None estimates it from the tags of the first stops.
    bits
        Of the grey levels of a camera of more than 8 bits (10, 12, 14, 16), as its messages do not say how many of
        their 16 are used; None takes it from the largest value in some frames. It matters little where the response
        curve is linear.
    settle : s
        Frames this soon after coming to rest or before leaving are used only if there are no others.
    max_frames
        Most frames of one stop that are looked at, spread evenly.
    min_tags
        Fewest tags that make a stop usable.
    floor_px : px
        Standard deviation per axis below which no corner is believed.
    moving
        Whether to look at some frames between stops, too.
    predictor
        Predicts from the stops where frames between them show the box, so that they need not be searched; those of
        :func:`boxcal.calibrate` are predicted by the wheels.
    """

    stops: StopSettings = field(default_factory=StopSettings)
    tags: TagSettings = field(default_factory=TagSettings)
    response: Response | None = None
    bits: int | None = None
    settle: float = 0.1
    max_frames: int = 20
    min_tags: int = 4
    floor_px: float = FLOOR_PX
    moving: bool = True
    predictor: Predictor | None = None

    def __post_init__(self) -> None:
        for name, least in (("settle", 0.0), ("max_frames", 1), ("min_tags", 1), ("floor_px", 1e-6)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= least):
                raise DetectError(f"{name} is {value}, a number from {least:g} on is needed")
        if self.bits is not None and self.bits not in DEPTHS:
            raise DetectError(f"bits is {self.bits}, one of {', '.join(map(str, DEPTHS))} is needed")


@one_thread()
def extract(
    path: str | Path,
    target: Target | str | Path | None = None,
    *,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    nominal: tuple[float, float] | None = None,
    settings: ExtractSettings | None = None,
    progress: Progress | None = None,
    pictures: Pictures | None = None,
) -> Correspondences:
    """Return what a robot saw at each stop and what its wheels did between.

    Stops without frames or without enough of the target are left out; the wheel samples remain whole.

    Parameters
    ----------
    path
        The recording: a file of any kind, or a folder.
    target
        The box that the robot looked at, or its ``target.json``; the default box as designed if not given.
    topics
        Names where the log is ambiguous.
    units
        What the wheel readings mean; rad, rolling forward, if None.
    nominal : m
        Wheel radius and separation of the driver that reckons the odometry, for robots that publish only that.
    settings
        The defaults if None.
    progress
        Called at each stop with a message and the fraction of the log that is read.
    pictures
        Given a frame of each usable stop, so that none need be decoded again to be shown.

    Raises
    ------
    DetectError
        If the log cannot be read, or the box was seen at fewer than three stops and in too few frames on the move; the
        message says what to do.

    Examples
    --------
    >>> import boxcal
    >>> drive = boxcal.extract("robots/r01.mcap", "box/target.json")
    >>> len(drive.stops), drive.stops[0].uv_px.shape[1]
    (5, 2)
    """
    path = Path(path)
    report = progress or _silent
    box, recording = given_target(target), open_recording(path, topics, units, nominal)
    for note in recording.notes:
        report(note, 0.0)
    return extract_recording(recording, box, settings=settings, progress=report, pictures=pictures)


def extract_recording(
    recording: Recording,
    target: Target,
    *,
    settings: ExtractSettings | None = None,
    progress: Progress | None = None,
    pictures: Pictures | None = None,
) -> Correspondences:
    """Return what a robot saw and did in a recording that is open already; as :func:`extract`."""
    settings, report = settings or ExtractSettings(), progress or _silent
    stops = find_stops(recording.wheels, settings.stops)
    prepare(lambda line: report(line, 0.0))
    found = _seen(recording, stops, target, settings, report, pictures)
    if _clock_in_doubt(stops, found):
        recording = recording.with_all_images()
        offset = _offset_by_pictures(recording, stops)
        if offset is not None:
            recording = recording.with_clock_offset(offset)
            found = _seen(recording, stops, target, settings, report, pictures)
    recording.refuse_times_apart()
    found, looked_for = as_built(
        found, target, report, lambda box, known: _seen(recording, stops, box, settings, report, pictures, known)
    )
    look, seen = found
    moving: tuple[MovingFrame, ...] = ()
    if len(seen) < MIN_STOPS:
        why = look.why_not(len(stops), len(seen), settings.stops, settings.min_tags)
        seen, moving = [], look.on_the_move() if settings.moving and len(stops) < MIN_STOPS else ()
        if len(moving) < LEAST_WITHOUT_STOPS:
            raise DetectError(why, source=recording.path.name)
        report(f"{TOO_FEW_PLACES}: {len(moving)} frames taken on the move stand for stops", 1.0)
    covs = covariances([at.corners for at in seen], settings.floor_px)
    drive = Correspondences(
        robot=robot_name_of(recording.path),
        image_size=look.image_size,
        wheels=recording.wheels,
        stops=tuple(
            observation(at.stop, at.corners, cov, target, at.rejected) for at, cov in zip(seen, covs, strict=True)
        ),
        source=replace(source_of(recording, target_sha256(target), look.notes()), print_sizes=look.print_sizes),
        units=recording.units,
    )
    if seen and settings.moving:
        seen_on = drive if looked_for is target else _with_box(drive, looked_for)
        views = None if settings.predictor is None else settings.predictor(seen_on)
        moving = look.between([at.stop for at in seen], stops, looked_for, views)
    return replace(drive, moving=tuple(replace(frame, p_box=target.p_box(frame.landmark_ids)) for frame in moving))


def _seen(  # noqa: PLR0917
    recording: Recording,
    stops: tuple[Stop, ...],
    target: Target,
    settings: ExtractSettings,
    report: Progress,
    pictures: Pictures | None,
    known: KnownBox | None = None,
) -> Seen:
    """Return who looked at the stops, and what was seen at each that is usable."""
    bits, size = _bits_and_size(recording, stops, settings)
    look = BoxAtStops(recording, target, _tag_settings(settings), bits, size, known)
    seen: list[SeenStop] = []
    for number, stop in enumerate(stops, 1):
        detections, left_out = look.at(frames_at(recording, stop, settings.settle, settings.max_frames), number - 1)
        usable = detections.tags >= settings.min_tags
        report(
            f"stop {number} of {len(stops)}: {detections.frames} frames, {detections.tags} tags"
            f"{f' (frames left out: {left_out})' if left_out else ''}{'' if usable else ', left out'}",
            number / len(stops),
        )
        if usable:
            seen.append(SeenStop(number=number - 1, stop=stop, corners=detections, rejected=look.rejected[-1]))
            if pictures is not None and look.last_frame is not None:
                pictures(stop.t_start_ns, look.last_frame)
    return look, seen


def _with_box(drive: Correspondences, box: Target) -> Correspondences:
    """Return a drive with landmarks where another box has them."""
    return replace(drive, stops=tuple(replace(stop, p_box=box.p_box(stop.landmark_ids)) for stop in drive.stops))


def _clock_in_doubt(stops: tuple[Stop, ...], found: Seen) -> bool:
    """Return whether stops that show too little or move give cause to compare the camera's clock with the wheels'."""
    look, seen = found
    few = len(seen) < MIN_STOPS or len(seen) <= len(stops) / 2
    return len(stops) >= MIN_STOPS and (few or look.moved > len(stops) / 3)


def _offset_by_pictures(recording: Recording, stops: tuple[Stop, ...]) -> int | None:
    """Return by how many ns the camera's clock is ahead by its images, None if that is little or undetermined."""
    stands = np.array([(stop.t_start_ns, stop.t_end_ns) for stop in stops], dtype=np.int64)
    offset = clock_offset_by_pictures(recording, stands)
    return offset if offset is not None and abs(offset) > _LEAST_OFFSET_NS else None


def frames_at(recording: Recording, stop: Stop, settle: float, max_frames: int) -> Ids:
    """Return the frames of a stop to look at: away from its ends if there are such, at most ``max_frames``.

    Of more frames every second, fourth, eighth ... of the topic's is taken, which a reader can do in passing.
    """
    margin = round(settle * 1e9)
    frames = recording.frames_between(stop.t_start_ns + margin, stop.t_end_ns - margin)
    if frames.size == 0:
        frames = recording.frames_between(stop.t_start_ns, stop.t_end_ns)
    stride = 1
    while (kept := frames[recording.frame_numbers[frames] % stride == 0]).size > max_frames:
        stride *= 2
    return kept if kept.size else frames[frames.size // 2 :][:1]


def _bits_and_size(
    recording: Recording, stops: tuple[Stop, ...], settings: ExtractSettings
) -> tuple[int, tuple[int, int]]:
    """Return the bits of the camera's grey levels, as given or found, and the usual size of its images, px.

    A number of bits too small is refused.
    """
    some = recording.read_raw_frames(_some_frames(recording, stops, settings))
    looked_at = [(bits_of(image), (image.shape[1], image.shape[0])) for _, image in some]
    found, given = max((bits for bits, _ in looked_at), default=8), settings.bits
    if given is not None and found > given:
        raise DetectError(
            f"images in {printable(recording.camera_topic)} have values of {found} bits, {given} or fewer are expected",
            source=recording.path.name,
            remedy=f"give bits {found} or none",
        )
    sizes = [size for _, size in looked_at]
    return given or found, max(sizes, key=sizes.count, default=(0, 0))


def _tag_settings(settings: ExtractSettings) -> TagSettings:
    """Return the tag settings under the response curve that was given; without one it is estimated from the tags."""
    if settings.response is None:
        return settings.tags
    corners = replace(settings.tags.corners, response=settings.response)
    return replace(settings.tags, response=settings.response, corners=corners)


def _some_frames(recording: Recording, stops: tuple[Stop, ...], settings: ExtractSettings) -> Ids:
    """Return one frame each of a few stops."""
    first = [f for f in (frames_at(recording, s, settings.settle, 1) for s in stops) if f.size]
    if not first:
        return np.arange(min(recording.frame_t_ns.size, 1), dtype=np.int64)
    return np.concatenate(first)[:: -(-len(first) // _SOME_FRAMES)]


def observation(
    stop: Stop, detections: AveragedCorners, cov_px2: Array, target: Target, rejected_tags: int = 0
) -> StopObservation:
    """Return a stop of the wheels with what its images show, and the covariance (L, 2, 2), px^2, of each landmark."""
    return StopObservation(
        t_start_ns=stop.t_start_ns,
        t_end_ns=stop.t_end_ns,
        first_sample=stop.first_sample,
        last_sample=stop.last_sample,
        phi_R=stop.phi_R,
        phi_L=stop.phi_L,
        landmark_ids=detections.landmark_ids,
        faces=target.faces(detections.landmark_ids),
        p_box=target.p_box(detections.landmark_ids),
        uv_px=detections.uv_px,
        cov_px2=cov_px2,
        frames=detections.frames,
        rejected_tags=rejected_tags,
    )


def _silent(_: str, __: float) -> None:
    return
