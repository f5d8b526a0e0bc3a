"""The guide's session: messages in, state out; what takes long is done beside it."""

import threading
import time
from collections import deque
from collections.abc import Callable

from boxcal.calib.guide.estimate.solver import Solver
from boxcal.calib.guide.outlook import GuideOptions
from boxcal.calib.guide.progress import Progress
from boxcal.calib.guide.recording.recorder import Recorder, begin_recording
from boxcal.calib.guide.sources.descriptions import Descriptions
from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.calib.guide.sources.link import Link
from boxcal.calib.guide.work.tasks import Tasks
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.detect.errors import DetectError

_SPAN_NS = 500_000_000
"""Time of recording that is taken at once: messages may come faster than time."""
_MOST_PENDING_BYTES = 64 << 20
"""Messages that were kept and wait until a stop before them is measured; beyond that the source waits, or drops."""
_WAIT_S, _TICK_S, _PUBLISH_S = 0.04, 0.1, 0.1
_TICK_FACTOR = 5.0
"""A tick that takes long comes as many times its length later."""
_IDLE_S, _IDLE_EVERY_NS = 20.0, 2_000_000_000
"""A robot that has stood so long at a stop that was taken is left standing: its images are kept rarely."""


class Session:
    """One drive after the other with a guide.

    Attributes
    ----------
    options, link
        What was asked for, and where messages come from.
    progress, tasks
        The drive, and the work that it makes.
    recorder
        Keeps the messages; None before the first.
    said
        Lines for the terminal that were not printed yet.
    compiling
        Sentence about what must be compiled first; empty once that is done.
    stopped
        Set to end the session.
    """

    def __init__(self, options: GuideOptions, link: Link) -> None:
        self.options, self.link = options, link
        self.said: deque[str] = deque(maxlen=200)
        self.compiling = "getting ready"
        self.stopped = threading.Event()
        self._requests: deque[tuple[str, str]] = deque(maxlen=8)
        self._solver = Solver(options.robot, options.target, options.settings)
        self._told: dict[str, str] = {}
        self._descriptions = Descriptions()
        self._begin()
        threading.Thread(target=self._prepare, name="compile", daemon=True).start()

    def _begin(self) -> None:
        self.progress = Progress(self.options, self._solver)
        self.tasks = Tasks(self.progress, self.said)
        self.recorder: Recorder | None = None
        self._idle_picture_ns = 0
        self._begun, self._unrecorded = False, 0
        self._camera = self.link.chosen
        self._pending: deque[LiveMessage] = deque()
        self._pending_bytes = 0
        self._heard_ns = self._updated_ns = 0

    def request(self, what: str, which: str = "") -> None:
        """Ask for something from the page: ``calibrate``, ``again`` (a new drive), or a ``camera`` by its topic."""
        self._requests.append((what, which))

    def run(self, publish: Callable[["Session"], None]) -> None:
        """Work until stopped; ``publish`` is called some ten times a second."""
        try:
            self._work(publish)
        finally:
            self.tasks.close()
            self.progress.full.give_up()
            self._solver.give_up()
            if self.recorder is not None:
                self.recorder.close()

    def _work(self, publish: Callable[["Session"], None]) -> None:
        next_tick = next_publish = 0.0
        while not self.stopped.is_set():
            if self._pending_bytes < _MOST_PENDING_BYTES:
                self.keep(self.link.inbox.take(_WAIT_S, _SPAN_NS))
            else:
                time.sleep(_WAIT_S)
            if not self.progress.drive.is_behind:
                self._hear()
            now = time.monotonic()
            if now >= next_tick or self._pending or abs(self._heard_ns - self._updated_ns) > _SPAN_NS:
                self.progress.drive.update()
                self._updated_ns = self._heard_ns
                spent = time.monotonic() - now
                next_tick = now + max(_TICK_S, _TICK_FACTOR * spent)
            self.tasks.collect()
            self._answer_requests()
            self.tasks.begin_next(self.recorder, compiled=not self.compiling)
            if now >= next_publish:
                next_publish = now + _PUBLISH_S
                self._tell_changes()
                publish(self)

    def keep(self, messages: list[LiveMessage]) -> None:
        """Keep messages at once, whatever else there is to do; those that were kept wait for the drive."""
        if messages and self.recorder is None:
            self.recorder, self.progress.problems["recording"] = begin_recording(
                self.options.recordings, self.options.robot
            )
            if self.recorder is None:
                self._unrecorded += len(messages)
            else:
                self.recorder.lost += self._unrecorded
        again = self._descriptions.again(messages[0].log_ns) if messages and not self._begun else []
        self._begun = self._begun or bool(messages)
        self._descriptions.keep(messages, self.link.topics)
        messages, recorder = [*again, *messages], self.recorder
        wanted = [m for m in messages if not m.picture or (self._is_of_this_drive(m) and not self._is_idle(m.log_ns))]
        kept = [m for m in wanted if recorder is None or recorder.keep(m)]
        self._pending.extend(kept)
        self._pending_bytes += sum(m.size for m in kept)

    def _is_of_this_drive(self, message: LiveMessage) -> bool:
        """Return whether an image is of the drive's camera: the one that was named, else the first that was heard."""
        topic = message.channel.topic
        self._camera = self._camera or topic
        if topic != self._camera:
            if not self.link.chosen:
                self.progress.problems["messages"] = (
                    f"pictures of {topic} are left out: this drive is of {self._camera}; choose the camera on the page"
                )
            return False
        return True

    def _hear(self) -> None:
        """Take messages that were kept into the drive, of half a second at most, so that no stop passes unnoticed."""
        messages: list[LiveMessage] = []
        while self._pending and abs(self._pending[0].log_ns - (messages or self._pending)[0].log_ns) <= _SPAN_NS:
            messages.append(self._pending.popleft())
        self._pending_bytes -= sum(m.size for m in messages)
        self._heard_ns = messages[-1].log_ns if messages else self._heard_ns
        try:
            self.progress.drive.take(messages)
        except DetectError as error:
            self.progress.problems["messages"] = str(error)

    def _is_idle(self, log_ns: int) -> bool:
        """Return whether an image shows nothing new: the robot has stood for long at a stop that was taken.

        While messages wait, what is known of the robot is older than the image.
        """
        stands = self.progress.drive.stands
        if self._pending or stands is None or stands.seconds < _IDLE_S or not self.progress.drive.stands_taken:
            return False
        if abs(log_ns - self._idle_picture_ns) < _IDLE_EVERY_NS:
            return True
        self._idle_picture_ns = log_ns
        return False

    def _prepare(self) -> None:
        """Have detector and likelihood compiled, which takes long once on a computer."""

        def tell(line: str) -> None:
            self.compiling = line
            self.said.append(line)

        try:
            prepare_all(tell)
        finally:
            self.compiling = ""

    def _answer_requests(self) -> None:
        while self._requests:
            what, which = self._requests.popleft()
            if what == "calibrate":
                if not self.tasks.is_calibrating:
                    self.progress.full.written = {}
                    self.progress.wants["calibrate"] = True
            elif not self.tasks.idle:
                self._requests.append((what, which))
                return
            elif what == "again":
                self._begin_again()
            elif what == "camera" and which in self.link.selection.cameras:
                self.link.choose_camera(which)
                self._begin_again()

    def _begin_again(self) -> None:
        """Begin a new drive; the recording of the last one is finished."""
        if self.recorder is not None:
            self.recorder.close()
        self.progress.full.give_up()
        self.tasks.close()
        self._begin()

    def _tell_changes(self) -> None:
        """Say on the terminal what has changed in the link, the recorder and the drive."""
        drive = self.progress.drive
        state = {
            "link": self.link.said or (f"connected to {self.link.name}" if self.link.connected else ""),
            "recorder": self.recorder.problem if self.recorder is not None else "",
            "wheels": drive.wheels.problem if drive.stands is None and drive.wheels.heard else "",
            "pictures": drive.damaged or drive.taken.undecoded,
            **self.progress.problems,
            "full": self.progress.full.failed,
        }
        for what, text in state.items():
            if text and self._told.get(what) != text:
                self.said.append(text)
            self._told[what] = text
