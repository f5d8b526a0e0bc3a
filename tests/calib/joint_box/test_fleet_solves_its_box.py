"""`fleet-calibrate --joint-box`: a refined box beside the results, every robot with it, another box left out."""

import json
from pathlib import Path

import numpy as np
import pytest
from robots import TARGET, drive_of, hand_made_box, shape_of_box

from boxcal.calib.cli import main
from boxcal.calib.joint_box.sharpness import ruler
from boxcal.calib.results.json_format import load_calibration
from boxcal.target.files.target_json import load_target, target_sha256
from boxcal.target.measure.refined_shape import SHAPE

ROBOTS, ANOTHER = 5, 3
"""Robots of the fleet, and which of them drove around another box."""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("robots")
    paths = []
    for number in range(ROBOTS):
        box = hand_made_box(1 if number == ANOTHER else 0)
        paths.append(folder / f"r{number:02d}.npz")
        drive_of(number, box).seen.save(paths[-1])
    return paths


@pytest.fixture(scope="module")
def results(logs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("calibration")
    options = ["--joint-box", "--no-report", "--quiet", "--jobs", "1", "--out", str(out)]
    assert main([*map(str, logs), *options]) == 0
    return out


def test_the_refined_box_is_that_of_the_robots_that_agree(results: Path) -> None:
    target = load_target(results / "target.json")
    assert target.refined is not None
    assert target.refined.robots == ROBOTS - 1
    assert len(target.refined.drives) == ROBOTS - 1
    names = [name for name in SHAPE if target.refined.sigma(name) > 0]
    at = [SHAPE.index(name) for name in names]
    true = shape_of_box(hand_made_box(0), names)
    cov = target.refined.cov[np.ix_(at, at)]
    d = target.refined.values[at] - true
    assert d @ np.linalg.solve(cov, d) < 62  # chi-square of 31, p = 1e-3
    measure = ruler(target, names)
    assert measure.error(d) < 3 * measure.of(cov).shape
    assert measure.of(cov).shape < 2e-5


def test_every_robot_that_agrees_is_calibrated_with_the_box_of_the_others(results: Path) -> None:
    name = target_sha256(load_target(results / "target.json"))
    for number in range(ROBOTS):
        found = load_calibration(results / f"r{number:02d}" / "calibration.json")
        own = [note for note in found.notes if "the box's shape was taken as 3 robots found it" in note]
        assert bool(own) == (number != ANOTHER)
        assert (found.provenance.inputs["target"] == name) == (number != ANOTHER)
        true = drive_of(number, hand_made_box(0)).robot
        assert found.detail is not None
        z = (found.wheels.b - true.b) / np.sqrt(found.detail.covariance.matrix[7, 7])
        assert abs(z) < 4
    fleet = json.loads((results / "fleet.json").read_text())
    assert fleet["target"] == name
    assert not fleet["stale"]


def test_a_robot_that_helped_is_told_that_its_sigmas_would_count_it_twice(
    logs: list[Path], results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--no-report", "--quiet", "--jobs", "1", "--target", str(results / "target.json")]
    assert main([str(logs[0]), *options, "--out", str(tmp_path)]) == 0
    assert "its sigmas count that twice" in " ".join(capsys.readouterr().out.split())
    drive_of(9, hand_made_box(0)).seen.save(tmp_path / "r09.npz")
    assert main([str(tmp_path / "r09.npz"), *options, "--out", str(tmp_path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the box's shape was taken as 4 robots found it, with its covariance" in said
    assert "twice" not in said


def test_robots_of_two_boxes_without_a_majority_keep_their_own_results(
    logs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--joint-box", "--no-report", "--quiet", "--jobs", "1", "--out", str(tmp_path)]
    assert main([str(logs[0]), str(logs[ANOTHER]), *options]) == 1
    assert "joint box: the robots' boxes differ: no more than 1 of 2 robots agree on one" in capsys.readouterr().out
    assert not (tmp_path / "target.json").exists()
    assert load_calibration(tmp_path / "r00" / "calibration.json").provenance.inputs["target"] == target_sha256(TARGET)


@pytest.mark.parametrize("more", [[], ["more.npz", "--closed-form"]])
def test_one_robot_or_the_closed_form_has_no_joint_box(
    logs: list[Path], more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(logs[0]), *more, "--joint-box", "--out", str(tmp_path)]) == 2
    assert "--joint-box needs several robots that are solved for by maximum likelihood" in capsys.readouterr().err
