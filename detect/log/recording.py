"""A robot's recording: wheel samples as arrays, camera frames lazily by time.

Header stamps are the time base: they say when a sample was taken. Times of recording say when a message arrived, late
by an unknown delay; they stand in where there are no stamps, and show that two clocks differ. One pass
(:mod:`boxcal.detect.log.scan`) reads all wheel readings and the stamps of all images, and keeps the images taken at
rest; others are read again from their place. So a recording needs no index, and memory does not grow with its images.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey, bits_of, eight_bits, full_scale
from boxcal.detect.log.encoder import span
from boxcal.detect.log.frames import FrameSource
from boxcal.detect.log.images import Grey
from boxcal.detect.log.losses import Loss
from boxcal.detect.log.metadata import Metadata
from boxcal.detect.log.signals import Quantity
from boxcal.detect.log.wheel_samples import WheelSamples, WheelUnits
from boxcal.target.arrays import Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """One recording, opened.

    Attributes
    ----------
    path
        The file or folder.
    kind
        What kind of recording it is.
    sha256
        Of its bytes, hexadecimal; empty if it was not wanted.
    camera_topic
        Where the images are.
    camera_frame
        The camera's frame as the images name it.
    odometry_frame
        The base frame as the odometry names it, empty without odometry.
    wheel_topics
        Where the wheels' readings are.
    quantity
        What they are.
    nominal : m
        Wheel radius and separation that odometry was taken apart with, None if there are wheel readings.
    wheels
        All wheel samples.
    frame_t_ns : (F,) ns
        Stamps of the images on the wheels' clock, strictly ascending.
    frame_numbers : (F,)
        Which image of the topic, in order of arrival, each of these is.
    clock_offset_ns
        By how much the images' stamps were ahead of the wheels' clock before they were put right.
    metadata
        What the recording says of the robot.
    notes
        What a user should know of how it was read: choices, losses, what was put right.
    lost_messages, lost_s
        What could not be read, as far as that is known.
    losses
        What of that, and of what the log does not say, no good calibration has; the notes say it, too.
    units
        What the wheel readings were taken for.
    source
        Decodes the frames.
    rest
        Reads the images that were passed over because the robot moved; None if there are none.
    """

    path: Path
    kind: str
    sha256: str
    camera_topic: str
    camera_frame: str
    odometry_frame: str
    wheel_topics: tuple[str, ...]
    quantity: Quantity
    nominal: tuple[float, float] | None
    wheels: WheelSamples
    frame_t_ns: Ids
    frame_numbers: Ids
    clock_offset_ns: int
    metadata: Metadata
    notes: tuple[str, ...]
    lost_messages: int
    lost_s: float
    units: WheelUnits
    source: FrameSource
    losses: tuple[Loss, ...] = ()
    rest: "Callable[[], Recording] | None" = None

    def with_all_images(self) -> "Recording":
        """Return the recording with the images that were passed over; this one is of no more use then."""
        return self if self.rest is None else self.rest()

    def frames_between(self, t_start_ns: int, t_end_ns: int) -> Ids:
        """Return the indices of the frames within a time window, both ends included."""
        first = np.searchsorted(self.frame_t_ns, t_start_ns, side="left")
        last = np.searchsorted(self.frame_t_ns, t_end_ns, side="right")
        return np.arange(first, last, dtype=np.int64)

    def frames_missing(self) -> tuple[int, str]:
        """Return how many of the frames that were looked at did not decode, and why the first did not."""
        skipped = self.source.skipped
        return len(skipped), next(iter(skipped.values()), "")

    def refuse_times_apart(self) -> None:
        """Refuse images and wheels that were stamped at times that do not overlap (DetectError)."""
        images, wheels = self.frame_t_ns, self.wheels.t_ns
        if max(images[0], wheels[0]) > min(images[-1], wheels[-1]):
            raise DetectError(
                f"images are stamped {span(images)} and wheels {span(wheels)}",
                source=self.path.name,
                needed="times that overlap are needed",
                remedy="stamp both with one clock",
            )

    def with_clock_offset(self, offset_ns: int) -> "Recording":
        """Return the recording with the images' stamps shifted back by an offset estimated from the images."""
        note = (
            f"the camera's clock is {abs(offset_ns) / 1e9:.1f} s {'ahead of' if offset_ns > 0 else 'behind'} the "
            "wheels' (its pictures stand still that much apart from them); its stamps were put right by that"
        )
        return replace(
            self,
            frame_t_ns=self.frame_t_ns - offset_ns,
            clock_offset_ns=self.clock_offset_ns + offset_ns,
            notes=(*self.notes, note),
        )

    def used_bits(self, indices: Iterable[int]) -> int:
        """Return how many bits the camera's grey levels have: 8, 10, 12, 14 or 16.

        A message says how wide its numbers are, not how many of their bits the sensor fills; that is estimated from the
        largest value in some frames. Errors as for :meth:`read_frames`.
        """
        return max((bits_of(image) for _, image in self._decoded(indices)), default=8)

    def read_raw_frames(self, indices: Iterable[int]) -> Iterator[tuple[int, DeepGrey]]:
        """Decode frames one at a time, as their messages have them (see :meth:`read_frames`)."""
        yield from self._decoded(indices)

    def read_frames(self, indices: Iterable[int]) -> Iterator[tuple[int, Grey]]:
        """Decode frames one at a time, in 8 bits: images to look at, deeper ones each at the bits it has.

        Frames that do not decode are passed over and counted (:meth:`frames_missing`).

        Parameters
        ----------
        indices
            Rows of ``frame_t_ns``; ascending is fastest.

        Yields
        ------
        Stamp (ns) and grey image (H, W).

        Raises
        ------
        DetectError
            If the recording changed since it was opened.
        """
        for t_ns, image in self._decoded(indices):
            yield t_ns, eight_bits(full_scale(image, 8))

    def read_deep_frames(self, indices: Iterable[int], bits: int) -> Iterator[tuple[int, DeepGrey]]:
        """Decode frames one at a time, with all the bits they have: what corners are measured in.

        As :meth:`read_frames`, but images of more than 8 bits stay uint16, with white at 65535.

        Parameters
        ----------
        indices
            Rows of ``frame_t_ns``; ascending is fastest.
        bits
            Of the camera's grey levels (:meth:`used_bits`); a frame with values beyond is taken to have more.
        """
        for t_ns, image in self._decoded(indices):
            yield t_ns, full_scale(image, bits)

    def _decoded(self, indices: Iterable[int]) -> Iterator[tuple[int, DeepGrey]]:
        rows = [int(i) for i in indices]
        times = {int(self.frame_numbers[i]): int(self.frame_t_ns[i]) for i in rows}
        for number, image in self.source.decoded(int(self.frame_numbers[i]) for i in rows):
            yield times[number], image
