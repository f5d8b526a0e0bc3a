"""The stops that were taken: images measured once they are there, and again when the robot has left."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from boxcal.calib.guide.drive.frames_at_rest import HeldFrame
from boxcal.detect.alignment.detection import KnownCamera
from boxcal.detect.correspondences import StopObservation
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import ExtractSettings, observation
from boxcal.detect.image.bit_depth import DeepGrey, bits_of, full_scale
from boxcal.detect.log.images import VideoPacket, decode_frame
from boxcal.detect.stops import Stop
from boxcal.detect.tags.averaging import AveragedCorners, covariances
from boxcal.detect.tags.stop_measurement import measure_stop
from boxcal.target.box import Target


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TakenStop:
    """One stop's images, measured.

    Attributes
    ----------
    t_start_ns, t_end_ns : ns
        When the robot stood, as known when they were measured.
    numbers
        Images that were used, as the recording counts them.
    corners
        What they show.
    left_out
        Images that were left out and why; empty if none was.
    rejected_tags
        How many tags of the box were read that do not lie where the box has them.
    camera
        What is known of the camera from the stop before, so that measuring again begins alike.
    """

    t_start_ns: int
    t_end_ns: int
    numbers: tuple[int, ...]
    corners: AveragedCorners
    left_out: str
    rejected_tags: int
    camera: KnownCamera | None


@dataclass(slots=True, kw_only=True, eq=False)
class TakenStops:
    """All stops taken so far, in order of time.

    Attributes
    ----------
    target
        The box.
    settings
        As for reading a recording.
    stops
        What was taken.
    image_size : px
        Width and height of the camera's images; None before the first.
    undecoded
        Sentence about an image that did not decode; empty if all did.
    """

    target: Target
    settings: ExtractSettings = field(default_factory=ExtractSettings)
    stops: list[TakenStop] = field(default_factory=list)
    image_size: tuple[int, int] | None = None
    undecoded: str = ""
    _bits: int | None = None
    _camera: KnownCamera | None = None

    def take(self, stop: Stop, frames: Sequence[HeldFrame]) -> TakenStop | None:
        """Measure a stop, or measure it again with the images that there are now; return it if it can be used.

        Parameters
        ----------
        stop
            When the robot stood.
        frames
            Its images.
        """
        again = next((k for k, s in enumerate(self.stops) if _overlap(s, stop)), None)
        numbers = tuple(f.number for f in frames)
        if again is not None and self.stops[again].numbers == numbers:
            self.stops[again] = replace(self.stops[again], t_start_ns=stop.t_start_ns, t_end_ns=stop.t_end_ns)
            return self.stops[again]
        before = self._camera if again is None else self.stops[again].camera
        images = self._decoded(frames)
        if not images:
            return None
        found = measure_stop(images, self.target, self.settings.tags, before)
        if again is None or again == len(self.stops) - 1:
            self._camera = found.camera
        if found.corners.tags < self.settings.min_tags:
            return None
        taken = TakenStop(
            t_start_ns=stop.t_start_ns,
            t_end_ns=stop.t_end_ns,
            numbers=numbers,
            corners=found.corners,
            left_out=found.left_out,
            rejected_tags=len(found.rejected_ids),
            camera=before,
        )
        if again is None:
            self.stops = sorted([*self.stops, taken], key=lambda s: s.t_start_ns)  # others may be reading the old list
        else:
            self.stops[again] = taken
        return taken

    def observations(self, stops: Sequence[Stop]) -> tuple[StopObservation, ...]:
        """Return what was seen at those stops of the wheels that were taken.

        Parameters
        ----------
        stops
            All stops that the wheels show.
        """
        pairs = self.matched(stops)
        covs = covariances([taken.corners for _, taken in pairs], self.settings.floor_px)
        return tuple(
            observation(stop, taken.corners, cov, self.target, taken.rejected_tags)
            for (stop, taken), cov in zip(pairs, covs, strict=True)
        )

    def matched(self, stops: Sequence[Stop]) -> list[tuple[Stop, TakenStop]]:
        """Return the stops of the wheels that were taken, each with its measurement.

        As samples come, a stand may turn out to be two, two to be one, or none (a nudge, and a longer stand after it).
        Each measurement belongs to the one stop with which it shares most time, and a stop has one measurement.
        """
        found: dict[int, TakenStop] = {}
        for taken in self.stops:
            shared = [_shared_ns(taken, stop) for stop in stops]
            k = int(np.argmax(shared)) if shared else 0
            if shared and shared[k] >= 0 and (k not in found or shared[k] > _shared_ns(found[k], stops[k])):
                found[k] = taken
        return [(stops[k], found[k]) for k in sorted(found)]

    @property
    def camera(self) -> KnownCamera | None:
        """Knowledge of the camera from the last stop; None where nothing is known yet."""
        return self._camera

    def holds(self, stop: Stop) -> bool:
        """Return whether a stop was taken."""
        return any(_overlap(taken, stop) for taken in self.stops)

    def _decoded(self, frames: Sequence[HeldFrame]) -> list[DeepGrey]:
        """Return the images of the usual size, with the camera's bits at full scale; others are left out."""
        images = []
        for frame in frames:
            try:
                image = decode_frame(frame.channel, frame.data)
            except DetectError as error:
                self.undecoded = str(error)
                continue
            if isinstance(image, VideoPacket):
                self.undecoded = "the camera sends a video, pictures are needed"
                continue
            size = (image.shape[1], image.shape[0])
            self.image_size = self.image_size or size
            if size == self.image_size:
                images.append(image)
        if images and self._bits is None:
            self._bits = self.settings.bits or max(bits_of(image) for image in images)
        return [np.asarray(full_scale(image, self._bits or 8)) for image in images]


def _overlap(taken: TakenStop, stop: Stop) -> bool:
    """Return whether a stop that was taken is this one of the wheels."""
    return _shared_ns(taken, stop) >= 0


def _shared_ns(taken: TakenStop, stop: Stop) -> int:
    """Return the time, ns, that both have in common; negative if none."""
    return min(taken.t_end_ns, stop.t_end_ns) - max(taken.t_start_ns, stop.t_start_ns)
