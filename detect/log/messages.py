"""One decoder per message kind: CDR bytes to plain values and grey images."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bayer import MOSAICS, even_mosaic
from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.detect.log.safe_text import printable
from boxcal.target.arrays import Array

Grey = NDArray[np.uint8]

JOINTS = "sensor_msgs/msg/JointState"
RAW_IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"

MAX_IMAGE_PX = 100_000_000
"""Largest image that is decoded, in pixels."""
MAX_JOINTS = 10_000

_NS = 1_000_000_000
_NAMES_OF_8 = {"mono8": 1, "8UC1": 1, "bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}
_NAMES_OF_16 = {"mono16": 1, "16UC1": 1, "bgr16": 3, "16UC3": 3, "rgb16": 3, "bgra16": 4, "rgba16": 4}
_LUMA_AT = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
"""Which byte of each two is the luma: 4:2:2 stands as U Y V Y, or as Y U Y V."""
_CHANNELS = (
    _NAMES_OF_8 | _NAMES_OF_16 | dict.fromkeys(_LUMA_AT, 2) | {f"{name}{n}": 1 for name in MOSAICS for n in (8, 16)}
)
_TO_GREY = {
    "bgr": cv2.COLOR_BGR2GRAY,
    "8UC": cv2.COLOR_BGR2GRAY,
    "16UC": cv2.COLOR_BGR2GRAY,
    "rgb": cv2.COLOR_RGB2GRAY,
    "bgra": cv2.COLOR_BGRA2GRAY,
    "rgba": cv2.COLOR_RGBA2GRAY,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointState:
    """One joint message.

    Attributes
    ----------
    t_ns : ns
        Header stamp.
    names
        Joints in the message.
    positions : (len(names),), rad
        Empty if the message carries no positions.
    """

    t_ns: int
    names: tuple[str, ...]
    positions: Array


def header_stamp_ns(data: bytes | memoryview) -> int:
    """Return the header stamp (ns) of any message that begins with a ``std_msgs/Header``, without decoding the rest.

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


def decode_joints(data: bytes | memoryview) -> JointState:
    """Decode a ``sensor_msgs/msg/JointState``.

    Raises
    ------
    DetectError
        If the bytes are no such message, or names and positions differ in number.
    """
    message = _deserialise(data, JOINTS)
    names, positions = tuple(message.name), np.asarray(message.position, dtype=np.float64)
    if len(names) > MAX_JOINTS:
        raise DetectError(f"a joint message names {len(names)} joints, at most {MAX_JOINTS} are read")
    if positions.size not in {0, len(names)}:
        raise DetectError(
            f"a joint message has {len(names)} names and {positions.size} positions, one position a name is needed; "
            "check the driver that publishes it"
        )
    return JointState(t_ns=_stamp(message), names=names, positions=positions)


def decode_image(data: bytes | memoryview) -> DeepGrey:
    """Decode a ``sensor_msgs/msg/Image`` to a grey image (H, W), uint8 or uint16 as the message has it.

    A colour mosaic (``bayer_*``) is not interpolated, as that would move corners by hundredths of a pixel: its colours
    are brought to one scale (:func:`even_mosaic`). Of YUV 4:2:2 the luma is taken as it stands.

    Raises
    ------
    DetectError
        If the encoding is not read, or size, step and data do not agree.
    """
    message = _deserialise(data, RAW_IMAGE)
    encoding, height, width, step = message.encoding, int(message.height), int(message.width), int(message.step)
    channels = _CHANNELS.get(encoding)
    if channels is None:
        raise DetectError(
            f"image encoding {printable(encoding)!r} is not read (read: {', '.join(_CHANNELS)}); record the camera's "
            "mono or colour topic, or its compressed one"
        )
    _check_size(width, height)
    deep = encoding in _NAMES_OF_16 or encoding.endswith("16")
    used = width * channels * (2 if deep else 1)
    if step < used or message.data.size < step * height:
        raise DetectError(
            f"an image of {width} x {height} px {encoding} has rows of {step} bytes and {message.data.size} bytes in "
            f"all, {used} and {max(step, used) * height} are needed; check the camera driver"
        )
    rows = np.asarray(message.data[: step * height], dtype=np.uint8).reshape(height, step)[:, :used]
    if deep:
        rows = np.ascontiguousarray(rows).view(">u2" if message.is_bigendian else "<u2").astype(np.uint16)
    if encoding in _LUMA_AT:
        return np.ascontiguousarray(rows[:, _LUMA_AT[encoding] :: 2])
    name = encoding.rstrip("0123456789")
    pixels = np.ascontiguousarray(rows)
    if name in MOSAICS:
        return even_mosaic(pixels, name)
    if channels == 1:
        return pixels
    return np.asarray(cv2.cvtColor(pixels.reshape(height, width, channels), _TO_GREY[name]))


def decode_compressed_image(data: bytes | memoryview) -> DeepGrey:
    """Decode a ``sensor_msgs/msg/CompressedImage`` that holds a JPEG or PNG to a grey image (H, W).

    It is uint16 if a PNG has 16 bits, else uint8.

    The picture's own header decides what it is and how large (checked before decoding); the message's ``format`` is
    not trusted. A rotation in EXIF data is not applied: pixels are the sensor's.

    Raises
    ------
    DetectError
        If it is neither, too large, or does not decode.
    """
    message = _deserialise(data, COMPRESSED_IMAGE)
    content = np.ascontiguousarray(message.data, dtype=np.uint8)
    size = picture_size(content.tobytes())
    if size is None:
        raise DetectError(
            f"a compressed image (format {printable(message.format)!r}, {content.size} bytes) is neither JPEG nor PNG; "
            "record the camera as raw, JPEG or PNG"
        )
    _check_size(*size)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(content, flags)
    except cv2.error as error:
        raise DetectError(f"a compressed image does not decode ({error.err}); it is damaged") from error
    if image is None or (image.shape[1], image.shape[0]) != size:
        raise DetectError(f"a compressed image of {content.size} bytes does not decode; it is damaged")
    return np.asarray(image)


DECODERS: dict[str, Callable[[bytes | memoryview], DeepGrey]] = {
    RAW_IMAGE: decode_image,
    COMPRESSED_IMAGE: decode_compressed_image,
}
"""Image decoder by message type."""


def picture_size(content: bytes) -> tuple[int, int] | None:
    """Return width and height (px) from the header of a JPEG or PNG, None if it is neither.

    PNG: the IHDR chunk comes first. JPEG: the first start-of-frame segment (ITU-T T.81, B.2.2).
    """
    if content[:8] == b"\x89PNG\r\n\x1a\n" and content[12:16] == b"IHDR" and len(content) >= 24:
        width, height = struct.unpack_from(">II", content, 16)
        return int(width), int(height)
    if content[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if marker == 0xFF:
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in {0xC4, 0xC8, 0xCC}:
            height, width = struct.unpack_from(">HH", content, at + 5)
            return int(width), int(height)
        elif marker == 0x01 or 0xD0 <= marker <= 0xD8:
            at += 2
        else:
            at += 2 + int(struct.unpack_from(">H", content, at + 2)[0])
    return None


def _check_size(width: int, height: int) -> None:
    if not (width > 0 and height > 0 and width * height <= MAX_IMAGE_PX):
        raise DetectError(
            f"an image of {width} x {height} px: between 1 px and {MAX_IMAGE_PX // 1_000_000} Mpx can be read; check "
            "the camera driver"
        )


@cache
def _store() -> Any:
    return get_typestore(Stores.ROS2_HUMBLE)


def _deserialise(data: bytes | memoryview, kind: str) -> Any:
    header_stamp_ns(data)
    try:
        return _store().deserialize_cdr(data, kind)
    except (SerdeError, AssertionError, ValueError, IndexError, struct.error) as error:
        raise DetectError(f"a message does not decode as {kind} ({error}); the log or its schema is damaged") from error


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * _NS + int(message.header.stamp.nanosec)
