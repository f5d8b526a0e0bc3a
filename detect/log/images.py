"""Image messages of every kind: their stamps in passing, and their pixels when they are asked for."""

import base64
import binascii
import struct
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.detect.log.containers.base import Channel, ros_type
from boxcal.detect.log.containers.packing import message_unpacked
from boxcal.detect.log.pictures import grey_of_picture, grey_of_rows, grey_of_zipped_rows
from boxcal.detect.log.ros_messages import decoder_of, stamp_of

Grey = NDArray[np.uint8]

RAW_IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
VIDEO_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
FOXGLOVE = {
    "foxglove.CompressedImage": COMPRESSED_IMAGE,
    "foxglove.RawImage": RAW_IMAGE,
    "foxglove.CompressedVideo": VIDEO_PACKET,
    "foxglove_msgs/msg/CompressedImage": COMPRESSED_IMAGE,
    "foxglove_msgs/msg/RawImage": RAW_IMAGE,
    "foxglove_msgs/msg/CompressedVideo": VIDEO_PACKET,
}
"""Foxglove's image types, by name in protobuf and JSON and in ROS, and the ROS type that each is like."""
PICTURE_FILE = "picture"
IMAGE_TYPES = {RAW_IMAGE, COMPRESSED_IMAGE, VIDEO_PACKET, *FOXGLOVE}
_NS = 1_000_000_000
_HEADER_FIRST = {RAW_IMAGE, COMPRESSED_IMAGE, VIDEO_PACKET}


@dataclass(slots=True, kw_only=True, eq=False)
class ImageSeries:
    """The images of one topic and type: when, and where they stand.

    Attributes
    ----------
    channel
        The (first) channel that they came in.
    kind
        Their type.
    t_ns, log_ns : ns
        Header stamps, and when they were recorded.
    record, inner
        Where each stands in the recording.
    encoding
        Of the pixels of the first raw image, empty of others.
    """

    channel: Channel
    kind: str
    encoding: str = ""
    t_ns: "array[int]" = field(default_factory=lambda: array("q"))
    log_ns: "array[int]" = field(default_factory=lambda: array("q"))
    record: "array[int]" = field(default_factory=lambda: array("q"))
    inner: "array[int]" = field(default_factory=lambda: array("q"))

    @property
    def is_video(self) -> bool:
        """Whether an image builds on those before it."""
        return FOXGLOVE.get(self.kind, self.kind) == VIDEO_PACKET

    def add(self, stamp_ns: int, log_ns: int, record: int, inner: int) -> None:
        """Note an image."""
        self.t_ns.append(stamp_ns)
        self.log_ns.append(min(log_ns, (1 << 63) - 1))
        self.record.append(record)
        self.inner.append(inner)

    def sort(self) -> None:
        """Bring images that were read out of order into that of the recording."""
        order = sorted(range(len(self.record)), key=lambda k: (self.record[k], self.inner[k]))
        for name in ("t_ns", "log_ns", "record", "inner"):
            values = getattr(self, name)
            setattr(self, name, array("q", (values[k] for k in order)))


def header_stamp_ns(data: bytes | memoryview) -> int:
    """Return the header stamp (ns) of a CDR message that begins with a ``std_msgs/Header``, decoding no more of it.

    CDR: four bytes of encapsulation (the second names the byte order), then int32 seconds and uint32 nanoseconds.

    Raises
    ------
    DetectError
        If the message is too short or of no known encapsulation.
    """
    if len(data) < 12 or data[0] != 0 or data[1] not in {0, 1}:
        raise DetectError("a message is not plain CDR; record with a ROS 2 whose middleware writes CDR")
    sec, nanosec = struct.unpack_from("<iI" if data[1] else ">iI", data, 4)
    return int(sec) * _NS + int(nanosec)


def image_stamp_ns(channel: Channel, kind: str, data: memoryview, log_ns: int) -> int:
    """Return an image's stamp, ns: from its header where that comes first, else by decoding the message."""
    if channel.encoding == PICTURE_FILE:
        return log_ns
    if kind in _HEADER_FIRST or kind.startswith("foxglove_msgs/"):
        data = memoryview(message_unpacked(data)) if channel.packed else data
        if channel.encoding == "cdr":
            return header_stamp_ns(data)
        if channel.encoding == "ros1":
            if len(data) < 12:
                raise DetectError("a message of ROS 1 is cut short; the log is damaged")
            sec, nanosec = struct.unpack_from("<II", data, 4)
            return int(sec) * _NS + int(nanosec)
    stamp = stamp_of(decoder_of(channel)(bytes(data)))
    return 0 if stamp is None else stamp


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VideoPacket:
    """One message of a video: its codec's name and its bytes."""

    codec: str
    data: bytes


def decode_frame(channel: Channel, data: bytes) -> DeepGrey | VideoPacket:
    """Return an image message's pixels, grey, uint8 or uint16 (H, W); of a video the packet.

    Raises
    ------
    DetectError
        If it does not decode; the message says why.
    """
    if channel.encoding == PICTURE_FILE:
        return grey_of_picture(data)
    kind = ros_type(channel.type) if channel.encoding != "protobuf" else channel.type
    message = decoder_of(channel)(data)
    like = FOXGLOVE.get(kind, kind)
    try:
        if like == VIDEO_PACKET:
            codec = str(_field(message, "encoding" if kind == VIDEO_PACKET else "format"))
            return VideoPacket(codec=codec, data=_bytes(_field(message, "data")))
        if like == RAW_IMAGE:
            return grey_of_rows(
                int(_field(message, "height")),
                int(_field(message, "width")),
                str(_field(message, "encoding")),
                int(_field(message, "is_bigendian", 0)),
                int(_field(message, "step")),
                np.frombuffer(_bytes(_field(message, "data")), dtype=np.uint8),
            )
        content, name = _bytes(_field(message, "data")), str(_field(message, "format", ""))
    except (AttributeError, KeyError, TypeError, binascii.Error) as error:
        raise DetectError(f"an image message without {error}; the log or its schema is damaged") from error
    if channel.topic.endswith("/zstd"):
        return grey_of_zipped_rows(content)
    return grey_of_picture(content, name)


def raw_encoding(channel: Channel, kind: str, data: bytes) -> str:
    """Return the encoding of a raw image's pixels, empty of other images (DetectError if it does not decode)."""
    if FOXGLOVE.get(kind, kind) != RAW_IMAGE:
        return ""
    return str(_field(decoder_of(channel)(data), "encoding", ""))[:64]


def frame_id_of(channel: Channel, data: bytes) -> str:
    """Return the camera's frame that an image message names, empty if it names none."""
    if channel.encoding == PICTURE_FILE:
        return ""
    message = decoder_of(channel)(data)
    header = _field(message, "header", None)
    return str(_field(message if header is None else header, "frame_id", ""))[:256]


def decode_image(data: bytes | memoryview) -> DeepGrey:
    """Decode a ``sensor_msgs/msg/Image`` in CDR to a grey image (see :func:`grey_of_rows`)."""
    return _decoded(RAW_IMAGE, data)


def decode_compressed_image(data: bytes | memoryview) -> DeepGrey:
    """Decode a ``sensor_msgs/msg/CompressedImage`` in CDR to a grey image (see :func:`grey_of_picture`)."""
    return _decoded(COMPRESSED_IMAGE, data)


def _decoded(kind: str, data: bytes | memoryview) -> DeepGrey:
    header_stamp_ns(data)
    image = decode_frame(Channel(topic="", type=kind, encoding="cdr"), bytes(data))
    if isinstance(image, VideoPacket):
        raise DetectError("a video's packet is no image")
    return image


_MISSING = object()


def _field(message: Any, name: str, default: Any = _MISSING) -> Any:
    if isinstance(message, dict):
        return message[name] if default is _MISSING else message.get(name, default)
    return getattr(message, name) if default is _MISSING else getattr(message, name, default)


def _bytes(data: Any) -> bytes:
    """Return bytes: JSON holds them in base64, or as a list of numbers."""
    if isinstance(data, str):
        return base64.b64decode(data, validate=True)
    if isinstance(data, list):
        try:
            return bytes(data)
        except ValueError as error:
            raise TypeError(f"bytes ({error})") from error
    return bytes(memoryview(data))
