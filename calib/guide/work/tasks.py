"""The work of a drive in progress, one task at a time: stops measured, estimate, next stops, full calibration."""

import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.guide.drive.glance import Glance, glance
from boxcal.calib.guide.estimate.advice import Place, bars, first_places, next_places
from boxcal.calib.guide.estimate.full_solution import Copy
from boxcal.calib.guide.progress import Progress
from boxcal.calib.guide.recording.recorder import Recorder
from boxcal.calib.guide.work.worker import Worker
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey, full_scale
from boxcal.detect.log.images import VideoPacket, decode_frame
from boxcal.target.camera.camera_model import CameraModel
from boxcal.target.errors import BoxcalError

_NUMERIC = (cv2.error, np.linalg.LinAlgError)
"""Errors of libraries on odd images or equations; one of them must not end the drive."""
_GLANCE_S, _GLANCE_FACTOR = 0.15, 2.0
"""Time between looks at images: at least this, and this many times what one takes; other work is more pressing."""
_JUDGED_FROM = 4
"""Number of stops from which on the full calibration is run."""


class Tasks:
    """Gives the work of a drive in progress to two threads, the most pressing first, and takes what they finish.

    Attributes
    ----------
    progress
        The drive.
    said
        Lines for the terminal are added to it.
    """

    def __init__(self, progress: Progress, said: "deque[str]") -> None:
        self.progress, self.said = progress, said
        self._worker, self._eyes = Worker(), Worker()
        self._measure_due = 0.0
        self._glanced, self._next_glance, self._glance_begun = -1, 0.0, 0.0

    @property
    def idle(self) -> bool:
        """Whether no task runs but a look at an image."""
        return self._worker.idle

    @property
    def is_calibrating(self) -> bool:
        """Whether the calibration that was asked for is under way."""
        now = self.progress
        asked = now.wants["calibrate"] or (not self._worker.idle and self._worker.name == "finish")
        return asked or now.full.is_writing

    def close(self) -> None:
        """Wait for what runs, and end the threads."""
        self._worker.close()
        self._eyes.close()

    def begin_next(self, recorder: Recorder | None, *, compiled: bool) -> None:
        """Begin what is most pressing; images are looked at beside that.

        Parameters
        ----------
        recorder
            What records the drive; None if nothing does.
        compiled
            Whether detector and likelihood are compiled.
        """
        self._look()
        if not self._worker.idle:
            return
        now, name = self.progress, "drive" if recorder is None else recorder.path.name
        due = now.drive.to_measure() if compiled else None
        if due is not None:
            self._measure_due = time.monotonic()
            self._worker.begin("measure", lambda: self._measured(due, name))
        elif now.wants["calibrate"]:
            now.wants["calibrate"] = False
            last = now.drive.to_measure(at_end=True)
            self._worker.begin("finish", lambda: (self._all_seen(last, name), recorder, _copy_of(recorder)))
        elif compiled and (now.wants["advise"] or now.outlook.placed_after != now.drive.stops_taken):
            now.wants["advise"] = False
            count = now.drive.stops_taken
            self._worker.begin("advise", lambda: (count, self._advice()))
        elif now.wants["solve"] and now.running.estimate is not None:
            now.wants["solve"] = False
            self._worker.begin("solve", self._solved)
        seen = now.running.seen
        if now.wants["judge"] and now.full.idle and seen is not None and now.running.estimate is not None:
            now.wants["judge"] = False
            now.full.judge(seen)

    def collect(self) -> None:
        """Take what is finished."""
        now = self.progress
        look, t = self._eyes.finished(), time.monotonic()
        if look is not None:
            self._next_glance = max(self._next_glance, t + _GLANCE_FACTOR * (t - self._glance_begun))
            now.outlook.seen = look[1] or now.outlook.seen
        done = self._worker.finished()
        if done is not None:
            name, result = done
            if name == "advise":
                now.outlook.placed_after, now.outlook.places = result
            elif name == "solve":
                now.wants["advise"] = True
            elif name == "measure":
                self._took(*result)
            elif name == "finish":
                self._finish(*result)
        if now.full.collect():
            result, robot = now.full.written, now.options.robot
            self.said.append(f"{robot}: {str(result['level']).upper()} - {result['headline']}")
            self.said.append(f"written: {now.options.out / robot}")

    def _look(self) -> None:
        """Have the newest image looked at, some times a second."""
        frame, camera, t = self.progress.drive.newest, self.progress.camera, time.monotonic()
        if frame is None or frame.number == self._glanced or t < self._next_glance or not self._eyes.idle:
            return
        self._glanced, self._next_glance, self._glance_begun = frame.number, t + _GLANCE_S, t
        self._eyes.begin("glance", lambda: self._looked_at(frame, camera))

    def _looked_at(self, frame: Any, camera: CameraModel | None) -> Glance | None:
        try:
            image = decode_frame(frame.channel, frame.data)
            if isinstance(image, VideoPacket):
                return None
            shown: DeepGrey = full_scale(image, 8)
            return glance(shown, frame.t_ns, self.progress.options.target, camera)
        except (DetectError, *_NUMERIC) as error:
            self.progress.drive.damaged = f"{frame.channel.topic}: {error}"
            return None

    def _measured(self, due: Any, log: str) -> tuple[bool, bool]:
        """Measure a stop and bring the estimate up to date; return whether it was taken, and whether it is new."""
        now = self.progress
        before = len(now.drive.taken.stops)
        try:
            taken = now.drive.taken.take(*due)
        except (BoxcalError, *_NUMERIC) as error:
            now.problems["stop"] = f"a stop could not be measured ({error}); it is left out"
            return False, False
        if taken is None:
            return False, False
        now.problems["stop"] = ""
        self._estimate(lambda: self._grown(log))
        return True, len(now.drive.taken.stops) > before

    def _grown(self, log: str) -> None:
        drive = self.progress.drive.correspondences(log)
        if drive is not None:
            self.progress.running.grow(drive)

    def _solved(self) -> None:
        """Solve all that was seen anew."""
        running = self.progress.running
        drive = running.seen
        if drive is not None:
            self._estimate(lambda: running.solve(drive))

    def _estimate(self, update: Callable[[], object]) -> None:
        """Update the estimate, and put the goals beside what is estimated then."""
        now = self.progress
        try:
            update()
            found, drive = now.running.estimate, now.running.drive
            now.outlook.bars = (
                bars(found, now.options.goal, drive.image_size) if found is not None and drive is not None else ()
            )
            now.problems["estimate"] = ""
        except (BoxcalError, *_NUMERIC) as error:
            now.problems["estimate"] = f"the estimate could not be updated ({error})"

    def _all_seen(self, last: Any, log: str) -> Correspondences | None:
        """Return all that was seen, the stand that still goes on with its newest images."""
        drive = self.progress.drive
        try:
            if last is not None:
                drive.taken.take(*last)
            return drive.correspondences(log)
        except (BoxcalError, *_NUMERIC) as error:
            self.progress.problems["stop"] = f"the last stop could not be measured ({error})"
            return None

    def _advice(self) -> tuple[Place, ...]:
        now = self.progress
        found, drive, target = now.running.estimate, now.running.drive, now.options.target
        try:
            if found is not None and drive is not None:
                places = next_places(found, drive, target, now.options.goal)
                now.problems["plan"] = ""
                return places
        except (CalibError, *_NUMERIC) as error:
            now.problems["plan"] = f"no next stop could be planned ({error}); drive on around the box"
            return ()
        return first_places(target, len(now.drive.taken.stops), now.drive.taken.image_size)

    def _took(self, usable: bool, new: bool) -> None:
        if not usable:
            return
        drive, outlook = self.progress.drive, self.progress.outlook
        t, count = time.monotonic(), drive.stops_taken
        outlook.latency = t - self._measure_due
        if new and count == 1:
            self.progress.full.get_ready()
        if new:
            outlook.taken_at = (t, count)
            corners = drive.taken.stops[-1].corners
            self.said.append(f"stop {count} taken: {corners.tags} tags in {corners.frames} pictures")
        self.progress.wants.update(advise=True, solve=True, judge=count >= _JUDGED_FROM)

    def _finish(self, drive: Correspondences | None, recorder: Recorder | None, copy: Copy | str) -> None:
        """Begin the calibration that is written: of the recording, or of what was measured if not all was recorded."""
        now = self.progress
        now.problems["copy"] = "" if isinstance(copy, Copy) else f"frames on the move are not used: {copy}"
        if drive is None:
            nothing = "nothing to calibrate from yet: let the robot drive, and stand still before the box"
            now.full.failed = now.problems["stop"] or nothing
            return
        log = Path("drive") if recorder is None else recorder.path
        now.full.write(drive, now.options.out, log, now.options.command, copy)


def _copy_of(recorder: Recorder | None) -> Copy | str:
    """Return a finished copy of the recording so far; or why there is none, or not of all that was heard."""
    if recorder is None:
        return "the drive is not recorded"
    try:
        folder = tempfile.TemporaryDirectory(dir=recorder.path.parent, prefix=".boxcal-")
    except OSError as error:
        return f"{recorder.path.parent}: no copy of the recording can be made there ({error.strerror or error})"
    try:
        return Copy(recorder.copy(Path(folder.name)), folder)
    except CalibError as error:
        folder.cleanup()
        return str(error)
