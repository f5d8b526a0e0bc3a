"""The command on a log of two cameras: folders, what is left out, and what an earlier run left."""

import json
from pathlib import Path

import numpy as np
import pytest

import boxcal
from boxcal.calib.cli import main as fleet_calibrate
from boxcal.calib.geometry.camera_pair import between
from boxcal.calib.simulate.cli import main as simulate_fleet


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


def test_two_transports_of_one_camera_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    topics = ["--camera-topic", "/front/image_raw", "--camera-topic", "/front/image_raw/compressed"]
    assert fleet_calibrate([str(folder / "r01.mcap"), "--out", str(folder / "none"), *topics]) == 1
    assert "show one camera" in capsys.readouterr().err
