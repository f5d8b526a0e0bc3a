"""The guide's session: messages in, state out; what takes long is done beside it, one thing at a time."""

import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.guide.drive.glance import Glance, glance
from boxcal.calib.guide.drive.live_drive import LiveDrive
from boxcal.calib.guide.estimate.advice import Place, bars, first_places, next_places, reached
from boxcal.calib.guide.estimate.full_solution import FullSolution
from boxcal.calib.guide.estimate.running import RunningEstimate
from boxcal.calib.guide.estimate.solver import Solver
from boxcal.calib.guide.outlook import GuideOptions, Outlook
from boxcal.calib.guide.recording.recorder import Recorder
from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.calib.guide.sources.link import Link
from boxcal.calib.guide.worker import Worker
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey, full_scale
from boxcal.detect.log.images import VideoPacket, decode_frame
from boxcal.target.camera.camera_model import CameraModel
from boxcal.target.errors import BoxcalError

_NUMERIC = (cv2.error, np.linalg.LinAlgError)
"""Errors of libraries on odd pictures or equations; one of them must not end the drive."""
_SPAN_NS = 500_000_000
"""Time of recording that is taken at once, so that no stop passes unnoticed where messages come faster than time."""
_WAIT_S, _TICK_S, _PUBLISH_S, _GLANCE_S = 0.04, 0.1, 0.1, 0.15
_TICK_SHARE = 5.0
"""A tick that takes long comes as many times its length later."""
_IDLE_S, _IDLE_EVERY_NS = 20.0, 2_000_000_000
"""A robot that has stood so long at a stop that was taken is left standing: its pictures are kept rarely."""
_JUDGED_FROM = 4
"""Stops from which on the full calibration is worth its time."""


class Session:
    """One drive with a guide.

    Attributes
    ----------
    options, link
        What was asked for, and where messages come from.
    drive, running, outlook
        What was heard, what is estimated, what to tell.
    full
        The full calibration, with its verdict.
    recorder
        Keeps the messages; None before the first.
    problems
        Sentences about what could not be done, by what it was; empty where it could.
    said
        Lines for the terminal that were not printed yet.
    compiling
        Sentence about what must be compiled first; empty once that is done.
    """

    def __init__(self, options: GuideOptions, link: Link) -> None:
        self.options, self.link = options, link
        self.said: deque[str] = deque(maxlen=200)
        self.compiling = "getting ready"
        self.stopped = threading.Event()
        self._requests: deque[str] = deque(maxlen=8)
        self._worker, self._eyes = Worker(), Worker()
        self._solver = Solver(options.robot, options.target)
        self._told: dict[str, str] = {}
        self._begin()
        threading.Thread(target=self._prepare, name="compile", daemon=True).start()

    def _begin(self) -> None:
        self.drive = LiveDrive(self.options.robot, self.options.target, self.options.settings)
        self.running = RunningEstimate(self.options.target)
        self.outlook = Outlook()
        self.recorder: Recorder | None = None
        self.full = FullSolution(self._solver)
        self.problems = dict.fromkeys(("recording", "messages", "stop", "estimate", "plan"), "")
        self._wants = {"advise": True, "solve": False, "judge": False, "calibrate": False}
        self._measure_due = 0.0
        self._glanced = -1
        self._idle_picture_ns = 0
        self._next_glance = 0.0

    def request(self, what: str) -> None:
        """Ask for something from the page: ``calibrate`` or ``again``."""
        self._requests.append(what)

    def run(self, publish: Callable[["Session"], None]) -> None:
        """Work until stopped; ``publish`` is called some ten times a second."""
        try:
            self._work(publish)
        finally:
            self._worker.close()
            self._eyes.close()
            self._solver.give_up()
            if self.recorder is not None:
                self.recorder.close()

    def _work(self, publish: Callable[["Session"], None]) -> None:
        next_tick = next_publish = 0.0
        while not self.stopped.is_set():
            if self.drive.is_behind:
                time.sleep(_WAIT_S)
            else:
                self.take(self.link.inbox.take(_WAIT_S, _SPAN_NS))
            now = time.monotonic()
            if now >= next_tick or self.link.inbox.waiting:
                self.drive.update()
                spent = time.monotonic() - now
                next_tick = now + max(_TICK_S, _TICK_SHARE * spent)
            self._collect()
            self._answer_requests()
            self._next_task()
            if now >= next_publish:
                next_publish = now + _PUBLISH_S
                self._tell_changes()
                publish(self)

    def take(self, messages: list[LiveMessage]) -> None:
        """Keep messages, and take them into the drive as far as they were kept."""
        if messages and self.recorder is None:
            self.recorder = self._new_recorder()
        recorder = self.recorder
        wanted = [m for m in messages if not (m.picture and self._is_idle(m.log_ns))]
        kept = [m for m in wanted if recorder is None or recorder.keep(m)]
        try:
            self.drive.take(kept)
        except DetectError as error:
            self.problems["messages"] = str(error)

    def _is_idle(self, log_ns: int) -> bool:
        """Tell whether a picture shows nothing new: the robot has stood for long at a stop that was taken."""
        stands = self.drive.stands
        if stands is None or stands.seconds < _IDLE_S or not self.drive.stands_taken:
            return False
        if abs(log_ns - self._idle_picture_ns) < _IDLE_EVERY_NS:
            return True
        self._idle_picture_ns = log_ns
        return False

    def _new_recorder(self) -> Recorder | None:
        folder, stamp = self.options.recordings, time.strftime("%Y%m%d-%H%M%S")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            return Recorder(folder / f"{self.options.robot}-{stamp}.mcap")
        except FileExistsError as error:
            if folder.is_dir():
                return None  # two drives in one second: the next message tries again
            why = error.strerror
        except OSError as error:
            why = error.strerror or str(error)
        self.problems["recording"] = (
            f"{folder}: nothing can be recorded there ({why}); name another folder with --record"
        )
        return None

    def _prepare(self) -> None:
        """Have detector and likelihood compiled, which takes long once on a computer."""

        def tell(line: str) -> None:
            self.compiling = line
            self.said.append(line)

        try:
            prepare_all(tell)
        finally:
            self.compiling = ""

    def _next_task(self) -> None:
        """Give the worker what is most pressing; pictures are looked at beside that."""
        self._look()
        if not self._worker.idle:
            return
        due = None if self.compiling else self.drive.to_measure()
        now = time.monotonic()
        if due is not None:
            self._measure_due = now
            log = self._log_name
            self._worker.begin("measure", lambda: self._measured(due, log))
        elif self._wants["calibrate"]:
            self._wants["calibrate"] = False
            last, name = self.drive.to_measure(at_end=True), self._log_name
            self._worker.begin("finish", lambda: self._all_seen(last, name))
        elif (self._wants["advise"] or self.outlook.placed_after != self.drive.stops_taken) and not self.compiling:
            self._wants["advise"] = False
            count = self.drive.stops_taken
            self._worker.begin("advise", lambda: (count, self._advice()))
        elif self._wants["solve"] and self.running.estimate is not None:
            self._wants["solve"] = False
            self._worker.begin("solve", self._solved)
        seen = self.running.seen
        if self._wants["judge"] and self.full.idle and seen is not None and self.running.estimate is not None:
            self._wants["judge"] = False
            self.full.judge(seen)

    def _look(self) -> None:
        """Have the newest picture looked at, some times a second."""
        frame, camera, now = self.drive.newest, self.camera, time.monotonic()
        if frame is None or frame.number == self._glanced or now < self._next_glance or not self._eyes.idle:
            return
        self._glanced, self._next_glance = frame.number, now + _GLANCE_S
        self._eyes.begin("glance", lambda: self._looked_at(frame, camera))

    @property
    def _log_name(self) -> str:
        return self.recorder.path.name if self.recorder is not None else "drive"

    @property
    def camera(self) -> CameraModel | None:
        """The camera as known so far: solved for, or with the focal length that the detector found."""
        if self.running.estimate is not None:
            return self.running.estimate.camera
        known, size = self.drive.taken.camera, self.drive.taken.image_size
        if known is None or size is None:
            return None
        f = known.prior.focal_px
        return CameraModel(fu=f, fv=f, cu=(size[0] - 1) / 2, cv=(size[1] - 1) / 2, kr=0.0)

    def _looked_at(self, frame: Any, camera: CameraModel | None) -> Glance | None:
        try:
            image = decode_frame(frame.channel, frame.data)
            if isinstance(image, VideoPacket):
                return None
            shown: DeepGrey = full_scale(image, 8)
            return glance(shown, frame.t_ns, self.options.target, camera)
        except (DetectError, *_NUMERIC) as error:
            self.drive.damaged = f"{frame.channel.topic}: {error}"
            return None

    def _measured(self, due: Any, log: str) -> tuple[bool, bool]:
        """Measure a stop and bring the estimate up to date; return whether it was taken, and whether it is new."""
        before = len(self.drive.taken.stops)
        try:
            taken = self.drive.taken.take(*due)
        except (BoxcalError, *_NUMERIC) as error:
            self.problems["stop"] = f"a stop could not be measured ({error}); it is left out"
            return False, False
        if taken is None:
            return False, False
        self.problems["stop"] = ""
        self._estimate(lambda: self._grown(log))
        return True, len(self.drive.taken.stops) > before

    def _grown(self, log: str) -> None:
        drive = self.drive.correspondences(log)
        if drive is not None:
            self.running.grow(drive)

    def _solved(self) -> None:
        """Solve all that was seen anew."""
        drive = self.running.seen
        if drive is not None:
            self._estimate(lambda: self.running.solve(drive))

    def _estimate(self, update: Callable[[], object]) -> None:
        """Update the estimate, and put the goals beside what is estimated then."""
        try:
            update()
            found, drive = self.running.estimate, self.running.drive
            self.outlook.bars = (
                bars(found, self.options.goal, drive.image_size) if found is not None and drive is not None else ()
            )
            self.problems["estimate"] = ""
        except (BoxcalError, *_NUMERIC) as error:
            self.problems["estimate"] = f"the estimate could not be updated ({error})"

    def _all_seen(self, last: Any, log: str) -> Correspondences | None:
        """Return all that was seen, the stand that still goes on with its newest pictures."""
        try:
            if last is not None:
                self.drive.taken.take(*last)
            return self.drive.correspondences(log)
        except (BoxcalError, *_NUMERIC) as error:
            self.problems["stop"] = f"the last stop could not be measured ({error})"
            return None

    def _advice(self) -> tuple[Place, ...]:
        found, drive = self.running.estimate, self.running.drive
        try:
            if found is not None and drive is not None:
                places = next_places(found, drive, self.options.target, self.options.goal)
                self.problems["plan"] = ""
                return places
        except (CalibError, *_NUMERIC) as error:
            self.problems["plan"] = f"no next stop could be planned ({error}); drive on around the box"
            return ()
        return first_places(self.options.target, len(self.drive.taken.stops), self.drive.taken.image_size)

    def _collect(self) -> None:
        """Take what the workers and the solver have finished."""
        look = self._eyes.finished()
        if look is not None and look[1] is not None:
            self.outlook.seen = look[1]
        done = self._worker.finished()
        if done is not None:
            name, result = done
            if name == "advise":
                self.outlook.placed_after, self.outlook.places = result
            elif name == "solve":
                self._wants["advise"] = True
            elif name == "measure":
                self._took(*result)
            elif name == "finish":
                self._finish(result)
        if self.full.collect():
            result = self.full.written
            self.said.append(f"{self.options.robot}: {str(result['level']).upper()} - {result['headline']}")
            self.said.append(f"written: {self.options.out / self.options.robot}")

    def _took(self, usable: bool, new: bool) -> None:
        if not usable:
            return
        now, count = time.monotonic(), self.drive.stops_taken
        self.outlook.latency = now - self._measure_due
        if new:
            self.outlook.taken_at = (now, count)
            corners = self.drive.taken.stops[-1].corners
            self.said.append(f"stop {count} taken: {corners.tags} tags in {corners.frames} pictures")
        self._wants.update(advise=True, solve=True, judge=count >= _JUDGED_FROM)

    def _finish(self, drive: Correspondences | None) -> None:
        """Begin the calibration that is written."""
        if drive is None:
            nothing = "nothing to calibrate from yet: let the robot drive, and stand still before the box"
            self.full.failed = self.problems["stop"] or nothing
            return
        log = self.recorder.path if self.recorder is not None else Path("drive")
        self.full.write(drive, self.options.out, log, self.options.command)

    @property
    def busy_calibrating(self) -> bool:
        """Whether the calibration that was asked for is under way."""
        asked = self._wants["calibrate"] or (not self._worker.idle and self._worker.name == "finish")
        return asked or self.full.is_writing

    @property
    def enough(self) -> bool:
        """Whether all goals are reached and the last full calibration of these stops is good."""
        verdict = self.full.verdict
        return (
            reached(self.outlook.bars)
            and verdict.get("level") == "good"
            and verdict.get("stops") == self.drive.stops_taken
        )

    @property
    def is_checking(self) -> bool:
        """Whether all goals are reached, and the full calibration of these stops has still to tell what it is.

        The driver waits for it then: where it takes longer than to drive to the next stop, it would never be that of
        all stops otherwise.
        """
        told = self.full.verdict.get("stops") == self.drive.stops_taken
        return reached(self.outlook.bars) and not told and (self._wants["judge"] or not self.full.idle)

    @property
    def places(self) -> tuple[Place, ...]:
        """Next stops to drive to; empty while they are not known for the stops so far, or may not be needed."""
        known = self.outlook.placed_after == self.drive.stops_taken
        return self.outlook.places if known and not (self.enough or self.is_checking) else ()

    def _answer_requests(self) -> None:
        while self._requests:
            what = self._requests.popleft()
            if what == "calibrate" and not self.busy_calibrating:
                self.full.written = {}
                self._wants["calibrate"] = True
            elif what == "again" and not self._worker.idle:
                self._requests.append(what)
                return
            elif what == "again":
                if self.recorder is not None:
                    self.recorder.close()
                self.full.give_up()
                self._begin()

    def _tell_changes(self) -> None:
        """Say on the terminal what has changed in the link, the recorder and the drive."""
        state = {
            "link": self.link.said or (f"connected to {self.link.name}" if self.link.connected else ""),
            "recorder": self.recorder.problem if self.recorder is not None else "",
            "wheels": self.drive.wheels.problem if self.drive.stands is None and self.drive.wheels.heard else "",
            "pictures": self.drive.damaged or self.drive.taken.undecoded,
            **self.problems,
            "full": self.full.failed,
        }
        for what, text in state.items():
            if text and self._told.get(what) != text:
                self.said.append(text)
            self._told[what] = text
