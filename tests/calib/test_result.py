"""calibration.json keeps everything, and is read back with suspicion."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from boxcal.calib.compare.ground_truth import compare, load_truth
from boxcal.calib.errors import CalibError
from boxcal.calib.exports.lens_models import ros_distortion
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood.estimate import Direction, FlaggedCorner, FlaggedLeg, NoiseLevels
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.results.calibration import Calibration, Provenance, Quality, StopResult
from boxcal.calib.results.diagnostics import Covariance, Detail, Ground, HeldOut, Leg
from boxcal.calib.results.json_format import load_calibration, save_calibration
from boxcal.calib.results.provenance import provenance
from boxcal.calib.results.verdict import Level, Reason, Verdict
from boxcal.calib.uncertainty.convergence_point import ConvergencePoint
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.source import Source
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.camera.camera_model import CameraKind, CameraModel

FINDINGS = (
    Finding(
        cause="eccentric-right",
        text="the right wheel is 1.0 % out of round",
        advice="look at it",
        adopted=True,
        stops=(1, 2),
        size=1.0,
        sigma=0.1,
        unit="%",
        p_value=1e-9,
    ),
)


def _result(T_body_cam: Any, detail: Detail | None = None) -> Calibration:
    return Calibration(
        robot="r01",
        image_size=(640, 480),
        camera=CameraModel(fu=561.3, fv=557.8, cu=327.4, cv=231.9, kr=-0.21),
        wheels=Wheels(rR=0.02113, rL=0.02087, b=0.0893),
        T_body_cam=T_body_cam,
        quality=Quality(
            stops=1,
            landmarks=8,
            reprojection_rms_px=0.1,
            heading_rms_rad=1e-3,
            sigma5_sigma4=0.01,
            sigma4_sigma3=0.7,
            up_error_rad=1e-4,
        ),
        stops=(StopResult(t_start_ns=1, t_end_ns=2, landmarks=8, reprojection_rms_px=0.1, T_box_cam=T_body_cam),),
        notes=("a note",),
        provenance=Provenance(
            version="0", command="c", created="now", inputs={"a.mcap": "00"}, settings={"camera_mode": "joint"}
        ),
        method="likelihood" if detail else "four-steps",
        detail=detail,
        findings=FINDINGS,
    )


def _detail() -> Detail:
    matrix = np.diag(np.arange(1.0, 15.0)) ** 2
    matrix[13, :], matrix[:, 13] = np.nan, np.nan
    matrix[13, 13] = np.inf
    return Detail(
        covariance=Covariance(matrix=matrix),
        noise=NoiseLevels(
            pixel_factor=1.1, pixel_factor_sigma=0.01, pixel_px=0.05, slip=3e-4, slip_sigma=5e-5, encoder_step=0.002
        ),
        extra={"tilt_x": 1e-3},
        extra_sigma={"tilt_x": np.inf},
        legs=(
            Leg(
                drive=0, start=0, end=1, t_start_ns=1, t_end_ns=2, rolled=0.5, turned=1.0,
                residual=(0.1, -0.2, 0.3), p_value=0.5, used=True,
            ),
        ),
        flagged_legs=(
            FlaggedLeg(
                drive=0, leg=1, next_stop=2, t_start_ns=3, t_end_ns=4, size_mm=30.0, turn_deg=1.0, p_value=1e-9,
                box_moved_mm=(1.0, 2.0), box_turned_deg=0.1, slip_explains=True, text="words",
            ),
        ),
        flagged_corners=(FlaggedCorner(drive=0, stop=0, landmark_id=17, error_px=(3.0, -4.0)),),
        directions=(
            Direction(parameters=(("tz", 1.0),), sigma=np.inf, what="tz is not determined", advice="add stops"),
        ),
        ground=Ground(
            straight_heading=1e-3, straight_position=0.01, turn_heading=2e-3, distance=2.0,
            projection_mean_px=0.1, projection_worst_px=0.3,
        ),
        held_out=(HeldOut(drive=0, stop=1, error=(1e-3, 2e-3, 3e-3), sigma=(1e-3, 1e-3, 1e-3)),),
        growth=(ConvergencePoint(stops=3, values=tuple(range(14)), sigma=(*range(13), np.inf)),),
    )  # fmt: skip


def test_a_calibration_survives_its_file(exact: Any, tmp_path: Path) -> None:
    result = _result(exact.mounting(3.0, 8.0, 1.0), _detail())
    save_calibration(result, tmp_path / "r01" / "calibration.json")
    document = json.loads((tmp_path / "r01" / "calibration.json").read_text(), parse_constant=pytest.fail)
    assert document["sigma"]["fv"] == 2.0
    assert document["sigma"]["tz"] is None
    assert list(document["sigma"]) == list(ORDER)
    back = load_calibration(tmp_path / "r01" / "calibration.json")
    assert np.array_equal(back.T_body_cam, result.T_body_cam)
    assert np.array_equal(back.stops[0].T_box_cam, result.stops[0].T_box_cam)
    assert back.detail is not None
    assert result.detail is not None
    assert np.array_equal(back.detail.covariance.matrix, result.detail.covariance.matrix, equal_nan=True)
    for name in ("camera", "wheels", "quality", "notes", "provenance", "method", "robot", "image_size", "findings"):
        assert getattr(back, name) == getattr(result, name), name
    for name in Detail.__slots__:
        if name != "covariance":
            assert getattr(back.detail, name) == getattr(result.detail, name), name


def test_the_closed_form_alone_has_no_sigma(exact: Any, tmp_path: Path) -> None:
    save_calibration(_result(exact.mounting(0, 0)), tmp_path / "c.json")
    assert load_calibration(tmp_path / "c.json").detail is None
    assert "sigma" not in json.loads((tmp_path / "c.json").read_text())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: {**d, "schema": 99}, "schema 99, this version reads 1"),
        (lambda d: {k: v for k, v in d.items() if k != "wheels"}, "not a calibration"),
        (lambda d: {**d, "wheels": {"rR": "0.02", "rL": 0.02, "b": 0.1}}, "not a finite number"),
        (lambda d: {**d, "T_body_cam": [[1, 0, 0, 0]] * 4}, "not a rigid motion"),
        (lambda d: {**d, "T_body_cam": np.diag([1.0, 1, -1, 1]).tolist()}, "not a rigid motion"),
        (lambda d: {**d, "wheels": {"rR": 0.0, "rL": 0.02, "b": 0.1}}, "not a positive length"),
        (lambda d: {**d, "T_body_cam": "eye"}, "not a calibration"),
        (lambda d: {**d, "camera": {**d["camera"], "hack": 1.0}}, "not a calibration"),
        (lambda d: [d], "not a calibration"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(exact: Any, tmp_path: Path, change: Any, words: str) -> None:
    path = tmp_path / "c.json"
    save_calibration(_result(exact.mounting(0, 0)), path)
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(CalibError, match=words):
        load_calibration(path)


def test_half_written_and_missing_files_are_refused(exact: Any, tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    save_calibration(_result(exact.mounting(0, 0)), path)
    path.write_text(path.read_text()[:300])
    with pytest.raises(CalibError, match="not a whole JSON file"):
        load_calibration(path)
    with pytest.raises(CalibError, match="cannot be read"):
        load_calibration(tmp_path / "none.json")


def test_a_result_that_cannot_be_saved_leaves_the_old_one(exact: Any, tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    result = _result(exact.mounting(0, 0))
    save_calibration(result, path)
    before = path.read_bytes()
    bad = replace(result, wheels=Wheels(rR=float("nan"), rL=0.02, b=0.1))
    with pytest.raises(ValueError, match="not JSON compliant"):
        save_calibration(bad, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["c.json"]


def test_errors_against_truth_are_relative_for_lengths(exact: Any, tmp_path: Path) -> None:
    T = exact.mounting(3.0, 8.0)
    result = _result(T)
    truth = {
        "camera": {"fu": 561.3 / 1.01, "fv": 557.8, "cu": 327.0, "cv": 231.9, "kr": -0.2},
        "rR": 0.02113 / 1.02, "rL": 0.02087, "b": 0.0893,
        "T_vehicle_camera": exact.mounting(4.0, 8.0, t=(0.031, -0.005, 0.12)).tolist(),
    }  # fmt: skip
    (tmp_path / "t.json").write_text(json.dumps(truth))
    e = compare(result, load_truth(tmp_path / "t.json"))
    assert e.rR == pytest.approx(0.02)
    assert e.fu == pytest.approx(0.01)
    assert e.rL == e.b == e.fv == 0
    assert e.cu == pytest.approx(0.4)
    assert e.kr == pytest.approx(-0.01)
    assert e.rotation == pytest.approx(np.radians(1.0))
    assert (e.tx, e.ty, e.tz) == pytest.approx((-0.001, 0, 0))


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("{}", r"it has no rR"),
        ("no json", "not a whole JSON file"),
        ("[1, 2]", "a part of it is of another kind|not"),
        ('{"rR": 1, "rL": 1, "b": 1}', "it has no camera"),
        ('{"rR": 1, "rL": 1, "b": 1, "camera": 1, "T_vehicle_camera": 1}', "a part of it is of another kind"),
        ('{"rR": 1, "rL": 1, "b": 1, "camera": {"fu": 1}, "T_vehicle_camera": 1}', "it has no fv"),
        ('{"rR": 1, "rL": 1, "b": "x", "camera": {}}', "a part of it is of another kind"),
    ],
)
def test_a_file_that_is_no_truth_is_refused(tmp_path: Path, content: str, why: str) -> None:
    (tmp_path / "t.json").write_text(content)
    with pytest.raises(CalibError, match=why) as refused:
        load_truth(tmp_path / "t.json")
    assert "Error(" not in str(refused.value)
    assert "leave out --truth" in str(refused.value)


@pytest.mark.parametrize(
    ("lens", "further"),
    [
        ("brown", {"k2": 0.09, "p1": 2e-3, "p2": -1.5e-3, "k3": 0.01}),
        ("rational", {"k2": 0.09, "p1": 2e-3, "p2": -1.5e-3, "k3": 0.01, "k4": 0.02, "k5": -0.03, "k6": 0.004}),
        ("fisheye", {"k2": 0.01, "k3": -0.02, "k4": 0.003}),
    ],
)
def test_order_of_keys_in_the_file_does_not_change_the_camera(
    tmp_path: Path, lens: str, further: dict[str, float]
) -> None:
    plain = _result(np.eye(4), _detail())
    result = replace(plain, camera=replace(plain.camera, kind=CameraKind(lens), **further))
    save_calibration(result, tmp_path / "calibration.json")
    document = json.loads((tmp_path / "calibration.json").read_text())
    shuffled = dict(reversed(document["lens"]["coefficients"].items()))
    document["lens"]["coefficients"] = shuffled
    (tmp_path / "shuffled.json").write_text(json.dumps(document))
    (tmp_path / "sorted.json").write_text(json.dumps(document, sort_keys=True))
    points = np.array([[0.4, 0.3, 1.0], [-0.2, 0.1, 0.5]])
    for name in ("shuffled.json", "sorted.json"):
        loaded = load_calibration(tmp_path / name)
        assert loaded.camera.values.tolist() == result.camera.values.tolist()
        assert np.array_equal(loaded.project(points), result.project(points))
        assert ros_distortion(loaded) == ros_distortion(result)


def test_projecting_and_unprojecting_undo_each_other_in_the_body_frame() -> None:
    T = rigid(exp_so3(np.array([1.2, -1.2, 1.0])), np.array([0.1, -0.02, 0.3]))
    result = _result(T)
    uv_px = np.array([[10.0, 20.0], [320.0, 240.0], [600.0, 460.0]])
    rays = result.unproject(uv_px)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1, rtol=1e-12)
    assert np.allclose(result.project(T[:3, 3] + 2.5 * rays), uv_px, atol=1e-8)
    assert np.all(np.isnan(result.project(T[:3, 3] - rays)))


def test_verdict_is_kept_in_the_file(tmp_path: Path) -> None:
    reason = Reason(rule="slip", level=Level.USABLE, text="The wheels slip.", advice="Drive slower.")
    judged = Verdict(level=Level.USABLE, headline="It works.", reasons=(reason,), next_steps=("Drive slower.",))
    save_calibration(replace(_result(np.eye(4)), verdict=judged), tmp_path / "calibration.json")
    assert load_calibration(str(tmp_path / "calibration.json")).verdict == judged


def test_every_log_has_its_hash_whatever_others_are_called() -> None:
    """Drives of two days in files of one name, and a recording called as the landmark table is among the inputs."""
    wheels = WheelSamples(t_ns=np.zeros(0, dtype=np.int64), phi_R=np.zeros(0), phi_L=np.zeros(0))
    drive = Correspondences(robot="r1", image_size=(640, 480), wheels=wheels, stops=())
    logs = ("r1.mcap", "1"), ("r1.mcap", "2"), ("target", "3"), ("r1.mcap", "4")
    drives = [replace(drive, source=Source(log=log, sha256=digest, target_sha256="box")) for log, digest in logs]
    found = provenance("", drives, {})
    assert found.logs == {"r1.mcap": "1", "r1.mcap (2)": "2", "target (2)": "3", "r1.mcap (3)": "4"}
    assert found.target == "box"
