"""A camera's video, decoded as it comes: its images are handed on, and kept, as images without loss.

A packet needs those before it, so a video cannot be thinned out where it comes in, nor kept in parts. Its images can.
"""

import struct
import threading
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import cv2

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.detect.log.containers.base import Channel, ros_type
from boxcal.detect.log.images import COMPRESSED_IMAGE, VideoPacket, decode_frame, frame_id_of, image_stamp_ns
from boxcal.detect.log.video import VideoDecoder, is_key

MOST_BYTES = 32 << 20
"""Packets that wait to be decoded; beyond them those up to the next whole image are left out."""
_EVERY_NS = 95_000_000
_OVERHEAD = 256
"""Bytes that a packet takes beside its content: empty ones fill the memory, too."""
_WAIT_S = 0.2
_NS = 1_000_000_000
_DEFINITION = b"""std_msgs/Header header
string format
uint8[] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


class _Waiting(NamedTuple):
    channel: Channel
    log_ns: int
    data: bytes
    now: float


class _Shown(NamedTuple):
    stamp_ns: int
    frame_id: str
    log_ns: int
    now: float


class VideoFeed:
    """Decodes the packets of a video in a thread, and hands some ten of its images a second on.

    Parameters
    ----------
    hand_on
        Takes an image's message: channel, time of arrival (ns), bytes, and the steady time (s) of its packet.
    tell
        Takes a sentence about why the video cannot be decoded.
    stopped
        Set to end it.
    """

    def __init__(
        self,
        hand_on: Callable[[Channel, int, bytes, float], None],
        tell: Callable[[str], None],
        stopped: threading.Event,
    ) -> None:
        self.left_out = 0
        self._hand_on, self._tell, self._stopped = hand_on, tell, stopped
        self._closed = threading.Event()
        self._waiting: deque[_Waiting] = deque()
        self._bytes, self._whole = 0, True
        self._changed = threading.Condition()
        self._decoder: VideoDecoder | None = None
        self._sent: dict[int, _Shown] = {}
        self._number, self._last_ns = 0, 0
        threading.Thread(target=self._run, name="video", daemon=True).start()

    @property
    def is_full(self) -> bool:
        """Whether a source that can wait should."""
        return self._bytes > MOST_BYTES // 4

    def put(self, channel: Channel, log_ns: int, data: bytes, now: float) -> None:
        """Take a packet, or leave it out with those that need it where too much waits."""
        with self._changed:
            if not self._whole and not _begins_anew(channel, data):
                self.left_out += 1
                return
            size = len(data) + _OVERHEAD
            self._whole = self._bytes + size <= MOST_BYTES
            if not self._whole:
                self.left_out += 1
                return
            self._waiting.append(_Waiting(channel, log_ns, data, now))
            self._bytes += size
            self._changed.notify()

    def close(self) -> None:
        """End the thread; what waits is not decoded any more."""
        self._closed.set()

    def _run(self) -> None:
        while not (self._stopped.is_set() or self._closed.is_set()):
            with self._changed:
                if not self._waiting:
                    self._changed.wait(_WAIT_S)
                packet = self._waiting.popleft() if self._waiting else None
                self._bytes -= len(packet.data) + _OVERHEAD if packet is not None else 0
            if packet is None:
                continue
            try:
                self._decode(packet)
            except DetectError as error:
                self._tell(f"{packet.channel.topic}: {error}")
            except Exception as error:  # of the decoder, on odd packets: the next whole image begins anew
                self._decoder = None
                self._tell(f"{packet.channel.topic}: a packet cannot be decoded ({type(error).__name__}: {error})")

    def _decode(self, packet: _Waiting) -> None:
        channel = packet.channel
        found = decode_frame(channel, packet.data)
        if not isinstance(found, VideoPacket):
            raise DetectError("a picture in a topic of videos")
        kind = ros_type(channel.type) if channel.encoding != "protobuf" else channel.type
        stamp = image_stamp_ns(channel, kind, memoryview(packet.data), packet.log_ns) or packet.log_ns
        self._decoder = self._decoder or VideoDecoder(found.codec)
        self._number += 1
        self._sent[self._number] = _Shown(stamp, frame_id_of(channel, packet.data), packet.log_ns, packet.now)
        self._sent = {k: sent for k, sent in self._sent.items() if k > self._number - 64}
        for number, grey in self._decoder.pictures(found, self._number):
            if number in self._sent:
                self._picture(channel.topic, grey, self._sent.pop(number))

    def _picture(self, topic: str, grey: DeepGrey, of: _Shown) -> None:
        if 0 <= of.stamp_ns - self._last_ns < _EVERY_NS:
            return
        self._last_ns = of.stamp_ns
        channel = Channel(
            topic=topic, type=COMPRESSED_IMAGE, encoding="cdr", schema=_DEFINITION, schema_encoding="ros2msg"
        )
        done, png = cv2.imencode(".png", grey, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if done:
            self._hand_on(channel, of.log_ns, compressed_image(of.stamp_ns, of.frame_id, "png", png.tobytes()), of.now)


def _begins_anew(channel: Channel, data: bytes) -> bool:
    try:
        packet = decode_frame(channel, data)
    except DetectError:
        return False
    return isinstance(packet, VideoPacket) and is_key(packet)


def compressed_image(stamp_ns: int, frame_id: str, kind: str, data: bytes) -> bytes:
    """Return a ``sensor_msgs/msg/CompressedImage`` in CDR, little endian."""
    sec, nanosec = divmod(stamp_ns, _NS)
    out = bytearray(b"\0\1\0\0" + struct.pack("<iI", sec & 0x7FFFFFFF, nanosec))
    for text in (frame_id, kind):
        content = text.encode(errors="replace") + b"\0"
        out += bytes(-(len(out) - 4) % 4) + struct.pack("<I", len(content)) + content
    return bytes(out + bytes(-(len(out) - 4) % 4) + struct.pack("<I", len(data)) + data)
