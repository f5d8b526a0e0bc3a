"""Tables, page, history and comparison of robots with several cameras know every camera."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from scipy.spatial.transform import Rotation

from boxcal.calib.compare.cli import main as compare_calibrations
from boxcal.calib.compare.ground_truth import compare, load_truth, with_truth
from boxcal.calib.fleet.store import Member
from boxcal.calib.fleet.write import write_fleet
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.history.session import sessions_of
from boxcal.calib.report.fleet_cameras import camera_table, pair_table
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.each_camera import each_camera
from boxcal.calib.results.json_format import calibration_bytes, load_calibration
from boxcal.calib.results.without_drive import without_drive
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from tests.exports.made_up import calibration, camera, with_cameras

BEHIND = rigid(np.diag([-1.0, -1.0, 1.0]), np.array([-0.2, 0.0, 0.0]))


def robot(name: str = "r01", moved: Array | None = None, log: str = "a") -> Calibration:
    """A robot with a camera that looks back, which may be moved."""
    T = BEHIND @ calibration().T_body_cam
    made = with_cameras(rear=(T if moved is None else T @ moved, replace(camera(), fu=700.0)))
    inputs = {f"{log}.mcap": log * 64}
    return replace(made, robot=name, provenance=replace(made.provenance, inputs=inputs))


def test_each_camera_is_a_result_of_its_own_that_files_and_memory_keep(tmp_path: Path) -> None:
    made = robot()
    path = tmp_path / "calibration.json"
    path.write_bytes(calibration_bytes(made))
    for kept in (made, load_calibration(path), without_drive(made)):
        first, rear = each_camera(kept)
        assert (first.robot, rear.robot) == ("r01", "r01/rear")
        assert rear.camera.fu == 700.0
        assert np.allclose(rear.T_body_cam, BEHIND @ made.T_body_cam)
        assert first.detail is not None
        assert rear.detail is not None
        assert np.allclose(rear.detail.covariance.matrix, first.detail.covariance.matrix, rtol=1e-12)
    rear_file = replace(made, T_body_cam=rear.T_body_cam, camera=rear.camera)
    assert each_camera(rear_file) == (rear_file,)


def test_tables_of_a_fleet_have_a_line_for_each_camera_and_each_pair(tmp_path: Path) -> None:
    members = [Member(robot=name, calibration=robot(name)) for name in ("r01", "=2+2")]
    members.append(Member(robot="r03", calibration=calibration(robot="r03")))
    write_fleet(tmp_path, members, make_target(), command="", report=True, reported=())
    robots, cameras, pairs = (
        list(csv.DictReader(io.StringIO((tmp_path / f"{name}.csv").read_text(encoding="utf-8"))))
        for name in ("fleet", "fleet-cameras", "fleet-camera-pairs")
    )
    assert [(r["robot"], r["cameras"]) for r in robots] == [("r01", "left rear"), ("'=2+2", "left rear"), ("r03", "")]
    assert [(c["robot"], c["camera"], c["fu_px"]) for c in cameras[:2]] == [
        ("r01", "left", "600.25"),
        ("r01", "rear", "700.0"),
    ]
    assert cameras[2]["robot"] == "'=2+2"
    pair = robot().rig.pair("left", "rear")  # type: ignore[union-attr]
    for line in pairs:
        q = [float(line[k]) for k in ("qx", "qy", "qz", "qw")]
        assert np.allclose(Rotation.from_quat(q).as_matrix(), pair.T_a_b[:3, :3], atol=1e-12)
        assert np.allclose([float(line[k]) for k in ("x_m", "y_m", "z_m")], pair.T_a_b[:3, 3], atol=1e-12)
        assert float(line["angle_rad"]) == pytest.approx(np.pi)
        assert float(line["sigma_tx_m"]) == pytest.approx(pair.sigma["tx"])
    book = openpyxl.load_workbook(tmp_path / "fleet.xlsx")
    assert book.sheetnames == ["fleet", "cameras", "camera pairs", "columns"]
    assert [row[1].value for row in book["cameras"].iter_rows(min_row=2)] == ["left", "rear"] * 2
    legend = {row[0].value for row in book["columns"].iter_rows(min_row=2)}
    assert legend >= {cell.value for sheet in book.worksheets[:3] for cell in sheet[1]}
    page = (tmp_path / "fleet.html").read_text(encoding="utf-8")
    assert 'id="camera-table"' in page
    assert 'id="pair-table"' in page

    write_fleet(tmp_path, members[2:], make_target(), command="", report=True, reported=())
    assert not list(tmp_path.glob("fleet-camera*"))
    assert openpyxl.load_workbook(tmp_path / "fleet.xlsx").sheetnames == ["fleet", "columns"]
    assert "camera-table" not in (tmp_path / "fleet.html").read_text(encoding="utf-8")


def test_a_further_camera_that_sits_otherwise_than_on_the_other_robots_is_an_outlier() -> None:
    turned = rigid(exp_so3(np.array([0.0, 0.05, 0.0])), np.array([0.03, 0.0, 0.0]))
    fleet = [robot(f"r{k}", turned if k == 4 else None) for k in range(8)]
    cameras, pairs = camera_table(fleet), pair_table(fleet)
    assert cameras is not None
    assert pairs is not None
    assert {(o.robot, o.name.partition(",")[0]) for o in cameras.odd} == {("r4", "rear")}
    assert {o.robot for o in pairs.odd} == {"r4"}
    assert [line.link for line in cameras.lines[:2]] == ["./r0/report.html", "./r0/rear/report.html"]


def test_history_keeps_a_session_of_each_camera_and_the_wheels_once() -> None:
    made = robot()
    first, rear = sessions_of(made)
    assert (first.robot, rear.robot, rear.verdict) == ("r01", "r01/rear", "good")
    assert rear.counts
    assert np.all(np.isinf(np.diag(rear.covariance)[5:8]))
    assert np.all(np.isfinite(np.diag(first.covariance)))
    assert np.array_equal(rear.covariance[8:, 8:], first.covariance[8:, 8:])
    _, view = each_camera(made)
    (alone,) = sessions_of(replace(view, rig=made.rig))  # as its own file has it
    assert np.array_equal(alone.covariance, rear.covariance)
    assert alone.key == rear.key


def test_a_moved_further_camera_is_a_difference_beyond_chance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shifted = rigid(np.eye(3), np.array([0.005, 0.0, 0.0]))
    made = {"a": robot(), "same": robot(log="b"), "moved": robot(moved=shifted, log="b")}
    for name, one in made.items():
        (tmp_path / name).write_bytes(calibration_bytes(one))
    paths = {name: str(tmp_path / name) for name in made}
    assert compare_calibrations([paths["a"], paths["same"]]) == 0
    assert "over all 3 tests, of cameras and pairs" in capsys.readouterr().out
    assert compare_calibrations([paths["a"], paths["moved"]]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "camera rear against left: moved by 5.00 mm" in said
    assert "camera rear: a point" in said


def test_truth_is_that_of_the_camera_of_the_same_topic(tmp_path: Path) -> None:
    made = robot()
    every = each_camera(made)
    fields = ("fu", "fv", "cu", "cv", "kr")
    cameras = [
        {name: getattr(c.camera, name) for name in fields}
        | {"topic": f"{c.topic}/compressed", "T_vehicle_camera": c.T_body_cam.tolist()}
        for c in made.rig.cameras  # type: ignore[union-attr]
    ]
    first = {"camera": cameras[1], "T_vehicle_camera": cameras[1]["T_vehicle_camera"]}
    first["camera_topic"] = cameras[1]["topic"]
    wheels = {"rR": made.wheels.rR, "rL": made.wheels.rL, "b": made.wheels.b}
    path = tmp_path / "truth.json"
    path.write_text(json.dumps({**first, **wheels, "cameras": [cameras[0]]}), encoding="utf-8")
    found = with_truth(made, load_truth(path))
    assert [c.robot for c, _ in found] == [c.robot for c in every]
    assert all(compare(c, truth).fu == 0 and compare(c, truth).rotation == 0 for c, truth in found)
