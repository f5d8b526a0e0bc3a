"""The command on a log of two cameras: folders, what is left out, and what an earlier run left."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

import boxcal
from boxcal.calib.cli import main as fleet_calibrate
from boxcal.calib.geometry.camera_pair import between
from boxcal.calib.simulate.cli import main as simulate_fleet
from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.target.render.renderer import encode_jpeg


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("cameras")
    options = ["--robots", "1", "--stops", "5", "--frames", "1", "--moving-frames", "0", "--seed", "3"]
    assert simulate_fleet([str(where), *options, "--cameras", "2", "--rig", "stereo", "--jobs", "1"]) == 0
    return where


def test_all_cameras_of_a_log_are_calibrated_together_and_written(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "out"
    command = [str(folder / "r01.mcap"), "--out", str(out), "--no-report", "--jobs", "1"]
    assert fleet_calibrate([*command, "--all-cameras"]) == 0
    assert "2 cameras (front, stereo) were calibrated together" in " ".join(capsys.readouterr().out.split())
    found, other = (boxcal.load_calibration(out / name / "calibration.json") for name in ("r01", "r01/stereo"))
    truth = json.loads((folder / "r01.truth.json").read_text(encoding="utf-8"))
    true = between(*(np.array(t["T_vehicle_camera"]) for t in (truth, truth["cameras"][0])))
    assert found.rig is not None
    pair = found.rig.pair("front", "stereo")
    sigma = np.array([pair.sigma[n] for n in ("tx", "ty", "tz")])
    assert np.all(np.abs(pair.T_a_b[:3, 3] - true[:3, 3]) < 5 * sigma)
    assert np.array_equal(other.T_body_cam, found.rig.cameras[1].T_body_cam)
    names = {path.relative_to(out / "r01").as_posix() for path in (out / "r01").rglob("*") if path.is_file()}
    assert {"stereo_front_stereo/left.yaml", "opencv_stereo_front_stereo.yaml", "stereo/camera_info.yaml"} <= names

    assert fleet_calibrate([*command, "--all-cameras"]) == 0
    assert "1 of 1 robots are unchanged and kept" in capsys.readouterr().err

    again = [str(out / "r01" / "correspondences.npz"), "--out", str(folder / "again"), "--no-report", "--all-cameras"]
    assert fleet_calibrate(again) == 0
    saved = boxcal.load_calibration(folder / "again" / "r01" / "calibration.json")
    assert saved.rig is not None
    assert np.allclose(saved.rig.pair("front", "stereo").T_a_b, pair.T_a_b, atol=1e-9)

    assert fleet_calibrate([*command, "--camera-topic", "/front/image_raw"]) == 0
    assert boxcal.load_calibration(out / "r01" / "calibration.json").rig is None
    left = {path.relative_to(out / "r01").as_posix() for path in (out / "r01").rglob("*") if path.is_file()}
    assert not [name for name in left if "stereo" in name]


@pytest.mark.parametrize("option", [["--closed-form"], ["--moving", "on"], ["--camera-frame", "optical"]])
def test_options_for_one_camera_are_refused_with_several(
    option: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(folder / "r01.mcap")
    assert (
        fleet_calibrate([log, "--out", str(folder / "none"), "--camera-topic", "a", "--camera-topic", "b", *option])
        == 2
    )
    assert f"{' '.join(option)[:12]}" in capsys.readouterr().err


DEPTH, DARK, RECTIFIED = "/front/depth/image_raw", "/front/infra1/image_raw/compressed", "/front/corrected/compressed"


@pytest.fixture(scope="module")
def more_streams(folder: Path) -> Path:
    """The first camera's pictures raw and compressed, without distortion, with distances, and an infrared stream."""
    path, types = folder / "streams.mcap", get_typestore(Stores.ROS2_HUMBLE).types
    camera = json.loads((folder / "r01.truth.json").read_text(encoding="utf-8"))["camera"]
    K = np.array([[camera["fu"], 0, camera["cu"]], [0, camera["fv"], camera["cv"]], [0, 0, 1]])
    noise = np.random.default_rng(1).integers(20, 60, (480, 640)).astype(np.uint8)
    with (folder / "r01.mcap").open("rb") as file, LogWriter(path) as log:
        for schema, channel, message in make_reader(file).iter_messages():
            log.raw(channel.topic, schema.name, message.log_time, message.data)
            if channel.topic != "/front/image_raw/compressed":
                continue
            seen: Any = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(message.data, schema.name)
            picture = cv2.imdecode(np.asarray(seen.data), cv2.IMREAD_GRAYSCALE)
            t, stamp = message.log_time, seen.header.stamp.sec * 10**9 + seen.header.stamp.nanosec
            log.image("/front/image_raw", stamp, t, picture)
            flat = cv2.undistort(picture, K, np.array([camera["kr"], 0, 0, 0, 0]))
            log.compressed_image(RECTIFIED, stamp, t, encode_jpeg(flat, 95))
            log.compressed_image(DARK, stamp, t, encode_jpeg(noise, 95))
            distances = np.full((480, 640), 1000, dtype="<u2").view(np.uint8).ravel()
            log.message(
                DEPTH,
                t,
                types["sensor_msgs/msg/Image"](
                    header=seen.header,
                    height=480,
                    width=640,
                    encoding="16UC1",
                    is_bigendian=0,
                    step=1280,
                    data=distances,
                ),
            )
    return path


def test_streams_that_are_no_camera_of_their_own_fall_out_each_with_its_reason(
    more_streams: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = more_streams.parent / "streams"
    assert fleet_calibrate([str(more_streams), "--out", str(out), "--no-report", "--jobs", "1", "--all-cameras"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    for line in (
        "image topic /front/image_raw/compressed is not used: the pictures of /front/image_raw once more",
        f"image topic {RECTIFIED} is not used: it shows the camera of",
        f"image topic {DARK} is not used: no tag of the box",
        f"image topic {DEPTH} is not used: distances, no pictures",
        "2 cameras (front, stereo) were calibrated together",
    ):
        assert line in said


def test_streams_that_were_named_and_are_no_camera_are_said(
    more_streams: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [str(more_streams), "--out", str(more_streams.parent / "named"), "--no-report", "--jobs", "1"]
    assert fleet_calibrate([*command, "--camera-topic", DEPTH]) == 1
    assert f"of {DEPTH}, which by its name holds distances, no pictures; name a camera's topic" in (
        capsys.readouterr().err
    )
    assert fleet_calibrate([*command, "--camera-topic", "/front/image_raw", "--camera-topic", RECTIFIED]) == 1
    said = capsys.readouterr().err
    assert f"streams.mcap: /front/image_raw and {RECTIFIED} show one camera" in said
    assert "streams.mcap: streams.mcap" not in said


def test_two_transports_of_one_camera_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    topics = ["--camera-topic", "/front/image_raw", "--camera-topic", "/front/image_raw/compressed"]
    assert fleet_calibrate([str(folder / "r01.mcap"), "--out", str(folder / "none"), *topics]) == 1
    assert "show one camera" in capsys.readouterr().err
