"""Logs calibrated as they arrive: once they have stopped changing, again if they change, whatever else lies there."""

import json
from argparse import Namespace
from collections.abc import Generator
from pathlib import Path
from typing import Never

import numpy as np
import pytest

from boxcal.calib.cli import main
from boxcal.calib.errors import CalibError
from boxcal.calib.fleet import watch, watching
from boxcal.calib.fleet.engine import chosen
from boxcal.calib.fleet.engine.calls import Engine
from boxcal.calib.fleet.engine.here import ThisProcess
from boxcal.calib.fleet.watch import Arrivals, check_places, logs_in, robots_of_their_own
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.box import make_target

PAPER = ("--lens", "radial", "--floor", "rigid", "--scale-prior-percent", "0", "--face-prior-mm", "0")


def test_a_log_is_given_once_it_has_stopped_changing_and_again_if_it_changes() -> None:
    a, b = Path("a.mcap"), Path("b.mcap")
    looks = iter([{}, {a: 1}, {a: 2, b: 1}, {a: 2, b: 1}, {a: 2, b: 1}, {}, {a: 2, b: 5}, {a: 2, b: 5}, {a: 2, b: 5}])
    arrivals = Arrivals(lambda: next(looks))
    given = [arrivals.next() for _ in range(9)]
    assert given == [[], [], [], [a, b], [], [], [], [b], []]


def test_a_log_that_nothing_came_of_is_given_again_and_the_others_are_not() -> None:
    a, b = Path("a.mcap"), Path("b.mcap")
    arrivals = Arrivals(lambda: {a: 1, b: 1})
    assert [arrivals.next() for _ in range(3)] == [[], [a, b], []]
    arrivals.again([b])
    assert [arrivals.next() for _ in range(2)] == [[b], []]


def test_a_log_that_names_no_robot_or_one_that_is_there_keeps_none_of_the_others(tmp_path: Path) -> None:
    bad = tmp_path / "...npz"
    logs, problems = robots_of_their_own([tmp_path / "r1.mcap", tmp_path / "r1.npz", bad, tmp_path / "r2.mcap"])
    assert logs == [tmp_path / "r1.mcap", tmp_path / "r2.mcap"]
    first, second = map(str, problems)
    assert first == f"{tmp_path / 'r1.npz'}: r1.mcap is called r1 too; rename one of them"
    assert "no name for a robot can be made of it" in second


def test_recordings_and_closed_bags_are_logs_and_nothing_else_is(tmp_path: Path) -> None:
    for name in ("r1.mcap", "r2.npz", "r3.bag", "notes.txt", ".r4.mcap.abc.part", "target.json"):
        (tmp_path / name).write_bytes(b"x")
    for name in ("closed", "open"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "0.mcap").write_bytes(b"x")
    (tmp_path / "closed" / "metadata.yaml").write_bytes(b"x")
    found = logs_in([tmp_path])
    assert sorted(log.name for log in found) == ["closed", "r1.mcap", "r2.npz", "r3.bag"]
    (tmp_path / "closed" / "0.mcap").write_bytes(b"xy")
    changed = logs_in([tmp_path])
    assert {log.name for log in found if found[log] != changed[log]} == {"closed"}
    with pytest.raises(CalibError, match="needs a folder"):
        check_places([tmp_path / "r1.mcap"])


def test_a_bucket_is_watched_by_its_folder_or_a_pattern() -> None:
    fsspec = pytest.importorskip("fsspec", reason="the extra 'remote' is not installed")
    memory = fsspec.filesystem("memory")
    for name in ("r1.mcap", "r2.mcap", "notes.txt"):
        memory.pipe_file(f"/watched/{name}", b"x")
    for place in ("memory://watched", "memory://watched/*.mcap"):
        assert sorted(log.name for log in logs_in([Path(place)])) == ["r1.mcap", "r2.mcap"]
    assert logs_in([Path("memory://watched/*.bag")]) == {}


def test_the_command_calibrates_what_arrives_until_it_is_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    target, robots, out = make_target(), tmp_path / "robots", tmp_path / "out"
    robots.mkdir()
    looks = 0

    def arrives() -> None:
        """Between looks: a robot's log after the first and another after the fourth, Ctrl-C after the eighth."""
        nonlocal looks
        looks += 1
        if looks in {1, 4}:
            rng, robot = np.random.default_rng(looks), turtlebot(f"r{looks}")
            drive = simulate_drive(robot, target, DriveOptions(stops=9), rng)
            exact_correspondences(robot, target, drive, 0.1, rng).save(robots / f"r{looks}.npz")
        if looks == 6:
            (robots / "bad.npz").write_bytes(b"no log")
        if looks == 9:
            raise KeyboardInterrupt

    monkeypatch.setattr(watching, "wait", arrives)
    words = [str(robots), "--watch", "--out", str(out), "--no-report", "--jobs", "1", "--quiet", *PAPER]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert said.startswith("fleet-calibrate: watching; Ctrl-C ends it")
    assert said.endswith("fleet-calibrate: no longer watching\n")
    assert set(json.loads((out / "fleet.json").read_text())["robots"]) == {"r1", "r4"}
    assert "bad.npz" in json.loads((out / "fleet.json").read_text())["failed"]["bad"]
    assert main([str(robots / "r1.npz"), "--watch"]) == 2
    assert watch.EVERY_S >= 1


def test_a_batch_that_met_a_dead_cluster_is_done_when_it_is_back_and_the_fault_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    target, robots, out = make_target(), tmp_path / "robots", tmp_path / "out"
    robots.mkdir()
    rng, robot = np.random.default_rng(1), turtlebot("r1")
    drive = simulate_drive(robot, target, DriveOptions(stops=9), rng)
    exact_correspondences(robot, target, drive, 0.1, rng).save(robots / "r1.npz")
    for name in ("x.bag", "x.mcap"):
        (robots / name).write_bytes(b"one name")
    tries: list[object] = []
    good = chosen.chosen_engine

    class Gone(ThisProcess):
        def run(self, *_: object) -> Generator[Never, None, None]:
            raise CalibError("the cluster's scheduler is gone")
            yield

    def engine(args: Namespace, count: int) -> tuple[Engine, list[str]]:
        tries.append(count)
        if len(tries) < 4:
            raise CalibError("no scheduler answers there")
        return (Gone(), []) if len(tries) == 4 else good(args, count)

    def ended() -> None:
        if (out / "r1" / "calibration.json").exists() or len(tries) > 9:
            raise KeyboardInterrupt

    monkeypatch.setattr(chosen, "chosen_engine", engine)
    monkeypatch.setattr(watching, "wait", ended)
    words = [str(robots), "--watch", "--out", str(out), "--no-report", "--jobs", "1", "--quiet", *PAPER]
    assert main(words) == 0
    assert len(tries) == 5
    said = capsys.readouterr().err
    assert said.count("no scheduler answers there") == 1
    assert said.count("scheduler is gone") == 1
    assert said.count("x.bag is called x too") == 1
