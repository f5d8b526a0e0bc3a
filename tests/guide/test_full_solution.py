"""The full calibration beside the drive: its verdict, and a solver that fails, ends or takes too long."""

import subprocess
import sys
import tempfile
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import pytest
from drives import TARGET, seen
from live_messages import until

from boxcal.calib.errors import CalibError
from boxcal.calib.guide.estimate import full_solution
from boxcal.calib.guide.estimate.full_solution import Copy, FullSolution
from boxcal.calib.guide.estimate.solver import Solver
from boxcal.calib.settings import Job
from boxcal.detect.correspondences import Correspondences

DRIVE = seen(4)


class _Scripted(Solver):
    """A solver whose answers are given by the test."""

    def __init__(self) -> None:
        super().__init__("r01", TARGET)
        self.answer: Future[dict[str, Any]] = Future()
        self.ended = 0
        self.asked: list[tuple[Job, Correspondences, bool]] = []

    def _submit(self, job: Job, drive: Correspondences, *, recorded: bool = False) -> "Future[dict[str, Any]]":
        self.asked.append((job, drive, recorded))
        self.answer = Future()
        return self.answer

    def give_up(self) -> None:
        self.ended += 1


def test_a_verdict_that_was_good_is_gone_when_the_same_stops_measured_anew_fail() -> None:
    solver = _Scripted()
    full = FullSolution(solver)
    full.judge(DRIVE)
    solver.answer.set_result({"level": "good"})
    assert not full.collect()
    assert full.verdict == {"level": "good", "stops": 4}
    full.judge(DRIVE)
    solver.answer.set_exception(CalibError("no wheels fit"))
    full.collect()
    assert full.failed == "no wheels fit"
    assert not full.verdict
    assert full.idle


def test_a_solver_that_takes_too_long_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(full_solution, "LONGEST_S", -1.0)
    solver = _Scripted()
    full = FullSolution(solver)
    full.judge(DRIVE)
    full.collect()
    assert solver.ended == 1
    assert "4 stops were not solved" in full.failed
    assert full.idle


def test_what_is_written_ends_what_is_judged_and_is_told_once(tmp_path: Path) -> None:
    solver = _Scripted()
    full = FullSolution(solver)
    full.judge(DRIVE)
    full.write(DRIVE, tmp_path, Path("r01.mcap"), "guide", "the disk is full")
    assert solver.ended == 1
    assert full.is_writing
    solver.answer.set_result({"level": "usable"})
    assert full.collect()
    assert full.written == {"level": "usable", "stops": 4}
    assert not full.collect()


def test_results_that_are_not_made_from_the_recording_say_so_and_why(tmp_path: Path) -> None:
    solver = _Scripted()
    full = FullSolution(solver)
    folder = tempfile.TemporaryDirectory(dir=tmp_path)
    full.write(DRIVE, tmp_path, Path("r01.mcap"), "guide", Copy(Path(folder.name) / "r01.mcap", folder))
    job, drive, recorded = solver.asked[-1]
    assert (job.logs[0].parent, recorded, drive) == (Path(folder.name), True, DRIVE)
    full.write(DRIVE, tmp_path, Path("r01.mcap"), "guide", "the disk is full")
    assert not Path(folder.name).exists(), "the copy that is not read any more is gone"
    job, drive, recorded = solver.asked[-1]
    assert (job.logs, recorded) == ((Path("r01.mcap"),), False)
    assert drive.source.notes[-1].endswith("not from the recording: the disk is full")
    assert drive.stops == DRIVE.stops


_KILLED = """
import multiprocessing, os, signal
from boxcal.calib.guide.estimate.solver import Solver
from boxcal.target.box import make_target
if __name__ == "__main__":
    solver = Solver("r01", make_target())
    solver.get_ready()
    solver._pool.submit(os.getpid).result(60)
    print(*[p.pid for p in multiprocessing.active_children()], flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_guide_that_is_killed_leaves_no_process_behind(tmp_path: Path) -> None:
    script = tmp_path / "killed.py"
    script.write_text(_KILLED)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False, timeout=120)
    (pid,) = map(int, done.stdout.split())

    def gone() -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
        except FileNotFoundError:
            return True

    until(gone, 20)


def test_a_process_that_was_ended_from_outside_is_started_again() -> None:
    solver = Solver("r01", TARGET)
    try:
        ended = solver.judge(seen(2))
        until(lambda: solver._pool is not None and solver._pool._processes, 20)
        for process in list(solver._pool._processes.values()):  # type: ignore[union-attr]
            process.kill()
        with pytest.raises(BrokenProcessPool):
            ended.result(60)
        with pytest.raises(CalibError):
            solver.judge(seen(2)).result(120)
    finally:
        solver.give_up()
