"""H.264 and H.265 videos, a packet a message, decoded by PyAV (extra ``video``)."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.detect.log.images import VideoPacket
from boxcal.detect.log.pictures import check_size
from boxcal.detect.log.safe_text import printable

_CODECS = {
    "h264": "h264",
    "h265": "hevc",
    "hevc": "hevc",
    "av1": "av1",
    "vp9": "vp9",
    "libx264": "h264",
    "libx265": "hevc",
}
_H264_KEY, _H265_KEY = {5}, set(range(16, 22))
"""Kinds of units that an image without predecessors is made of (ITU-T H.264, table 7-1; H.265, table 7-1)."""


def is_key(packet: VideoPacket) -> bool:
    """Return whether a packet (Annex B) begins an image that needs none before it."""
    codec = _codec(packet.codec)
    keys = {"h264": _H264_KEY, "hevc": _H265_KEY}.get(codec)
    return keys is not None and any((u & 31 if codec == "h264" else (u >> 1) & 63) in keys for u in _units(packet.data))


def holds_key(message: bytes | memoryview) -> bool:
    """Return whether a message that holds a packet may begin such an image, whatever its codec."""
    data = bytes(message)
    return any(u & 31 in _H264_KEY or (u >> 1) & 63 in _H265_KEY for u in _units(data))


def _units(data: bytes) -> Iterator[int]:
    """Yield the first byte of each unit of a packet (behind the start codes of Annex B)."""
    at = 0
    while (at := data.find(b"\0\0\1", at)) >= 0 and at + 3 < len(data):
        yield data[at + 3]
        at += 3


class VideoDecoder:
    """Decodes the packets of one video, in their order."""

    def __init__(self, codec: str) -> None:
        try:
            import av  # noqa: PLC0415  (an extra)
        except ImportError as error:
            raise DetectError(
                f"a video ({printable(codec)}), which is read with an extra", remedy="pip install 'boxcal[video]'"
            ) from error
        av.logging.set_level(None)
        self._av: Any = av
        try:
            self._context: Any = av.CodecContext.create(_codec(codec), "r")
            self._context.thread_count = 1
            self._context.flags |= 1 << 19  # low delay: an image for each packet
        except (av.error.FFmpegError, ValueError) as error:
            raise DetectError(f"a video of codec {printable(codec)} is not read; record H.264 or H.265") from error

    def pictures(self, packet: VideoPacket, number: int) -> Iterator[tuple[int, DeepGrey]]:
        """Yield the images that a packet completes, with their numbers, grey (H, W); none where it is damaged.

        Raises
        ------
        DetectError
            If an image is too large.
        """
        try:
            packed = self._av.Packet(packet.data)
            packed.pts = packed.dts = number
            frames = self._context.decode(packed)
        except self._av.error.FFmpegError:
            return
        for frame in frames:
            check_size(frame.width, frame.height)
            yield (
                number if frame.pts is None else int(frame.pts),
                np.ascontiguousarray(frame.to_ndarray(format="gray"), dtype=np.uint8),
            )


def _codec(name: str) -> str:
    """Return FFmpeg's name of a codec; ffmpeg_image_transport writes ``h264;yuv420p;bgr8;bgr8``."""
    first = name.split(";", maxsplit=1)[0].strip().lower()
    return next((codec for key, codec in _CODECS.items() if key in first), first)
