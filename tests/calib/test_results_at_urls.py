"""Results behind URLs: whole, complete, found again, and one clear line where they cannot be written."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fsspec")
import fsspec  # type: ignore[import-untyped]

from boxcal.calib.cli import main
from boxcal.calib.results.json_format import load_calibration
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.errors import DetectError
from boxcal.detect.log.remote.store import Store
from boxcal.target.box import make_target
from boxcal.target.files.target_json import target_sha256

OPTIONS = ["--no-report", "--jobs", "1", "--quiet", "--closed-form"]


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder, target, robot = tmp_path_factory.mktemp("drives"), make_target(), turtlebot()
    for seed in (1, 2):
        driven = simulate_drive(robot, target, DriveOptions(stops=8), np.random.default_rng(seed))
        drive = exact_correspondences(robot, target, driven)
        source = replace(drive.source, log=f"r0{seed}.mcap", sha256=f"{seed:064x}", target_sha256=target_sha256(target))
        replace(drive, robot=f"r0{seed}", source=source).save(folder / f"r0{seed}.npz")
    return [str(folder / f"r0{seed}.npz") for seed in (1, 2)]


@pytest.fixture(params=["memory", "file"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    url = f"memory://results-{tmp_path.name}/cal" if request.param == "memory" else f"file://{tmp_path}/cal"
    yield url
    client, root = fsspec.core.url_to_fs(url)
    if client.exists(root):
        client.rm(root, recursive=True)


def _files(place: str) -> dict[str, bytes]:
    client, root = fsspec.core.url_to_fs(place)
    return {p.removeprefix(root).lstrip("/"): client.cat_file(p) for p in client.find(root)}


def test_results_behind_a_url_are_those_of_a_folder(drives: list[str], place: str, tmp_path: Path) -> None:
    assert main([*drives, "--out", place, *OPTIONS]) == 0
    assert main([*drives, "--out", str(tmp_path / "local"), *OPTIONS]) == 0
    found, local = _files(place), tmp_path / "local"
    names = {str(p.relative_to(local)) for p in local.rglob("*") if p.is_file()}
    assert set(found) == names
    for robot in ("r01", "r02"):
        (tmp_path / "c.json").write_bytes(found[f"{robot}/calibration.json"])
        here, there = load_calibration(local / robot / "calibration.json"), load_calibration(tmp_path / "c.json")
        assert here.wheels == there.wheels
    assert json.loads(found["fleet.json"])["robots"].keys() == {"r01", "r02"}


def test_pages_link_to_reports_wherever_they_are_and_go_with_a_run_without(
    drives: list[str], place: str, tmp_path: Path
) -> None:
    plain = [word for word in OPTIONS if word != "--no-report"]
    for out in (place, str(tmp_path / "local")):
        assert main([drives[0], "--out", out, *plain]) == 0
        found = _files(out)
        assert b'href="./r01/report.html"' in found["fleet.html"]
        assert {"fleet.xlsx", "r01/report.html"} <= set(found)
        assert main([drives[0], "--out", out, *OPTIONS]) == 0  # what the report says is not of this run
        assert not {"fleet.html", "fleet.xlsx", "r01/report.html"} & set(_files(out))


def test_a_folder_behind_a_url_grows_and_is_resumed(
    drives: list[str], place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([drives[0], "--out", place, *OPTIONS]) == 0
    first = _files(place)["r01/calibration.json"]
    assert main([*drives, "--out", place, "--resume", *OPTIONS]) == 0
    found = _files(place)
    assert found["r01/calibration.json"] == first
    assert json.loads(found["fleet.json"])["robots"].keys() == {"r01", "r02"}
    assert place in capsys.readouterr().out


def test_calibration_json_is_put_when_all_else_of_a_robot_is_there(
    drives: list[str], place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    put = Store.put

    def noting(store: Store, name: str, content: bytes) -> None:
        order.append(name)
        put(store, name, content)

    monkeypatch.setattr(Store, "put", noting)
    assert main([drives[0], "--out", place, *OPTIONS]) == 0
    robots_own = order[: order.index("calibration.json") + 1]
    assert "correspondences.npz" in robots_own
    assert order[-1] == "fleet.json"
    assert not [name for name in _files(place) if "part" in name or ".boxcal" in name]


def test_a_place_that_may_not_be_written_is_one_line_before_the_work(
    drives: list[str], place: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError("geheim")

    client, _ = fsspec.core.url_to_fs(place)
    monkeypatch.setattr(type(client), "pipe_file", denied)
    assert main([drives[0], "--out", place, *OPTIONS]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fleet-calibrate: cal: access is denied; give credentials")
    assert "geheim" not in line


def test_a_place_that_fails_midway_costs_that_robot_and_is_said(
    drives: list[str], place: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    put = Store.put

    def failing(store: Store, name: str, content: bytes) -> None:
        if store.name == "r01":
            raise DetectError("cannot be reached (TimeoutError)", source=f"r01/{name}", remedy="check the network")
        put(store, name, content)

    monkeypatch.setattr(Store, "put", failing)
    assert main([*drives, "--out", place, *OPTIONS]) == 1
    err = capsys.readouterr().err
    assert "cannot be reached (TimeoutError)" in err
    assert "1 of 2 robots failed" in err
    assert "r02/calibration.json" in _files(place)
