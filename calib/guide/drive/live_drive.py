"""The drive as it is heard: wheels, stands and images kept up to date, and what of it to measure next."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.guide.drive.frames_at_rest import BEFORE_NS, FramesAtRest, HeldFrame
from boxcal.calib.guide.drive.stand import Stands, resting_all_along, stands_of
from boxcal.calib.guide.drive.taken_stops import TakenStops
from boxcal.calib.guide.drive.wheels_so_far import WheelsSoFar
from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.calib.settings import Settings
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.log.clocks import offset_by_recording
from boxcal.detect.log.containers.base import ros_type
from boxcal.detect.log.images import frame_id_of, image_stamp_ns
from boxcal.detect.log.source import Source
from boxcal.detect.log.wheel_assembly import AssembledWheels
from boxcal.detect.stops import Stop
from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256

HOLD_S = 2.0
"""Time for which the robot is asked to stand."""
_ENOUGH_FRAMES = 4
_PATIENCE_S = 2.0
"""Time beyond which a stop is measured from fewer images than enough."""
_REMEMBERED = 400
"""Images whose stamps determine the camera's clock."""
_CLOCK_STEP_NS = 50_000_000


class LiveDrive:
    """One drive, from its first message on.

    Attributes
    ----------
    wheels
        Takes the wheels' messages.
    samples
        Wheel samples so far; None where there are none yet.
    stands
        When the robot stood; None where the wheels do not determine it yet.
    taken
        Stops that were measured.
    newest
        The newest image.
    pictures
        How many images were heard.
    damaged
        Sentence about images without a stamp that can be read; empty if all have one.
    """

    def __init__(self, robot: str, target: Target, settings: Settings) -> None:
        nominal = settings.nominal
        self.wheels = WheelsSoFar(
            robot,
            settings.topics,
            settings.wheel_units,
            None if nominal is None else (nominal.wheel_radius, nominal.wheel_separation),
        )
        self.samples: AssembledWheels | None = None
        self.stands: Stands | None = None
        self.taken = TakenStops(target=target)
        self.newest: HeldFrame | None = None
        self.pictures, self.damaged = 0, ""
        self._robot, self._target = robot, target
        self._frames = FramesAtRest()
        self._clock_ns = 0
        self._stamps: list[tuple[int, int]] = []
        self._final: set[int] = set()
        self._tried: tuple[int, ...] = ()
        self._camera = ("", "")

    def take(self, messages: Sequence[LiveMessage]) -> None:
        """Take messages in the order in which they were kept (DetectError if there are unreasonably many)."""
        self.wheels.take([m for m in messages if not m.picture])
        for message in messages:
            if message.picture:
                self._picture(message)

    def _picture(self, message: LiveMessage) -> None:
        channel, number = message.channel, self.pictures
        self.pictures += 1
        kind = ros_type(channel.type) if channel.encoding != "protobuf" else channel.type
        try:
            stamp = image_stamp_ns(channel, kind, memoryview(message.data), message.log_ns) or message.log_ns
            if not self._camera[0]:
                self._camera = (channel.topic, frame_id_of(channel, message.data))
        except DetectError as error:
            self.damaged = f"{channel.topic}: {error}"
            return
        self._stamps = [*self._stamps[-_REMEMBERED:], (stamp, message.log_ns)]
        frame = HeldFrame(stamp - self._clock_ns, number, channel, message.data)
        self._frames.add(frame)
        if self.newest is None or frame.t_ns >= self.newest.t_ns or self.newest.t_ns - frame.t_ns > 10 * BEFORE_NS:
            self.newest = frame

    def update(self) -> None:
        """Bring samples and stands up to date, and let go of images that no stop needs."""
        self.samples = self.wheels.samples()
        if self.samples is not None:
            self.stands = stands_of(self.samples.wheels)
            self._compare_clocks(self.samples)
        else:
            rest = self.wheels.resting_since_ns
            self.stands = resting_all_along(*rest) if rest is not None else None
        if self.stands is not None:
            needed = [s.t_start_ns for s in self.stands.stops[-3:] if s.t_start_ns not in self._final]
            self._frames.forget_before(min([*needed, self.stands.now_ns - BEFORE_NS]))

    @property
    def stops_taken(self) -> int:
        """Number of stops of the wheels that were measured: those that a calibration is made from."""
        return 0 if self.stands is None else len(self.taken.matched(self.stands.stops))

    @property
    def stands_taken(self) -> bool:
        """Whether the robot stands at a stop that was measured."""
        stands = self.stands
        return stands is not None and stands.standing and self.taken.holds(stands.stops[-1])

    @property
    def clock_offset(self) -> float:
        """Time by which the camera's clock is ahead of the wheels', s; 0 if it is not."""
        return self._clock_ns / 1e9

    @property
    def is_behind(self) -> bool:
        """Whether a stop that the robot has left waits to be measured: what comes after it should wait, too."""
        if self.stands is None:
            return False
        left = self.stands.stops[-3:-1] if self.stands.standing else self.stands.stops[-3:]
        return any(s.t_start_ns not in self._final and self._frames.any_between(s.t_start_ns, s.t_end_ns) for s in left)

    def to_measure(self, *, at_end: bool = False) -> tuple[Stop, list[HeldFrame]] | None:
        """Return the stop that is to be measured now, with its images; None if none is.

        Parameters
        ----------
        at_end
            Whether the drive is to be calibrated now, so that a stand which goes on counts with all its images.
        """
        if self.stands is None or not self.stands.stops:
            return None
        settings = self.taken.settings
        for stop in self.stands.stops[-3:]:
            going_on = self.stands.standing and stop is self.stands.stops[-1]
            if stop.t_start_ns in self._final or (going_on and self.taken.holds(stop) and not at_end):
                continue
            frames = self._frames.of_stop(stop.t_start_ns, stop.t_end_ns, settings.settle, settings.max_frames)
            seconds = (stop.t_end_ns - stop.t_start_ns) / 1e9
            enough = _ENOUGH_FRAMES if seconds < HOLD_S + _PATIENCE_S else 1
            if going_on and not at_end and (seconds < HOLD_S or len(frames) < enough):
                continue
            if not going_on:
                self._final.add(stop.t_start_ns)
            numbers = tuple(f.number for f in frames)
            if frames and numbers != self._tried:
                self._tried = numbers
                return stop, frames
        return None

    def correspondences(self, log: str) -> Correspondences | None:
        """Return what was seen and rolled so far, None as long as the wheels have not moved or no stop was taken."""
        samples, size = self.samples, self.taken.image_size
        if samples is None or size is None:
            return None
        seen = self.taken.observations(stands_of(samples.wheels).stops)
        return Correspondences(
            robot=self._robot,
            image_size=size,
            wheels=samples.wheels,
            stops=seen,
            source=self._source(log, samples),
            units=samples.units,
        )

    def _source(self, log: str, samples: AssembledWheels) -> Source:
        about = self.wheels.scan.readings.metadata
        radius, separation = samples.nominal or about.nominal_wheels() or (0.0, 0.0)
        odometry = next((o.base_frame for o in self.wheels.scan.readings.odometry.values() if o.base_frame), "")
        base = odometry or about.base_frame()
        T_base_cam, choice = about.fixed_transform(base, self._camera[1]), self.wheels.choice
        return Source(
            log=log,
            target_sha256=target_sha256(self._target),
            kind="MCAP",
            camera_topic=self._camera[0],
            camera_frame=self._camera[1],
            base_frame=base,
            wheel_topics=() if choice is None else choice.topics,
            wheel_quantity="positions" if choice is None else str(choice.quantity),
            nominal_radius=radius,
            nominal_separation=separation,
            nominal_T_base_cam=() if T_base_cam is None else tuple(float(v) for v in T_base_cam.ravel()),
            clock_offset=self.clock_offset,
            notes=(*samples.notes, *self.wheels.notes),
        )

    def _compare_clocks(self, samples: AssembledWheels) -> None:
        """Put the camera's stamps on the wheels' clock, where the times of arrival say that they differ."""
        stamps = np.array(self._stamps, dtype=np.int64).reshape(-1, 2)
        offset = offset_by_recording(stamps[:, 0], stamps[:, 1], samples.stamp_ns, samples.log_ns)
        if abs(offset - self._clock_ns) > _CLOCK_STEP_NS:
            self._clock_ns = offset
            self._frames = FramesAtRest()
            self.newest = None
