"""Cameras of every kind: a frame of more bits, as a colour mosaic or YUV has the corners of its 8-bit grey frame."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from small_logs import CAMERA, COMPRESSED, T0_NS, write_joints, write_log
from small_views import CAMERA as CAMERA_MODEL
from small_views import SIZE, TARGET, T_cam_box, view

from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import ExtractSettings, extract
from boxcal.detect.image.bayer import MOSAICS
from boxcal.detect.log.images import RAW_IMAGE
from boxcal.detect.log.open_recording import open_recording
from boxcal.target.box import FACES
from boxcal.target.camera.camera_model import project
from boxcal.target.render.srgb import srgb_from_linear

ANGLES = (10.0, 45.0, 130.0)
STORE = get_typestore(Stores.ROS2_HUMBLE)
LINEAR = ExtractSettings(response="linear")
GAIN = {"r": 0.55, "g": 1.0, "b": 0.7}
TINT = {"r": 1.3, "g": 0.8, "b": 0.35}
BLACK_LEVEL = 6

Bytes = tuple[str, int, NDArray[np.uint8]]
"""Encoding, bytes a row, and the rows (H, step)."""
Camera = Callable[[float, NDArray[np.uint8]], Bytes]


def _deep(bits: int, exposure: float = 1.0, name: str = "mono16") -> Camera:
    """A camera of so many bits in 16; ``exposure`` is its white as a share of full scale."""

    def take(_: float, grey: NDArray[np.uint8]) -> Bytes:
        return _rows(name, np.rint(grey * (exposure * ((1 << bits) - 1) / 255)).astype("<u2"))

    return take


def _srgb(light: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return light, 255 at full scale, through sRGB's response curve."""
    return np.rint(255 * srgb_from_linear(np.clip(light / 255, 0, 1).astype(np.float32))).astype(np.uint8)


def _bayer_srgb(name: str, exposure: float = 1.0, gain: Mapping[str, float] = GAIN) -> Camera:
    """A camera of unequal colours that codes brightness."""

    def take(angle_deg: float, grey: NDArray[np.uint8]) -> Bytes:
        box, seen = _on_the_box(angle_deg), grey.astype(np.float64) * exposure
        for k, letter in enumerate(name.removeprefix("bayer_")):
            place = np.s_[k // 2 :: 2, k % 2 :: 2]
            seen[place] = gain[letter] * (np.where(box, 1, TINT[letter]) * seen)[place]
        return _rows(f"{name}8", _srgb(seen))

    return take


def _bayer(name: str, bits: int = 8) -> Camera:
    """A camera of unequal colours before a wooden background; the box is black and white."""

    def take(angle_deg: float, grey: NDArray[np.uint8]) -> Bytes:
        box, seen = _on_the_box(angle_deg), grey.astype(np.float64)
        for k, letter in enumerate(name.removeprefix("bayer_")):
            place = np.s_[k // 2 :: 2, k % 2 :: 2]
            seen[place] = GAIN[letter] * np.minimum(np.where(box, grey, TINT[letter] * grey)[place], 240) + BLACK_LEVEL
        white = 255 if bits == 8 else (1 << bits) - 1
        dtype = np.uint8 if bits == 8 else np.dtype("<u2")
        return _rows(f"{name}{8 if bits == 8 else 16}", np.rint(seen * (white / 255)).astype(dtype))

    return take


def _yuv(name: str, luma: int) -> Camera:
    def take(_: float, grey: NDArray[np.uint8]) -> Bytes:
        rows = np.full((grey.shape[0], 2 * grey.shape[1]), 128, dtype=np.uint8)
        rows[:, luma::2] = grey
        return _rows(name, rows)

    return take


def _rows(encoding: str, pixels: NDArray[Any]) -> Bytes:
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(pixels.shape[0], -1)
    return encoding, rows.shape[1], rows


def _on_the_box(angle_deg: float) -> NDArray[np.bool_]:
    """Return the pixels of the box and a little more of it than its tags."""
    T = T_cam_box(angle_deg)
    mask = np.zeros(SIZE[::-1], dtype=np.uint8)
    for face in range(FACES):
        p_cam = TARGET.tag_corners[TARGET.tag_faces == face].reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
        hull = cv2.convexHull(project(CAMERA_MODEL, p_cam).astype(np.float32))
        cv2.fillConvexPoly(mask, hull.astype(np.int32), 1)
    return np.asarray(cv2.dilate(mask, np.ones((15, 15), dtype=np.uint8)) > 0)


def _log(path: Path, camera: Camera) -> Path:
    def write(log: LogWriter) -> None:
        for j, angle in enumerate(ANGLES):
            t = T0_NS + round((2.0 * j + 0.5) * 1e9)
            encoding, step, rows = camera(angle, view(angle, srgb=False))
            sec, nanosec = divmod(t, 10**9)
            stamp = STORE.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
            message = STORE.types[RAW_IMAGE](
                header=STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera"),
                height=SIZE[1],
                width=SIZE[0],
                encoding=encoding,
                is_bigendian=0,
                step=step,
                data=rows.ravel(),
            )
            log.message(CAMERA, t, message)

    return write_log(path, write_joints, write)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Correspondences:
    """What an 8-bit grey camera saw."""
    return extract(
        _log(tmp_path_factory.mktemp("plain") / "a.mcap", lambda _, g: _rows("mono8", g)), TARGET, settings=LINEAR
    )


@pytest.fixture(scope="module")
def plain_srgb(tmp_path_factory: pytest.TempPathFactory) -> Correspondences:
    """What an 8-bit grey camera saw that codes brightness."""
    path = _log(tmp_path_factory.mktemp("srgb") / "a.mcap", lambda _, g: _rows("mono8", _srgb(g.astype(np.float64))))
    return extract(path, TARGET, settings=ExtractSettings(response="srgb"))


def _off_px(found: Correspondences, plain: Correspondences) -> NDArray[np.float64]:
    """Return by how much corners differ, (N, 2) px; every landmark must have been found."""
    off = []
    for stop, same in zip(found.stops, plain.stops, strict=True):
        np.testing.assert_array_equal(stop.landmark_ids, same.landmark_ids)
        off.append(stop.uv_px - same.uv_px)
    return np.concatenate(off)


@pytest.mark.parametrize(
    ("camera", "rms_px"),
    [
        pytest.param(_deep(16), 0.002, id="16 bits"),
        pytest.param(_deep(12), 0.002, id="12 bits"),
        pytest.param(_deep(12, 0.3, "16UC1"), 0.002, id="12 bits, dark"),
        pytest.param(_deep(10), 0.002, id="10 bits"),
        pytest.param(_yuv("yuv422", 1), 1e-9, id="UYVY"),
        pytest.param(_yuv("yuv422_yuy2", 0), 1e-9, id="YUYV"),
        *(pytest.param(_bayer(name), 0.01, id=name) for name in sorted(MOSAICS)),
        pytest.param(_bayer("bayer_rggb", 12), 0.01, id="bayer_rggb of 12 bits"),
    ],
)
def test_corners_are_those_of_the_grey_frame(
    tmp_path: Path, plain: Correspondences, camera: Camera, rms_px: float
) -> None:
    off = _off_px(extract(_log(tmp_path / "a.mcap", camera), TARGET, settings=LINEAR), plain)
    assert len(off) > 300
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < rms_px
    assert np.all(np.abs(off.mean(axis=0)) < 0.001)


@pytest.mark.parametrize(
    "camera",
    [
        *(pytest.param(_bayer_srgb(name), id=name) for name in sorted(MOSAICS)),
        pytest.param(_bayer_srgb("bayer_rggb", gain={"r": 0.35, "g": 1.0, "b": 0.45}), id="unbalanced"),
        pytest.param(_bayer_srgb("bayer_rggb", exposure=0.5, gain={"r": 1.4, "g": 1.0, "b": 1.9}), id="overbalanced"),
    ],
)
def test_a_mosaic_that_codes_brightness_has_the_corners_of_the_grey_frame(
    tmp_path: Path, plain_srgb: Correspondences, camera: Camera
) -> None:
    off = _off_px(extract(_log(tmp_path / "a.mcap", camera), TARGET), plain_srgb)
    assert len(off) > 300
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.006
    assert np.all(np.abs(off.mean(axis=0)) < 0.001)


def test_interpolated_colours_would_move_corners(tmp_path: Path, plain: Correspondences) -> None:
    """The test above sees what it should: a mosaic that is interpolated does not pass it."""

    def take(angle_deg: float, grey: NDArray[np.uint8]) -> Bytes:
        mosaic = _bayer("bayer_rggb")(angle_deg, grey)[2]
        return _rows("mono8", cv2.cvtColor(mosaic, cv2.COLOR_BayerBG2GRAY))

    found = extract(_log(tmp_path / "a.mcap", take), TARGET, settings=LINEAR)
    off = []
    for stop, same in zip(found.stops, plain.stops, strict=True):
        _, i, j = np.intersect1d(stop.landmark_ids, same.landmark_ids, return_indices=True)
        off.append(stop.uv_px[i] - same.uv_px[j])
    assert np.sqrt(np.mean(np.sum(np.concatenate(off) ** 2, axis=1))) > 0.02


def test_a_png_of_twelve_bits_is_used_as_such(tmp_path: Path, plain: Correspondences) -> None:
    def write(log: LogWriter) -> None:
        for j, angle in enumerate(ANGLES):
            t = T0_NS + round((2.0 * j + 0.5) * 1e9)
            image = np.rint(view(angle, srgb=False) * (4095 / 255)).astype(np.uint16)
            log.compressed_image(COMPRESSED, t, t, cv2.imencode(".png", image)[1].tobytes(), format="mono16; png")

    path = write_log(tmp_path / "a.mcap", write_joints, write)
    assert open_recording(path).used_bits(range(3)) == 12
    off = _off_px(extract(path, TARGET, settings=LINEAR), plain)
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.002


@pytest.mark.parametrize(
    ("camera", "bits"), [(_deep(16), 16), (_deep(14), 14), (_deep(12), 12), (_deep(10), 10), (_yuv("yuv422", 1), 8)]
)
def test_bits_are_told_and_pictures_to_look_at_have_eight(tmp_path: Path, camera: Camera, bits: int) -> None:
    recording = open_recording(_log(tmp_path / "a.mcap", camera))
    assert recording.used_bits(range(3)) == bits
    for (_, picture), angle in zip(recording.read_frames(range(3)), ANGLES, strict=True):
        assert picture.dtype == np.uint8
        np.testing.assert_allclose(picture.astype(int), view(angle, srgb=False), atol=1)


def test_the_curve_of_a_deep_camera_is_told_by_itself(tmp_path: Path, plain: Correspondences) -> None:
    off = _off_px(extract(_log(tmp_path / "a.mcap", _deep(12, 0.5)), TARGET), plain)
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.002


def test_bits_can_be_given_but_not_fewer_than_there_are(tmp_path: Path, plain: Correspondences) -> None:
    path = _log(tmp_path / "a.mcap", _deep(12, 0.2))
    off = _off_px(extract(path, TARGET, settings=ExtractSettings(response="linear", bits=12)), plain)
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.003
    bright = _log(tmp_path / "b.mcap", _deep(12))
    with pytest.raises(DetectError, match=r"b.mcap: images in /camera/image_raw have values of 12 bits, 10 or fewer"):
        extract(bright, TARGET, settings=ExtractSettings(bits=10))
    with pytest.raises(DetectError, match=r"bits is 11, one of 8, 10, 12, 14, 16 is needed"):
        ExtractSettings(bits=11)


def test_a_log_of_a_wrong_step_names_image_and_camera(tmp_path: Path) -> None:
    path = _log(tmp_path / "a.mcap", lambda _, g: ("mono16", SIZE[0], g))
    with pytest.raises(DetectError, match=r"none of the 3 images looked at in /camera/image_raw .* rows of 480 .* 960"):
        extract(path, TARGET)
