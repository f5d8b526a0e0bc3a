"""Pictures of every kind, video, and pictures that are damaged: all grey images, or none; nothing on the terminal."""

import struct
import zlib
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from small_logs import T0_NS, write_joints, write_log

from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.pictures import grey_of_picture, grey_of_rows, grey_of_zipped_rows, picture_size

SMOOTH = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (48, 64), dtype=np.uint8), (0, 0), 4)


@pytest.mark.parametrize(
    ("ending", "options"),
    [
        (".webp", [cv2.IMWRITE_WEBP_QUALITY, 101]),
        (".webp", [cv2.IMWRITE_WEBP_QUALITY, 90]),
        (".tiff", []),
        (".png", []),
        (".jpg", []),
    ],
)
def test_pictures_of_every_kind_are_sized_by_their_heads_and_decoded(ending: str, options: list[int]) -> None:
    content = cv2.imencode(ending, SMOOTH, options)[1].tobytes()
    assert picture_size(content) == (64, 48)
    np.testing.assert_allclose(grey_of_picture(content).astype(int), SMOOTH, atol=6)


def test_a_tiff_keeps_its_sixteen_bits() -> None:
    deep = SMOOTH.astype(np.uint16) * 200
    np.testing.assert_array_equal(grey_of_picture(cv2.imencode(".tiff", deep)[1].tobytes()), deep)


@pytest.mark.parametrize("encoding", ["nv12", "nv21", "i420"])
def test_of_planar_yuv_the_luma_is_taken(encoding: str) -> None:
    data = np.concatenate([SMOOTH.ravel(), np.full(SMOOTH.size // 2, 128, dtype=np.uint8)])
    np.testing.assert_array_equal(grey_of_rows(48, 64, encoding, 0, 64, data), SMOOTH)


def _zipped(image: NDArray[np.uint8]) -> bytes:
    """As zstd_image_transport packs an image: its fields, then the pixels through zlib with gzip's head."""
    head = struct.pack("<IIBII", *image.shape, 0, image.shape[1], 5) + b"mono8"
    worker = zlib.compressobj(wbits=31)
    return head + worker.compress(image.tobytes()) + worker.flush()


def test_the_transport_zstd_is_unpacked(tmp_path: Path) -> None:
    np.testing.assert_array_equal(grey_of_zipped_rows(_zipped(SMOOTH)), SMOOTH)
    for damaged in (b"", _zipped(SMOOTH)[:30], struct.pack("<IIBII", 1 << 30, 1 << 30, 0, 1, 5) + b"mono8"):
        with pytest.raises(DetectError):
            grey_of_zipped_rows(damaged)

    def packed(log: LogWriter) -> None:
        log.compressed_image("/camera/image_raw/zstd", T0_NS, T0_NS, _zipped(SMOOTH), "zstd")

    recording = open_recording(write_log(tmp_path / "a.mcap", write_joints, packed))
    ((_, image),) = recording.read_frames([0])
    np.testing.assert_array_equal(image, SMOOTH)


def test_a_damaged_jpeg_is_refused_and_libjpeg_says_nothing_on_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    content = cv2.imencode(".jpg", cv2.resize(SMOOTH, (640, 480)))[1].tobytes()
    for damaged in (
        content[: len(content) // 2],
        content[: len(content) // 2] + b"\xff\xd9",
        content[:-400] + bytes(100),
    ):
        with pytest.raises(DetectError):
            grey_of_picture(damaged)
    assert grey_of_picture(content).shape == (480, 640)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_video_is_decoded_to_the_frames_that_are_asked_for(tmp_path: Path, codec: str) -> None:
    av = pytest.importorskip("av")
    pytest.importorskip("foxglove_schemas_protobuf")
    from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo  # noqa: PLC0415
    from google.protobuf.timestamp_pb2 import Timestamp  # noqa: PLC0415
    from mcap_protobuf.writer import Writer  # noqa: PLC0415
    from recorded_kinds import _json_joints, events  # noqa: PLC0415

    try:
        encoder = av.CodecContext.create(codec, "w")
    except (av.error.FFmpegError, ValueError):
        pytest.skip(f"PyAV has no encoder {codec}")
    encoder.width, encoder.height, encoder.pix_fmt = 128, 96, "yuv420p"
    encoder.time_base, encoder.framerate = Fraction(1, 30), 30
    encoder.options = {"tune": "zerolatency", "g": "20", "bf": "0", "preset": "ultrafast", "crf": "10"}
    if codec == "libx265":
        encoder.options = {
            "x265-params": "bframes=0:keyint=20:log-level=none:rc-lookahead=0:frame-threads=1",
            "crf": "10",
        }
    shown = [np.full((96, 128), 40 + 2 * k, dtype=np.uint8) for k in range(70)]
    packets = []
    for k, picture in enumerate(shown):
        frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format="yuv420p")
        frame.pts = k
        packets += [bytes(p) for p in encoder.encode(frame)]
    packets += [bytes(p) for p in encoder.encode(None)]
    path = tmp_path / "a.mcap"
    name = "h264" if codec == "libx264" else "h265"
    with path.open("wb") as file, Writer(file) as writer:
        inner = writer._writer
        schema = inner.register_schema("sensor_msgs/msg/JointState", "jsonschema", b"{}")
        joints = inner.register_channel("/joint_states", "json", schema)
        for event in events():
            if event.angles is not None:
                inner.add_message(joints, event.t_ns, _json_joints(event), event.t_ns)
        for k, packet in enumerate(packets):
            t = T0_NS + k * 100_000_000
            stamp = Timestamp(seconds=t // 10**9, nanos=t % 10**9)
            video = CompressedVideo(timestamp=stamp, frame_id="cam", data=packet, format=name)
            writer.write_message("/camera/video", video, t, t)
    recording = open_recording(path)
    assert recording.frame_t_ns.size == 70
    for wanted in ([0, 7, 33, 34, 60], [50, 10]):
        levels = {t: float(np.mean(image)) for t, image in recording.read_frames(wanted)}
        assert len(levels) == len(wanted)
        for k in wanted:
            assert levels[T0_NS + k * 100_000_000] == pytest.approx(40 + 2 * k, abs=12)
