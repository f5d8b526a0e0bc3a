"""A thread that keeps messages in a file: at most half a second is lost whatever happens, and a full disk is no end."""

import contextlib
import queue
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from typing import NamedTuple

from boxcal.calib.errors import CalibError
from boxcal.calib.guide.recording.chunked_file import ChunkedFile
from boxcal.calib.guide.sources.inbox import LiveMessage

EVERY_S = 0.4
"""Time from chunk to chunk."""
MOST_PENDING_BYTES = 8 << 20
"""A chunk is written early when it holds so much."""
MOST_QUEUED_BYTES = 96 << 20
"""Messages that wait for a slow disk; beyond it images are not kept, beyond twice that nothing is."""
TRY_AGAIN_S = 5.0


def begin_recording(folder: Path, robot: str) -> "tuple[Recorder | None, str]":
    """Return the recorder of a new drive, and why there is none; neither if one of this second is there already."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return Recorder(folder / f"{robot}-{time.strftime('%Y%m%d-%H%M%S')}.mcap"), ""
    except FileExistsError as error:
        if folder.is_dir():
            return None, ""  # two drives in one second: the next message tries again
        why = error.strerror
    except OSError as error:
        why = error.strerror or str(error)
    return None, f"{folder}: nothing can be recorded there ({why}); name another folder with --record"


class _Copy(NamedTuple):
    """A copy that is asked for, and when it is done."""

    path: Path
    done: "Future[None]"


class Recorder:
    """Keeps messages in an MCAP file of its own.

    Attributes
    ----------
    path
        The file.
    problem
        Sentence about why it cannot be written now, empty if it can.
    lost
        Messages that were not kept because of that, or because the disk is far behind.
    unkept_pictures
        Images that were not kept because the disk is slow.
    """

    def __init__(self, path: Path) -> None:
        self._file = ChunkedFile(path)
        self.path, self.problem = path, ""
        self.lost = self.unkept_pictures = 0
        self._queue: queue.SimpleQueue[LiveMessage | _Copy | None] = queue.SimpleQueue()
        self._queued_bytes, self._lock = 0, threading.Lock()
        self._blocked_until = 0.0
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def size(self) -> int:
        """Bytes that were written."""
        return self._file.size

    @property
    def messages(self) -> int:
        """Messages that were written."""
        return self._file.messages

    def keep(self, message: LiveMessage) -> bool:
        """Keep a message; return False if the disk cannot follow: of images first, of all in the end."""
        size = message.size
        with self._lock:
            most = MOST_QUEUED_BYTES if message.picture else 2 * MOST_QUEUED_BYTES
            if self._queued_bytes and self._queued_bytes + size > most:
                self.unkept_pictures += message.picture
                self.lost += not message.picture
                return False
            self._queued_bytes += size
        self._queue.put(message)
        return True

    def copy(self, folder: Path, patience_s: float = 20.0) -> Path:
        """Return a finished copy of all that was kept until now, in a folder.

        Raises
        ------
        CalibError
            If some of what was heard could not be kept, or the copy cannot be written, or not within that time.
        """
        asked = _Copy(folder / self.path.name, Future())
        self._queue.put(asked)
        try:
            asked.done.result(patience_s)
        except TimeoutError:
            raise CalibError(f"its recording was not copied within {patience_s:.0f} s") from None
        except OSError as error:
            raise CalibError(f"its recording could not be copied ({error.strerror or error})") from error
        if self.lost or self.problem:
            lost = f"{self.lost} message{'s' if self.lost > 1 else ''} of the drive could not be recorded"
            raise CalibError(self.problem or lost)
        return asked.path

    def close(self) -> None:
        """Write all that is kept and finish the file."""
        self._queue.put(None)
        self._thread.join()
        try:
            self._file.close()
        except OSError as error:
            self._failed(error)

    def _run(self) -> None:
        next_flush = time.monotonic() + EVERY_S
        while True:
            with contextlib.suppress(queue.Empty):
                message = self._queue.get(timeout=max(next_flush - time.monotonic(), 0.01))
                if message is None:
                    return
                if isinstance(message, _Copy):
                    self._copied(message)
                    continue
                with self._lock:
                    self._queued_bytes -= message.size
                self._take(message)
            if time.monotonic() >= next_flush or self._file.pending_bytes > MOST_PENDING_BYTES:
                self._flush()
                next_flush = time.monotonic() + EVERY_S

    def _copied(self, asked: "_Copy") -> None:
        self._flush()
        try:
            self._file.finished_copy(asked.path)
        except OSError as error:
            asked.done.set_exception(error)
        else:
            asked.done.set_result(None)

    def _take(self, message: LiveMessage) -> None:
        if self.problem and time.monotonic() < self._blocked_until:
            self.lost += 1
            return
        self._file.add(message.channel, message.log_ns, message.data)

    def _flush(self) -> None:
        before = self._file.pending
        if not before:
            return
        try:
            self._file.flush()
            self.problem = ""
        except OSError as error:
            self.lost += before
            self._failed(error)

    def _failed(self, error: OSError) -> None:
        self._blocked_until = time.monotonic() + TRY_AGAIN_S
        self.problem = (
            f"{self.path.name} cannot be written ({error.strerror or error}); what was recorded so far is kept, make "
            "room on the disk"
        )
