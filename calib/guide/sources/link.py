"""The state of a source, and how it hands its messages on: shared by all kinds of source."""

import re
import threading
import time
from dataclasses import dataclass, field, replace

from boxcal.calib.guide.sources.inbox import Inbox, LiveMessage
from boxcal.calib.guide.sources.selection import Selection, select
from boxcal.calib.guide.sources.video import VideoFeed
from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.topics import Topics

_MOST_KNOWN = 40_000
"""Descriptions of topics that are remembered: twice what one server may offer."""


@dataclass(slots=True, kw_only=True, eq=False)
class Link:
    """One source of messages, as the session sees it.

    Attributes
    ----------
    address
        Its address, or its file.
    topics
        Names that the user gave.
    inbox
        Where its messages go.
    connected
        Whether it is there.
    said
        Sentence about why not, or what is missing.
    selection
        Topics that are listened to.
    chosen
        Topic of the camera that was named on the page; empty before.
    choices
        How often another camera was named.
    losses
        How often it was lost again.
    stopped
        Set to end it.
    """

    address: str
    topics: Topics
    inbox: Inbox
    connected: bool = False
    said: str = ""
    selection: Selection = field(default_factory=Selection)
    chosen: str = ""
    choices: int = 0
    losses: int = 0
    stopped: threading.Event = field(default_factory=threading.Event)
    _video: VideoFeed | None = None
    _video_topic: str = ""
    _known: dict[tuple[str, str, str, bytes], Channel] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The address as it may be shown and written."""
        return without_credentials(self.address)

    def found(self) -> None:
        """Note that the source is there."""
        self.connected, self.said = True, ""

    def lost(self, why: str) -> None:
        """Note that it is not, with the reason in a sentence."""
        self.losses += self.connected
        self.connected, self.said = False, why

    def choose_camera(self, topic: str) -> None:
        """Name the camera; whoever listens chooses anew soon, and meanwhile no other one's images are handed on."""
        self.topics, self.chosen = replace(self.topics, camera_topic=topic), topic
        self.choices += 1

    def known(self, channel: Channel) -> Channel:
        """Return the channel that was known by the same description, so that a reconnected one is no new one."""
        if len(self._known) > _MOST_KNOWN:
            raise DetectError(
                f"describes its topics anew all the time, {_MOST_KNOWN} descriptions came", source=self.name
            )
        return self._known.setdefault((channel.topic, channel.type, channel.encoding, channel.schema), channel)

    def offer(self, channels: list[Channel]) -> Selection:
        """Choose among the topics that are offered, and return the choice."""
        self.selection = select(channels, self.topics)
        if self.connected:
            self.said = self.selection.problem
        return self.selection

    def hand_on(self, channel: Channel, log_ns: int, data: bytes, now: float | None = None) -> None:
        """Hand a message to the session; images beyond a rate are dropped by this time, s, or by the clock."""
        picture, now = channel.topic == self.selection.camera, time.monotonic() if now is None else now
        if not picture and channel.topic in self.selection.cameras:
            return  # of a camera that is not, or no longer, the chosen one
        if not (picture and self.selection.is_video):
            self.inbox.put(LiveMessage(channel, log_ns, data, picture), now)
            return
        if self._video is None or self._video_topic != channel.topic:
            if self._video is not None:
                self._video.close()
            self._video, self._video_topic = VideoFeed(self._picture, self._tell, self.stopped), channel.topic
        self._video.put(channel, log_ns, data, now)

    @property
    def is_full(self) -> bool:
        """Whether a source that can wait should."""
        return self.inbox.is_full or (self._video is not None and self._video.is_full)

    @property
    def pictures_left_out(self) -> int:
        """Number of images that came faster than they could be worked on."""
        return self.inbox.dropped_pictures + (0 if self._video is None else self._video.left_out)

    def _picture(self, channel: Channel, log_ns: int, data: bytes, now: float) -> None:
        if channel.topic == self.selection.camera:
            self.inbox.put(LiveMessage(self.known(channel), log_ns, data, picture=True), now)

    def _tell(self, why: str) -> None:
        self.said = why


def without_credentials(address: str) -> str:
    """Return an address without user, password and query; what is none as it is."""
    scheme, mark, rest = address.partition("://")
    if not mark:
        return address
    host, slash, path = re.split(r"[?#]", rest)[0].partition("/")
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{path}"
