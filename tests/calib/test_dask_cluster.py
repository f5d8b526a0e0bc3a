"""A fleet on a real Dask cluster, of which one worker is killed and one frozen, gives what this machine gives."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from boxcal.calib.cli import main
from boxcal.calib.errors import CalibError
from boxcal.calib.fleet import batch
from boxcal.calib.fleet.attempt import attempt_elsewhere
from boxcal.calib.fleet.batch import calibrate_fleet
from boxcal.calib.fleet.engine import connect as connecting
from boxcal.calib.fleet.engine import versions as compared
from boxcal.calib.fleet.engine.compared_workers import ComparedWorkers
from boxcal.calib.fleet.engine.connect import connect
from boxcal.calib.fleet.engine.versions import OURS, differences, versions
from boxcal.calib.settings import Job, Outcome, Settings, Stage
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.box import make_target

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
ROBOTS = 7


@dataclass(frozen=True)
class Cluster:
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler and three worker processes of their own, as a cluster's administrator starts them."""
    folder = tmp_path_factory.mktemp("cluster")
    place = folder / "scheduler.json"
    start = [sys.executable, "-P", "-m", "distributed.cli.dask_scheduler", "--scheduler-file", str(place)]
    start += ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    join = [sys.executable, "-P", "-m", "distributed.cli.dask_worker", "--scheduler-file", str(place)]
    join += ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder)]
    environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE": "false"}
    with ExitStack() as ended:
        processes = []
        for words in (start, join, join, join):
            process = subprocess.Popen(words, cwd=folder, env=environment, stderr=subprocess.DEVNULL)
            ended.callback(process.wait)
            ended.callback(process.kill)
            processes.append(process)
            _wait_for(place.exists, process)
        address = json.loads(place.read_text())["address"]
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(3, timeout=60)
        yield Cluster(address=address, scheduler=processes[0], workers=processes[1:])


def _wait_for(ready: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 30
    while not ready():
        if process.poll() is not None or time.monotonic() > deadline:
            pytest.skip("a Dask scheduler cannot be started here")
        time.sleep(0.05)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder, target = tmp_path_factory.mktemp("robots"), make_target()
    paths = []
    for k in range(ROBOTS):
        rng, robot = np.random.default_rng(k), turtlebot(f"r{k}")
        drive = exact_correspondences(
            robot, target, simulate_drive(robot, target, DriveOptions(stops=9), rng), 0.1, rng
        )
        drive.save(folder / f"r{k}.npz")
        paths.append(folder / f"r{k}.npz")
    return paths


def _results(out: Path) -> dict[str, object]:
    """What the robots' files say, without when they were written."""
    found = {}
    for path in sorted(out.glob("*/calibration.json")):
        document = json.loads(path.read_text())
        del document["provenance"]["created"]
        found[path.parent.name] = document
    return found


def _jobs(logs: list[Path], out: Path) -> list[Job]:
    settings = Settings(report=False)
    return [
        Job(robot=log.stem, logs=(log,), target=make_target(), settings=settings, out=out, command="") for log in logs
    ]


def _versions_are_compared(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(compared, "installed_version", lambda: "0.0.9")
        with pytest.raises(CalibError, match=r"no worker can be used: worker tcp.*has boxcal .* there, 0\.0\.9 here"):
            connect(cluster.address, limit_s=60)
        patched.undo()
        patched.setattr(compared, "code_sha256", lambda: "0" * 64)
        with pytest.raises(CalibError, match=r"no worker can be used: worker tcp.*has boxcal's code .* there, 0{12} h"):
            connect(cluster.address, limit_s=60)
        patched.undo()
        patched.setattr(compared, "_of", lambda _: "1.0")
        engine, remarks = connect(cluster.address, limit_s=60)
        engine.__exit__()
        assert len(remarks) == 5  # the cluster, and each of four packages once for all its workers
        assert "1.0 here" in remarks[1]


def test_a_killed_and_a_frozen_worker_change_nothing(
    cluster: Cluster,
    logs: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _versions_are_compared(cluster, monkeypatch)
    words = [str(logs[0]), "--no-report", "--out", str(tmp_path / "command"), "--cluster", cluster.address]
    assert main(words) == 0
    assert f"cluster {cluster.address}: 3 workers" in capsys.readouterr().err
    assert (tmp_path / "command" / "r0" / "correspondences.npz").exists()
    here = list(calibrate_fleet(_jobs(logs, tmp_path / "here"), workers=1))
    engine, remarks = connect(cluster.address, limit_s=60, silent_s=8)
    assert remarks == [f"cluster {cluster.address}: 3 workers"]
    with engine:
        there = []
        stages: list[Stage] = []
        for outcome in calibrate_fleet(_jobs(logs, tmp_path / "there"), engine=engine, progress=stages.append):
            there.append(outcome)
            if len(there) == 3:
                cluster.workers[0].kill()
                cluster.workers[1].send_signal(signal.SIGSTOP)
        assert engine.workers == 1
    cluster.workers[1].kill()
    assert len({stage.robot for stage in stages} & {log.stem for log in logs}) > ROBOTS // 2
    assert [o.error for o in (*here, *there)] == 2 * ROBOTS * [None]
    assert sorted(o.job.robot for o in there) == sorted(log.stem for log in logs)
    assert _results(tmp_path / "there") == _results(tmp_path / "here")
    for robot in (log.stem for log in logs):
        names = {p.name: p for p in (tmp_path / "here" / robot).iterdir()}
        others = {p.name: p for p in (tmp_path / "there" / robot).iterdir()}
        assert set(names) == set(others)
        assert {n for n in names if names[n].stat().st_mode != others[n].stat().st_mode} == set()


@pytest.mark.parametrize(
    ("scheduler", "said"),
    [
        ("tcp://127.0.0.1:1", "127.0.0.1:1: no scheduler answers there"),
        ("tcp://me:secret@127.0.0.1:1", "127.0.0.1:1: no scheduler answers there"),
        ("no address", "no address: no scheduler answers there"),
        ("absent.json", "absent.json: no scheduler answers there"),
        ("configured", "Dask's configuration names no scheduler"),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_line(  # noqa: PLR0917 - fixtures
    scheduler: str,
    said: str,
    logs: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(connecting, "_ANSWER_S", 1.0)
    words = [str(logs[0]), "--no-report", "--out", str(tmp_path / "out"), "--cluster", scheduler, "--quiet"]
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert "secret" not in line


def test_a_log_that_a_worker_does_not_see_is_said(tmp_path: Path) -> None:
    (job,) = _jobs([tmp_path / "r1.mcap"], tmp_path / "out")
    found = attempt_elsewhere(job)
    assert found.calibration is None
    assert "r1.mcap: cannot be seen by the cluster's worker on" in str(found.error)
    assert "give its URL" in str(found.error)


def test_versions_name_what_results_depend_on() -> None:
    mine = versions()
    assert set(mine) == {"boxcal", "boxcal's code", "python", "numpy", "scipy", "numba", "opencv"}
    assert list(differences(mine, mine)) == []
    assert list(differences({"numpy": "2.4"}, {"numpy": "2.3"})) == ["numpy 2.3 there, 2.4 here"]


class _Client:
    """A client of a cluster whose workers say the versions that they are given."""

    def __init__(self, said: dict[str, dict[str, str]]) -> None:
        self.said = said

    def submit(self, _function: object, *, workers: list[str], **_: object) -> SimpleNamespace:
        return SimpleNamespace(done=lambda: True, status="finished", result=lambda: self.said[workers[0]])

    def cancel(self, *_: object, **__: object) -> None:
        pass


def test_a_worker_that_joins_later_is_used_only_if_its_program_is_the_same() -> None:
    mine = versions()
    same, other = dict(mine), {**mine, "boxcal's code": "0" * 12}
    compared_workers = ComparedWorkers(_Client({"a": same, "b": same, "c": other}))
    assert compared_workers.wait(["a"]) == []
    assert compared_workers.look(["a", "b", "c"]) == [
        f"worker c has boxcal's code {'0' * 12} there, {mine[OURS[1]]} here; left out"
    ]
    assert compared_workers.usable == {"a", "b"}
    assert compared_workers.look(["a", "b", "c"]) == []


def test_a_scheduler_that_is_lost_on_the_way_is_one_line_and_what_is_finished_is_kept(
    cluster: Cluster,
    logs: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The last test here: it ends the cluster."""
    finished: list[Path] = []

    def end_scheduler(job: Job, *arguments: Any) -> Outcome:
        finished.append(job.logs[0])
        cluster.scheduler.kill()
        return outcome_of(job, *arguments)

    outcome_of = batch._outcome
    monkeypatch.setattr(batch, "_outcome", end_scheduler)
    robots = 4
    words = [*map(str, logs[:robots]), "--no-report", "--quiet", "--jobs", "1", "--out", str(tmp_path)]
    begun = time.monotonic()
    assert main([*words, "--cluster", cluster.address]) == 1
    assert time.monotonic() - begun < 60
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith("fleet-calibrate: the cluster's scheduler is gone; what is finished is kept")
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["counts"]["done"] == len(finished)
    assert record["counts"]["not reached"] == robots - len(finished)
    monkeypatch.undo()
    assert main(words) == 0
    assert json.loads((tmp_path / "run.json").read_text())["counts"] == {
        "done": robots - len(finished),
        "kept": len(finished),
        "failed": 0,
        "not reached": 0,
    }
