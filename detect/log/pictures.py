"""Images as bytes (JPEG, PNG, WebP, TIFF) and rows of pixels as grey images."""

import os
import struct
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import IO, Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bayer import MOSAICS, even_mosaic
from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.detect.log.safe_text import printable

MAX_IMAGE_PX = 25_000_000
"""Largest image that is decoded, in pixels: the detector needs some 20 bytes a pixel."""
MAX_PICTURE_BYTES = 256 << 20

_NAMES_OF_8 = {"mono8": 1, "8UC1": 1, "bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}
_NAMES_OF_16 = {"mono16": 1, "16UC1": 1, "bgr16": 3, "16UC3": 3, "rgb16": 3, "bgra16": 4, "rgba16": 4}
_LUMA_AT = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
"""Which byte of each two is the luma: 4:2:2 stands as U Y V Y, or as Y U Y V."""
_PLANAR_LUMA = {"nv12", "nv21", "nv24", "i420", "yuv420"}
"""The luma of all pixels comes first, whatever follows."""
_CHANNELS = (
    _NAMES_OF_8
    | _NAMES_OF_16
    | dict.fromkeys(_LUMA_AT, 2)
    | dict.fromkeys(_PLANAR_LUMA, 1)
    | {f"{name}{n}": 1 for name in MOSAICS for n in (8, 16)}
)
_TO_GREY = {
    "bgr": cv2.COLOR_BGR2GRAY,
    "8UC": cv2.COLOR_BGR2GRAY,
    "16UC": cv2.COLOR_BGR2GRAY,
    "rgb": cv2.COLOR_RGB2GRAY,
    "bgra": cv2.COLOR_BGRA2GRAY,
    "rgba": cv2.COLOR_RGBA2GRAY,
}
_SOF = {0xC0 + k for k in range(16)} - {0xC4, 0xC8, 0xCC}
"""JPEG's start-of-frame markers (ITU-T T.81, table B.1)."""


def check_size(width: int, height: int) -> None:
    """Refuse an image without pixels or with too many (DetectError)."""
    if not (width > 0 and height > 0 and width * height <= MAX_IMAGE_PX):
        raise DetectError(
            f"an image of {width} x {height} px: between 1 px and {MAX_IMAGE_PX // 1_000_000} Mpx can be read; check "
            "the camera driver"
        )


def grey_of_rows(  # noqa: PLR0917  the message's fields in their order
    height: int, width: int, encoding: str, is_bigendian: int, step: int, data: NDArray[np.uint8]
) -> DeepGrey:
    """Return rows of pixels (``sensor_msgs/Image``) as a grey image (H, W), uint8 or uint16 as they are.

    A colour mosaic (``bayer_*``) is not interpolated, as that would move corners by hundredths of a pixel: its colours
    are brought to one scale (:func:`even_mosaic`). Of YUV the luma is taken as it stands.

    Raises
    ------
    DetectError
        If the encoding is not read, or size, step and data do not agree.
    """
    channels = _CHANNELS.get(encoding)
    if channels is None:
        raise DetectError(
            f"image encoding {printable(encoding)!r} is not read (read: {', '.join(_CHANNELS)}); record the camera's "
            "mono or colour topic, or its compressed one"
        )
    check_size(width, height)
    deep = encoding in _NAMES_OF_16 or encoding.endswith("16")
    used = width * channels * (2 if deep else 1)
    if step < used or data.size < step * height:
        raise DetectError(
            f"an image of {width} x {height} px {encoding} has rows of {step} bytes and {data.size} bytes in "
            f"all, {used} and {max(step, used) * height} are needed; check the camera driver"
        )
    rows = np.asarray(data[: step * height], dtype=np.uint8).reshape(height, step)[:, :used]
    if deep:
        rows = np.ascontiguousarray(rows).view(">u2" if is_bigendian else "<u2").astype(np.uint16)
    if encoding in _LUMA_AT:
        return np.ascontiguousarray(rows[:, _LUMA_AT[encoding] :: 2])
    name = encoding.rstrip("0123456789")
    pixels = np.ascontiguousarray(rows)
    if name in MOSAICS:
        return even_mosaic(pixels, name)
    if channels == 1:
        return pixels
    return np.asarray(cv2.cvtColor(pixels.reshape(height, width, channels), _TO_GREY[name]))


def grey_of_picture(content: bytes, format: str = "") -> DeepGrey:  # noqa: A002  the field's name in the message
    """Return a JPEG, PNG, WebP or TIFF as a grey image (H, W): uint16 if it has 16 bits a pixel, else uint8.

    The image's own header decides what it is and how large (checked before decoding); ``format`` is not trusted. A
    rotation in EXIF data is not applied: pixels are the sensor's. An image that decodes only in part is refused.

    Raises
    ------
    DetectError
        If it is none of these, too large, or does not decode whole.
    """
    size = picture_size(content)
    if size is None:
        raise DetectError(
            f"a compressed image (format {printable(format)!r}, {len(content)} bytes) is neither JPEG nor PNG nor "
            "WebP nor TIFF; record the camera as raw, JPEG or PNG"
        )
    check_size(*size)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        with _decoder_complaints() as complaints:
            image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    except cv2.error as error:
        raise DetectError(f"a compressed image does not decode ({error.err}); it is damaged") from error
    if image is None or (image.shape[1], image.shape[0]) != size:
        raise DetectError(f"a compressed image of {len(content)} bytes does not decode; it is damaged")
    if complaints:
        raise DetectError(f"a compressed image of {len(content)} bytes decodes in part ({printable(complaints[0])})")
    if image.dtype not in {np.dtype(np.uint8), np.dtype(np.uint16)}:
        raise DetectError(
            f"a picture of {image.dtype} values, 8 or 16 bits are needed; record the camera's colour topic"
        )
    return np.asarray(image)


def grey_of_zipped_rows(content: bytes) -> DeepGrey:
    """Return the pixels that the transport ``zstd`` of image_transport packs (with zlib, for all its name).

    Height, width (uint32), byte order (uint8), step and the length of the encoding (uint32), the encoding, the pixels
    (zstd_image_transport, ``zstd_publisher.cpp``).
    """
    try:
        height, width, big, step, length = struct.unpack_from("<IIBII", content)
        if length > 64:
            raise ValueError("no encoding")
        encoding = content[17 : 17 + length].decode("ascii")
        check_size(width, height)
        if step > 16 * width or step * height > MAX_PICTURE_BYTES:
            raise ValueError(f"rows of {step} bytes")
        pixels = zlib.decompressobj(wbits=47).decompress(content[17 + length :], step * height + 1)
    except (struct.error, ValueError, zlib.error) as error:
        raise DetectError(f"an image of transport zstd does not unpack ({error}); it is damaged") from error
    return grey_of_rows(height, width, encoding, big, step, np.frombuffer(pixels, dtype=np.uint8))


def picture_size(content: bytes) -> tuple[int, int] | None:
    """Return width and height (px) from the header of a JPEG, PNG, WebP or TIFF, None if it is none of them.

    PNG: the IHDR chunk comes first. JPEG: the first start-of-frame segment (ITU-T T.81, B.2.2). WebP: the first chunk
    (RFC 9649). TIFF: tags 256 and 257 of the first directory.
    """
    try:
        if content[:8] == b"\x89PNG\r\n\x1a\n" and content[12:16] == b"IHDR":
            return cast("tuple[int, int]", struct.unpack_from(">II", content, 16))
        if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
            return _webp_size(content)
        if content[:4] in {b"II*\0", b"MM\0*"}:
            return _tiff_size(content, "<" if content[:2] == b"II" else ">")
        return _jpeg_size(content) if content[:2] == b"\xff\xd8" else None
    except struct.error:
        return None


def _jpeg_size(content: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if marker == 0xFF:
            at += 1
        elif marker in _SOF:
            height, width = struct.unpack_from(">HH", content, at + 5)
            return int(width), int(height)
        elif marker == 0x01 or 0xD0 <= marker <= 0xD8:
            at += 2
        else:
            at += 2 + int(struct.unpack_from(">H", content, at + 2)[0])
    return None


def _webp_size(content: bytes) -> tuple[int, int] | None:
    kind = content[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return (bits & 0x3FFF) + 1, ((bits >> 14) & 0x3FFF) + 1
    if kind == b"VP8X":
        low = struct.unpack_from("<HBHB", content, 24)
        return low[0] + (low[1] << 16) + 1, low[2] + (low[3] << 16) + 1
    return None


def _tiff_size(content: bytes, order: str) -> tuple[int, int] | None:
    (at,) = struct.unpack_from(f"{order}I", content, 4)
    (count,) = struct.unpack_from(f"{order}H", content, at)
    found: dict[int, int] = {}
    for k in range(min(count, 200)):
        tag, kind = struct.unpack_from(f"{order}HH", content, at + 2 + 12 * k)
        if tag in {256, 257}:
            form = "H" if kind == 3 else "I"
            found[tag] = int(struct.unpack_from(f"{order}{form}", content, at + 10 + 12 * k)[0])
    return (found[256], found[257]) if len(found) == 2 else None


@contextmanager
def _decoder_complaints() -> Iterator[list[str]]:
    """Catch what image libraries write to the standard error while they decode: a damaged image, or a mere hint.

    libjpeg, libpng and libtiff print; OpenCV offers no other way to hear them. What they say of damage is given to the
    caller, so that the terminal stays clean and a half decoded image is not taken for a whole one.
    """
    complaints: list[str] = []
    catcher = _catcher()
    held = os.dup(2)
    try:
        os.dup2(catcher.fileno(), 2)
        try:
            yield complaints
        finally:
            os.dup2(held, 2)
    finally:
        os.close(held)
    if catcher.seek(0, os.SEEK_END):
        catcher.seek(0)
        lines = catcher.read(4096).decode("utf-8", "replace").splitlines()
        complaints += [line.strip() for line in lines if line.strip() and "extraneous bytes" not in line]
        catcher.seek(0)
        catcher.truncate()


@cache
def _catcher() -> IO[bytes]:
    """Return the file that the standard error of decoders goes to, empty between images."""
    return tempfile.TemporaryFile()


Picture = NDArray[Any]
