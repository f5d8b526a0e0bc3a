"""Messages between the network and the session: few are held, and images are dropped rather than queued."""

import threading
from collections import deque
from typing import NamedTuple

from boxcal.detect.log.containers.base import Channel

MOST_PICTURE_BYTES = 64 << 20
"""Images that wait are at most these, beyond the newest one."""
MOST_OTHER_BYTES = 64 << 20
PICTURES_A_SECOND = 10.0
"""Rate at which images are taken in; more say nothing new of a robot that stands."""
_LATEST_NS = (1 << 63) - 1
_BACK_S = 1.0
_OVERHEAD = 256
"""Bytes that a message takes beside its content: empty ones fill the memory, too."""


class LiveMessage(NamedTuple):
    """One message as it came.

    Attributes
    ----------
    channel
        What it is.
    log_ns : ns
        When the server says that it was received.
    data
        Its bytes.
    picture
        Whether it is one of the camera's.
    """

    channel: Channel
    log_ns: int
    data: bytes
    picture: bool

    @property
    def size(self) -> int:
        """Bytes of memory that it takes."""
        return len(self.data) + _OVERHEAD


class Inbox:
    """Messages that wait for the session, from any thread to one.

    Attributes
    ----------
    dropped_pictures
        Images that came faster than they could be worked on or kept.
    dropped_others
        Other messages that did.
    """

    def __init__(self, pictures_a_second: float = PICTURES_A_SECOND) -> None:
        self.dropped_pictures = self.dropped_others = 0
        self._interval = 1 / pictures_a_second
        self._next_picture = 0.0
        self._waiting: deque[LiveMessage] = deque()
        self._picture_bytes = self._other_bytes = 0
        self._changed = threading.Condition()

    def put(self, message: LiveMessage, now: float) -> None:
        """Take a message, or drop it where too much waits.

        Parameters
        ----------
        message
            The message; its time is clipped to what a log can hold.
        now : s
            Of a steady clock; images beyond the rate are dropped by it.
        """
        message = message._replace(log_ns=min(max(message.log_ns, 0), _LATEST_NS))
        size = message.size
        with self._changed:
            if message.picture:
                if self._next_picture - now > _BACK_S:  # a recording is read again from its beginning
                    self._next_picture = now
                if now < self._next_picture:
                    self.dropped_pictures += 1
                    return
                self._next_picture = max(self._next_picture + self._interval, now)
                while self._picture_bytes and self._picture_bytes + size > MOST_PICTURE_BYTES:
                    self._drop_oldest_picture()
                self._picture_bytes += size
            elif self._other_bytes and self._other_bytes + size > MOST_OTHER_BYTES:
                self.dropped_others += 1
                return
            else:
                self._other_bytes += size
            self._waiting.append(message)
            self._changed.notify()

    @property
    def is_full(self) -> bool:
        """Whether a source that can wait should."""
        return self._picture_bytes + self._other_bytes > MOST_OTHER_BYTES // 4

    def take(self, timeout: float, span_ns: int = _LATEST_NS) -> list[LiveMessage]:
        """Return what waits, in order of arrival.

        Parameters
        ----------
        timeout : s
            How long to wait for a first message.
        span_ns : ns
            Time of recording that is returned at once; the rest goes on waiting.
        """
        taken: list[LiveMessage] = []
        with self._changed:
            if not self._waiting:
                self._changed.wait(timeout)
            while self._waiting and abs(self._waiting[0].log_ns - (taken or self._waiting)[0].log_ns) <= span_ns:
                message = self._waiting.popleft()
                taken.append(message)
                if message.picture:
                    self._picture_bytes -= message.size
                else:
                    self._other_bytes -= message.size
        return taken

    @property
    def waiting(self) -> int:
        """Number of messages that wait."""
        return len(self._waiting)

    def _drop_oldest_picture(self) -> None:
        for k, message in enumerate(self._waiting):
            if message.picture:
                del self._waiting[k]
                self._picture_bytes -= message.size
                self.dropped_pictures += 1
                return
        self._picture_bytes = 0
