"""Decoders: every kind and encoding gives the same grey image, and what cannot be read says why."""

import struct
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bayer import MOSAICS
from boxcal.detect.image.bit_depth import bits_of, eight_bits, full_scale
from boxcal.detect.log import images as messages
from boxcal.detect.log.containers.base import Batch, Channel
from boxcal.detect.log.images import (
    decode_compressed_image,
    decode_image,
    header_stamp_ns,
)
from boxcal.detect.log.joint_states import JointReader, joint_layout
from boxcal.detect.log.pictures import picture_size

STORE = get_typestore(Stores.ROS2_HUMBLE)
JOINTS = "sensor_msgs/msg/JointState"
GREY = np.random.default_rng(0).integers(0, 256, (24, 32), dtype=np.uint8)


def _header(sec: int = 12, nanosec: int = 345) -> Any:
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")


def _cdr(kind: str, *, little_endian: bool = True, **content: Any) -> bytes:
    message = STORE.types[kind](**({"header": _header()} | content))
    return bytes(STORE.serialize_cdr(message, kind, little_endian=little_endian))


def _image(encoding: str, height: int, width: int, step: int, data: bytes, *, is_bigendian: int = 0) -> bytes:
    return _cdr(
        messages.RAW_IMAGE,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=is_bigendian,
        step=step,
        data=np.frombuffer(data, dtype=np.uint8),
    )


def _batch(*data: bytes) -> Batch:
    ends = np.cumsum([len(d) for d in data]).tolist()
    channel = Channel(topic="/joint_states", type=JOINTS, encoding="cdr")
    return Batch(
        channel, b"".join(data), np.array([0, *ends[:-1]]), np.array(ends), np.zeros(len(data), dtype=np.int64), 0
    )


def _decode_joints(data: bytes) -> None:
    joint_layout(data, ros1=False)


def _compressed(data: bytes, name: str = "jpeg") -> bytes:
    return _cdr(messages.COMPRESSED_IMAGE, format=name, data=np.frombuffer(data, dtype=np.uint8))


@pytest.mark.parametrize("little_endian", [True, False])
def test_joints_decode_in_either_byte_order(little_endian: bool) -> None:
    data = _cdr(
        JOINTS,
        little_endian=little_endian,
        name=["a", "b"],
        position=np.array([1.5, np.nan]),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )
    (block,) = JointReader(ros1=False).blocks(_batch(data))
    assert (block.t_ns.tolist(), block.names) == ([12 * 10**9 + 345], ("a", "b"))
    np.testing.assert_array_equal(block.positions, [[1.5, np.nan]])
    assert header_stamp_ns(data) == block.t_ns[0]


def test_stamps_before_1970_are_read() -> None:
    data = _cdr(messages.COMPRESSED_IMAGE, header=_header(sec=-3), format="", data=np.zeros(1, dtype=np.uint8))
    assert header_stamp_ns(data) == -3 * 10**9 + 345


def test_names_and_positions_of_different_number_are_refused() -> None:
    data = _cdr(JOINTS, name=["a", "b"], position=np.zeros(3), velocity=np.zeros(0), effort=np.zeros(0))
    with pytest.raises(DetectError, match=r"2 names and 3 positions, one position a name is needed; check the driver"):
        joint_layout(data, ros1=False)


@pytest.mark.parametrize("encoding", ["mono8", "8UC1", "bgr8", "rgb8", "8UC3", "bgra8", "rgba8"])
@pytest.mark.parametrize("padding", [0, 5])
def test_every_encoding_gives_the_grey_image(encoding: str, padding: int) -> None:
    channels = {"mono8": 1, "8UC1": 1, "bgra8": 4, "rgba8": 4}.get(encoding, 3)
    pixels = np.repeat(GREY[..., None], channels, axis=2).reshape(24, -1)
    rows = np.pad(pixels, ((0, 0), (0, padding)), constant_values=77)
    image = decode_image(_image(encoding, 24, 32, rows.shape[1], rows.tobytes()))
    assert image.dtype == np.uint8
    assert image.shape == (24, 32)
    np.testing.assert_allclose(image.astype(int), GREY, atol=1)


def test_red_and_blue_are_told_apart() -> None:
    red = np.zeros((2, 2, 3), dtype=np.uint8)
    red[..., 0] = 255
    assert decode_image(_image("rgb8", 2, 2, 6, red.tobytes()))[0, 0] == 76
    assert decode_image(_image("bgr8", 2, 2, 6, red.tobytes()))[0, 0] == 29


@pytest.mark.parametrize("encoding", ["mono16", "16UC1", "bgr16", "rgb16", "16UC3", "bgra16", "rgba16"])
@pytest.mark.parametrize("is_bigendian", [0, 1])
@pytest.mark.parametrize("padding", [0, 3])
def test_sixteen_bits_are_kept_in_either_byte_order(encoding: str, is_bigendian: int, padding: int) -> None:
    channels = {"mono16": 1, "16UC1": 1, "bgra16": 4, "rgba16": 4}.get(encoding, 3)
    deep = np.random.default_rng(1).integers(0, 65_536, (24, 32), dtype=np.uint16)
    pixels = np.repeat(deep[..., None], channels, axis=2).astype(">u2" if is_bigendian else "<u2")
    rows = np.pad(pixels.view(np.uint8).reshape(24, -1), ((0, 0), (0, padding)), constant_values=77)
    image = decode_image(_image(encoding, 24, 32, rows.shape[1], rows.tobytes(), is_bigendian=is_bigendian))
    assert image.dtype == np.uint16
    assert image.shape == (24, 32)
    np.testing.assert_allclose(image.astype(int), deep, atol=2)


@pytest.mark.parametrize(("encoding", "luma"), [("yuv422", 1), ("uyvy", 1), ("yuv422_yuy2", 0), ("yuyv", 0)])
def test_of_yuv_the_luma_is_taken(encoding: str, luma: int) -> None:
    rows = np.full((24, 64 + 3), 128, dtype=np.uint8)
    rows[:, luma:64:2] = GREY
    np.testing.assert_array_equal(decode_image(_image(encoding, 24, 32, 67, rows.tobytes())), GREY)


@pytest.mark.parametrize("name", sorted(MOSAICS))
@pytest.mark.parametrize("bits", [8, 16])
def test_a_mosaic_is_brought_to_the_scale_of_its_green_pixels(name: str, bits: int) -> None:
    scale = 1 if bits == 8 else 257
    y, x = np.mgrid[:48, :64]
    step = cv2.GaussianBlur(np.where((x + 0.3 * y) // 8 % 2, 200.0, 30.0), (0, 0), 0.6)
    gain = {"r": 0.5, "g": 1.0, "b": 0.7}
    seen = step.copy()
    for k, letter in enumerate(name.removeprefix("bayer_")):
        seen[k // 2 :: 2, k % 2 :: 2] = 5 + gain[letter] * step[k // 2 :: 2, k % 2 :: 2]
    data = np.rint(seen * scale).astype(np.uint8 if bits == 8 else "<u2")
    image = decode_image(_image(f"{name}{bits}", 48, 64, 64 * bits // 8, data.tobytes()))
    np.testing.assert_allclose(image / scale, 5 + step, atol=2)


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (1, 40), (15, 16), (16, 16), (17, 19)])
def test_a_mosaic_without_contrast_or_too_small_to_tell_is_left_as_it_is(shape: tuple[int, int]) -> None:
    for value in (0, 7, 255):
        data = bytes([value]) * (shape[0] * shape[1])
        image = decode_image(_image("bayer_rggb8", *shape, shape[1], data))
        np.testing.assert_array_equal(image, np.full(shape, value))


def test_bits_are_told_from_the_largest_value() -> None:
    for most, bits in ((0, 8), (255, 8), (256, 10), (1023, 10), (1024, 12), (4095, 12), (16_383, 14), (16_384, 16)):
        assert bits_of(np.array([[0, most]], dtype=np.uint16)) == bits


def test_white_of_any_depth_becomes_the_same_white() -> None:
    for bits in (10, 12, 14, 16):
        white = np.array([[0, (1 << bits) - 1]], dtype=np.uint16)
        np.testing.assert_array_equal(full_scale(white, bits), [[0, 65_535]])
        np.testing.assert_array_equal(eight_bits(full_scale(white, bits)), [[0, 255]])
    np.testing.assert_array_equal(full_scale(np.array([[0, 4095]], dtype=np.uint16), 10), [[0, 65_535]])
    assert full_scale(GREY, 8) is GREY
    assert eight_bits(GREY) is GREY


@pytest.mark.parametrize("encoding", ["32FC1", "16SC1", "yv12", "bayer_rggb12", "mono", "\x1b[31m"])
def test_an_encoding_that_is_not_read_is_named(encoding: str) -> None:
    with pytest.raises(
        DetectError, match=r"image encoding '[^\x1b]+' is not read \(read: mono8, .*bayer_grbg16\); record"
    ):
        decode_image(_image(encoding, 2, 2, 4, bytes(8)))


@pytest.mark.parametrize(
    ("encoding", "step", "size", "message"),
    [
        ("mono16", 7, 16, r"4 x 2 px mono16 has rows of 7 bytes and 16 bytes in all, 8 and 16 are needed"),
        ("mono16", 8, 15, r"rows of 8 bytes and 15 bytes in all, 8 and 16 are needed"),
        ("16UC1", 4, 8, r"rows of 4 bytes and 8 bytes in all, 8 and 16 are needed"),
        ("bgr16", 12, 24, r"rows of 12 bytes and 24 bytes in all, 24 and 48 are needed"),
        ("bayer_gbrg16", 4, 8, r"rows of 4 bytes and 8 bytes in all, 8 and 16 are needed"),
        ("bayer_gbrg8", 3, 8, r"rows of 3 bytes and 8 bytes in all, 4 and 8 are needed"),
        ("yuv422", 4, 8, r"rows of 4 bytes and 8 bytes in all, 8 and 16 are needed"),
        ("yuv422_yuy2", 1 << 31, 16, r"rows of 2147483648 bytes and 16 bytes in all, 8 and 4294967296 are needed"),
    ],
)
def test_every_kind_of_pixel_has_its_number_of_bytes(encoding: str, step: int, size: int, message: str) -> None:
    with pytest.raises(DetectError, match=message):
        decode_image(_image(encoding, 2, 4, step, bytes(size)))


@pytest.mark.parametrize(
    ("height", "width", "step", "size", "message"),
    [
        (2, 4, 3, 8, r"rows of 3 bytes and 8 bytes in all, 4 and 8 are needed"),
        (3, 4, 4, 8, r"rows of 4 bytes and 8 bytes in all, 4 and 12 are needed"),
        (0, 4, 4, 8, r"an image of 4 x 0 px: between 1 px and 25 Mpx"),
        (1 << 31, 1 << 31, 1 << 31, 8, r"an image of 2147483648 x 2147483648 px"),
    ],
)
def test_size_step_and_data_must_agree(height: int, width: int, step: int, size: int, message: str) -> None:
    with pytest.raises(DetectError, match=message):
        decode_image(_image("mono8", height, width, step, bytes(size)))


@pytest.mark.parametrize("kind", [".png", ".jpg"])
@pytest.mark.parametrize("colour", [True, False])
def test_jpeg_and_png_decode_whatever_the_format_says(kind: str, colour: bool) -> None:
    smooth = cv2.GaussianBlur(GREY, (0, 0), 3)
    source = cv2.cvtColor(smooth, cv2.COLOR_GRAY2BGR) if colour else smooth
    content = cv2.imencode(kind, source)[1].tobytes()
    assert picture_size(content) == (32, 24)
    image = decode_compressed_image(_compressed(content, "anything"))
    np.testing.assert_allclose(image.astype(int), smooth, atol=4)


def test_a_png_keeps_its_sixteen_bits() -> None:
    deep = np.random.default_rng(1).integers(0, 65_536, (24, 32), dtype=np.uint16)
    for source in (deep, cv2.cvtColor(deep, cv2.COLOR_GRAY2BGR)):
        image = decode_compressed_image(
            _compressed(cv2.imencode(".png", source)[1].tobytes(), "mono16; png compressed")
        )
        assert image.dtype == np.uint16
        np.testing.assert_allclose(image.astype(int), deep, atol=2)


def test_a_picture_is_not_turned_by_its_exif_data() -> None:
    content = cv2.imencode(".jpg", GREY)[1].tobytes()
    tiff = b"MM\x00\x2a\x00\x00\x00\x08\x00\x01" + struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0) + bytes(4)
    exif = b"Exif\x00\x00" + tiff
    turned = content[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + content[2:]
    assert decode_compressed_image(_compressed(turned)).shape == GREY.shape


def test_a_picture_that_claims_too_many_pixels_is_not_decoded() -> None:
    png = bytearray(cv2.imencode(".png", GREY)[1].tobytes())
    struct.pack_into(">II", png, 16, 60_000, 60_000)
    with pytest.raises(DetectError, match=r"an image of 60000 x 60000 px: between 1 px and 25 Mpx can be read"):
        decode_compressed_image(_compressed(bytes(png)))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"0 bytes\) is neither JPEG nor PNG nor WebP nor TIFF; record"),
        (b"GIF89a", r"\(format 'jpeg', 6 bytes\) is neither JPEG nor PNG"),
        (b"\xff\xd8\xff", r"neither JPEG nor PNG"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x02\x00\x00\x00\x02", r"does not decode"),
    ],
)
def test_a_picture_that_is_none_is_named(content: bytes, message: str) -> None:
    with pytest.raises(DetectError, match=message):
        decode_compressed_image(_compressed(content))


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00", b"\x00\x07" + bytes(30), b"\x09\x01" + bytes(30)])
def test_bytes_that_are_no_cdr_are_refused(data: bytes) -> None:
    for decode in (_decode_joints, decode_image, decode_compressed_image, header_stamp_ns):
        with pytest.raises(DetectError, match=r"not plain CDR"):
            decode(data)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=200))
def test_no_bytes_end_in_anything_but_a_detect_error(tail: bytes) -> None:
    for decode in (_decode_joints, decode_image, decode_compressed_image):
        for data in (tail, b"\x00\x01\x00\x00" + bytes(8) + tail, b"\x00\x00\x00\x00" + bytes(8) + tail):
            try:
                decode(data)
            except DetectError as error:
                assert len(str(error)) < 600  # noqa: PT017 - an error is allowed, not required
    picture_size(b"\xff\xd8\xff\xe0" + tail)
    picture_size(b"\x89PNG\r\n\x1a\n" + tail)
