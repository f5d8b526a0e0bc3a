"""From a log to correspondences: open it, find the stops, look at each, keep what can be used."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from boxcal.detect.alignment.compilation import prepare
from boxcal.detect.alignment.detector import KnownCamera
from boxcal.detect.correspondences import Correspondences, Source, StopObservation
from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DEPTHS, DeepGrey, eight_bits
from boxcal.detect.image.response_curve import Response
from boxcal.detect.log.recording import Recording, file_sha256, open_recording
from boxcal.detect.log.safe_text import listed, printable
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import WheelUnits
from boxcal.detect.stops import Stop, StopSettings, find_stops
from boxcal.detect.tags.averaging import FLOOR_PX, AveragedCorners, covariances
from boxcal.detect.tags.detections import TagSettings, other_family
from boxcal.detect.tags.stop_measurement import measure_stop
from boxcal.one_thread import one_thread
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256

MIN_STOPS = 3
_SOME_FRAMES = 5

Progress = Callable[[str], None]
"""Takes a line that says how far the work is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractSettings:
    """How correspondences are extracted.

    Attributes
    ----------
    stops, tags
        How stops and tags are found.
    response
        The camera response function (``srgb`` or ``linear``); None tells it from the tags of the first stops.
    bits
        Of the grey levels of a camera of more than 8 bits (10, 12, 14, 16), as its messages do not say how many of
        their 16 are used; None tells it from the largest value in some frames. It matters little where the response
        curve is linear.
    settle : s
        Frames this soon after coming to rest or before leaving are used only if there are no others.
    max_frames
        Most frames of one stop that are looked at, spread evenly.
    min_tags
        Fewest tags that make a stop usable.
    floor_px : px
        Standard deviation per axis below which no corner is believed.
    """

    stops: StopSettings = field(default_factory=StopSettings)
    tags: TagSettings = field(default_factory=TagSettings)
    response: Response | None = None
    bits: int | None = None
    settle: float = 0.1
    max_frames: int = 20
    min_tags: int = 4
    floor_px: float = FLOOR_PX

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
    target: Target,
    *,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    settings: ExtractSettings | None = None,
    progress: Progress | None = None,
) -> Correspondences:
    """Return what a robot saw at each stop and what its wheels did between.

    Stops without frames or without enough of the target are left out; the wheel samples remain whole.

    Parameters
    ----------
    path
        The log (MCAP, ROS 2).
    target
        The box that the robot looked at.
    topics
        Names where the log is ambiguous.
    units
        What the wheel readings mean; rad, rolling forward, if None.
    settings
        The defaults if None.
    progress
        Told of each stop.

    Raises
    ------
    DetectError
        If the log cannot be read or has fewer than three stops that see the box; the message says what to do.

    Examples
    --------
    >>> import boxcal
    >>> drive = boxcal.extract("robots/r01.mcap", boxcal.make_target())
    >>> len(drive.stops), drive.stops[0].uv_px.shape[1]
    (5, 2)
    """
    path = Path(path)
    settings = settings or ExtractSettings()
    tell = progress or _silent
    recording = open_recording(path, topics, units)
    stops = find_stops(recording.wheels, settings.stops)
    prepare(lambda line: tell(f"{path.name}: {line}"))
    settings = replace(settings, bits=_bits(recording, stops, settings))
    look = _Look(recording, target, replace(settings, tags=_tag_settings(settings)))
    seen: list[tuple[Stop, AveragedCorners]] = []
    for number, stop in enumerate(stops, 1):
        detections, left_out = look.at(stop)
        usable = detections.tags >= settings.min_tags
        tell(
            f"{path.name}: stop {number} of {len(stops)}: {detections.frames} frames, {detections.tags} tags"
            f"{f' (frames left out: {left_out})' if left_out else ''}{'' if usable else ', left out'}"
        )
        if usable:
            seen.append((stop, detections))
    if len(seen) < MIN_STOPS:
        raise DetectError(f"{path.name}: {look.why_not(len(stops), len(seen))}")
    covs = covariances([detections for _, detections in seen], settings.floor_px)
    return Correspondences(
        robot=path.stem,
        image_size=look.image_size,
        wheels=recording.wheels,
        stops=tuple(_view(stop, detections, cov, target) for (stop, detections), cov in zip(seen, covs, strict=True)),
        source=Source(log=path.name, sha256=file_sha256(path), target_sha256=target_sha256(target)),
        units=units or WheelUnits(),
    )


def frames_at(recording: Recording, stop: Stop, settle: float, max_frames: int) -> Ids:
    """Return the frames of a stop to look at: away from its ends if there are such, at most ``max_frames``."""
    margin = round(settle * 1e9)
    frames = recording.frames_between(stop.t_start_ns + margin, stop.t_end_ns - margin)
    if frames.size == 0:
        frames = recording.frames_between(stop.t_start_ns, stop.t_end_ns)
    if frames.size > max_frames:
        frames = frames[np.round(np.linspace(0, frames.size - 1, max_frames)).astype(np.int64)]
    return frames


def _bits(recording: Recording, stops: tuple[Stop, ...], settings: ExtractSettings) -> int:
    """Return the bits of the camera's grey levels, as given or told; a number too small is refused."""
    told, given = recording.used_bits(_some_frames(recording, stops, settings)), settings.bits
    if given is not None and told > given:
        who = f"{recording.path.name}: images in {printable(recording.camera_topic)}"
        raise DetectError(f"{who} have values of {told} bits, {given} or fewer are expected; give bits {told} or none")
    return given or told


def _tag_settings(settings: ExtractSettings) -> TagSettings:
    """Return the tag settings under the response curve that was given; without one the tags tell it."""
    if settings.response is None:
        return settings.tags
    corners = replace(settings.tags.corners, response=settings.response)
    return replace(settings.tags, response=settings.response, corners=corners)


def _some_frames(recording: Recording, stops: tuple[Stop, ...], settings: ExtractSettings) -> Ids:
    """Return one frame each of a few stops."""
    first = [f for f in (frames_at(recording, s, settings.settle, 1) for s in stops) if f.size]
    return np.concatenate(first)[:: -(-len(first) // _SOME_FRAMES)] if first else np.zeros(0, dtype=np.int64)


class _Look:
    """Looks at stops, and remembers what explains a failure."""

    def __init__(self, recording: Recording, target: Target, settings: ExtractSettings) -> None:
        self._recording, self._target, self._settings = recording, target, settings
        self._frames = self._with_frames = self._with_tags = 0
        self._foreign: set[int] = set()
        self._example: DeepGrey | None = None
        self._camera: KnownCamera | None = None
        self.image_size = (0, 0)

    def at(self, stop: Stop) -> tuple[AveragedCorners, str]:
        """Return what the frames of a stop show, and which of them were left out and why."""
        frames = frames_at(self._recording, stop, self._settings.settle, self._settings.max_frames)
        found = measure_stop(self._images(frames), self._target, self._settings.tags, self._camera)
        self._camera = found.camera
        self._foreign.update(found.foreign_ids.tolist())
        self._with_frames += bool(found.corners.frames)
        self._with_tags += found.corners.tags > 0
        return found.corners, found.left_out

    def _images(self, frames: Ids) -> Iterator[DeepGrey]:
        for t_ns, image in self._recording.read_deep_frames(frames, self._settings.bits or 8):
            size = (image.shape[1], image.shape[0])
            if self.image_size not in {(0, 0), size}:
                raise DetectError(
                    f"{self._recording.path.name}: images change from {_size(self.image_size)} to {_size(size)} px at "
                    f"{t_ns / 1e9:.3f} s, one size is needed; record with one camera mode"
                )
            self.image_size = size
            self._frames += 1
            self._example = image
            yield image

    def why_not(self, stops: int, usable: int) -> str:
        """Return why fewer than three stops are usable, and what to do."""
        least = self._settings.min_tags
        if stops >= MIN_STOPS and self._frames == 0:
            return (
                f"{stops} stops but no image was taken during any of them, images while the robot stands are needed; "
                "record the camera all the time, stamped with the wheels' clock"
            )
        if self._frames and not self._with_tags:
            return (
                f"no tag of the box in the {self._frames} images looked at at {self._with_frames} stops{self._hint()}"
            )
        return (
            f"{stops} stops of {self._settings.stops.min_stand:g} s or longer, {self._with_frames} of them with "
            f"images, {self._with_tags} with the box, {usable} with {least} tags or more; "
            f"{MIN_STOPS} such stops are needed; let the robot stand still for two seconds in more places "
            "where it sees the box"
        )

    def _hint(self) -> str:
        box = self._target.box
        ids = self._target.tag_ids
        if self._foreign:
            return (
                f": tags {listed(map(str, sorted(self._foreign)))} of {box.dictionary} were seen, the target carries "
                f"{ids[0]} to {ids[-1]}; give the target.json that this box was printed from"
            )
        other = (
            None
            if self._example is None
            else other_family(eight_bits(self._example), box.dictionary, self._settings.tags)
        )
        if other is not None:
            return (
                f": tags of {other} were seen, the target carries {box.dictionary}; give the target.json that this box "
                "was printed from"
            )
        where = printable(self._recording.camera_topic)
        return f" of {where}; check that the camera sees the box, in focus and lit, and that this is its target.json"


def _view(stop: Stop, detections: AveragedCorners, cov_px2: Array, target: Target) -> StopObservation:
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
    )


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _silent(_: str) -> None:
    return
