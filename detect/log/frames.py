"""The frames of one camera topic, decoded one at a time, by their number."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.detect.log.containers.base import Container, Place
from boxcal.detect.log.frame_cache import FrameCache
from boxcal.detect.log.images import ImageSeries, VideoPacket, decode_frame, image_stamp_ns
from boxcal.detect.log.video import VideoDecoder, is_key

_MAX_GROUP = 600
"""Most packets from a video's image that needs none before it to one that is asked for."""
_MAX_DELAY = 4
"""Most packets that a decoder holds back."""


@dataclass(slots=True, kw_only=True, eq=False, weakref_slot=True)
class FrameSource:
    """Reads frames: from what was kept in the first pass, else from the recording.

    Attributes
    ----------
    series
        The images of the topic.
    container
        The recording.
    cache
        What was kept.
    skipped
        Numbers of the frames that did not decode, with the reason.
    """

    series: ImageSeries
    container: Container
    cache: FrameCache
    skipped: dict[int, str] = field(default_factory=dict)
    _decoder: VideoDecoder | None = None
    _next: int = -1

    def decoded(self, numbers: Iterable[int]) -> Iterator[tuple[int, DeepGrey]]:
        """Yield number and pixels of frames; those that do not decode are noted and passed over.

        Raises
        ------
        DetectError
            If the recording changed since it was opened, or the library for its videos is not installed.
        """
        for number in numbers:
            if number in self.skipped:
                continue
            try:
                if self.series.is_video:
                    image = self._video_frame(number)
                else:
                    found = decode_frame(self.series.channel, self.message(number))
                    if isinstance(found, VideoPacket):
                        raise DetectError("a packet of a video among pictures")
                    image = found
            except DetectError as error:
                if error.source or error.remedy.startswith("pip"):
                    raise
                self.skipped[number] = str(error)
                continue
            yield number, image

    def message(self, number: int) -> bytes:
        """Return the message of a frame (DetectError if the recording changed since it was opened)."""
        kept = self.cache.get(self.series, number)
        if kept is not None:
            return kept
        place = Place(self.series.record[number], self.series.inner[number])
        try:
            (data,) = self.container.read([place])
        except OSError as error:
            raise DetectError(
                f"cannot be read ({error.strerror or error})", source=self.container.name, remedy="check the disk"
            ) from error
        stamp = image_stamp_ns(self.series.channel, self.series.kind, memoryview(data), self.series.log_ns[number])
        if stamp != self.series.t_ns[number]:
            raise DetectError(
                "changed while it was read", source=self.container.name, remedy="close its recorder and try again"
            )
        return data

    def _video_frame(self, wanted: int) -> DeepGrey:
        """Return a frame of a video, by way of the images that it builds on."""
        if self._decoder is None or not self._next <= wanted < self._next + _MAX_GROUP:
            self._next = self._key_before(wanted)
            self._decoder = None
        for number in range(self._next, min(wanted + _MAX_DELAY, len(self.series.t_ns) - 1) + 1):
            packet = self._packet(number)
            if self._decoder is None:
                self._decoder = VideoDecoder(packet.codec)
            self._next = number + 1
            for shown, picture in self._decoder.pictures(packet, number):
                if shown == wanted:
                    return picture
        self._decoder = None
        raise DetectError("a frame of a video does not decode; it is damaged")

    def _key_before(self, wanted: int) -> int:
        for number in range(wanted, max(wanted - _MAX_GROUP, -1), -1):
            if is_key(self._packet(number)):
                return number
        raise DetectError("a frame of a video without one before it that stands alone")

    def _packet(self, number: int) -> VideoPacket:
        packet = decode_frame(self.series.channel, self.message(number))
        if not isinstance(packet, VideoPacket):
            raise DetectError("a picture among packets of a video")
        return packet
