"""Runs that go on: what is unchanged is kept, what is not is done again, and the record says which and why."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import boxcal.calib
import boxcal.version
from boxcal.calib import calibrate as one_robot
from boxcal.calib.calibrate import calibrate_robot
from boxcal.calib.cli import main
from boxcal.calib.errors import CalibError
from boxcal.calib.one_robot import log_identity, put_files
from boxcal.calib.one_robot.reading import read
from boxcal.calib.settings import Job, Settings
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.source import Source
from boxcal.target.box import make_target
from boxcal.target.files.atomic_write import write_together

ROOT = Path(__file__).resolve().parents[2]
PAPER = ("--lens", "radial", "--floor", "rigid", "--scale-prior-percent", "0", "--face-prior-mm", "0")
Run = Callable[..., tuple[int, dict[str, tuple[str, str]], str]]


@pytest.fixture(scope="module")
def drive() -> Correspondences:
    rng, target, robot = np.random.default_rng(3), make_target(), turtlebot("r1")
    return exact_correspondences(robot, target, simulate_drive(robot, target, DriveOptions(stops=9), rng), 0.1, rng)


@pytest.fixture
def logs(drive: Correspondences, tmp_path: Path) -> Path:
    folder = tmp_path / "robots"
    for name in ("r1", "r2"):
        replace(drive, source=Source(log=f"{name}.mcap", sha256="ab" * 32, target_sha256="")).save(
            folder / f"{name}.npz"
        )
    (folder / "bad.npz").write_bytes(b"no log")
    return folder


@pytest.fixture
def run(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Calibrate the robots; give status, each robot's state and why, and what was said."""

    def calibrate(*words: object) -> tuple[int, dict[str, tuple[str, str]], str]:
        robots = [str(log) for log in sorted(logs.glob("*.npz"))]
        out = ["--out", str(tmp_path / "out"), "--no-report", "--jobs", "1"]
        status = main([*robots, *out, *PAPER, *map(str, words)])
        record = json.loads((tmp_path / "out" / "run.json").read_text())
        states = {name: (robot["state"], robot["why"]) for name, robot in record["robots"].items()}
        return status, states, capsys.readouterr().err

    return calibrate


def test_what_is_unchanged_is_kept_and_the_record_says_why_the_rest_was_done(
    run: Run, logs: Path, drive: Correspondences, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    status, states, _ = run()
    assert status == 1
    assert states["r1"] == states["r2"] == ("done", "no result yet")
    assert states["bad"][0] == "failed"
    assert "bad.npz" in states["bad"][1]
    written = (tmp_path / "out" / "r1" / "calibration.json").stat().st_mtime_ns

    _, states, said = run()
    kept = ("kept", "log, box, settings and program are unchanged")
    assert states["r1"] == states["r2"] == kept
    assert states["bad"][0] == "failed"
    assert "2 of 3 robots are unchanged and kept (--force does them again)" in said
    assert (tmp_path / "out" / "r1" / "calibration.json").stat().st_mtime_ns == written

    # another file of the same recording, as another version of the detector might give
    replace(drive, stops=drive.stops[:-1], source=Source(log="r2.mcap", sha256="ab" * 32, target_sha256="")).save(
        logs / "r2.npz"
    )
    _, states, _ = run()
    assert states["r1"] == kept
    assert states["r2"] == ("done", "another log, or another version of the program")

    (tmp_path / "out" / "r1" / "camera_info.yaml").unlink()
    (tmp_path / "out" / "r2" / "calibration.json").write_text("{")
    _, states, _ = run()
    assert states["r1"] == ("done", "files are missing in its folder")
    assert states["r2"][1].startswith("cannot be compared: ")

    assert run("--tilt-prior-deg", 2)[1]["r1"] == ("done", "other settings")
    assert run("--tilt-prior-deg", 2, "--force")[1]["r1"] == ("done", "--force")
    monkeypatch.setattr(log_identity, "code_sha256", lambda: "another program")
    assert run("--tilt-prior-deg", 2)[1]["r1"] == ("done", "another log, or another version of the program")
    assert run("--tilt-prior-deg", 2)[1]["r1"] == kept


def test_a_log_that_changes_while_it_is_read_is_one_line(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def and_grows(log: Path, *further: object) -> Correspondences:
        found = read(log, *further)  # type: ignore[arg-type]
        with log.open("ab") as file:
            file.write(b"more")
        return found

    monkeypatch.setattr(one_robot, "read", and_grows)
    log = logs / "r1.npz"
    job = Job(robot="r1", logs=(log,), target=make_target(), settings=Settings(report=False), out=tmp_path / "out")
    with pytest.raises(CalibError, match=r"^r1.npz: changed while it was read; close its recorder and try again$"):
        calibrate_robot(job)
    assert not (tmp_path / "out").exists()


def test_a_clock_that_runs_backwards_loses_nothing(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run()
    monkeypatch.setattr("time.time", lambda: 0.0)
    path = tmp_path / "out" / "r1" / "calibration.json"
    document = json.loads(path.read_text())
    document["provenance"]["created"] = "2099-01-01T00:00:00+00:00"
    path.write_text(json.dumps(document))
    _, states, _ = run()
    assert states["r1"][0] == "kept"
    _, states, _ = run("--force")
    assert states["r1"][0] == "done"
    assert json.loads((tmp_path / "out" / "run.json").read_text())["seconds"] >= 0


def test_the_hash_of_the_program_changes_with_any_of_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = boxcal.version.code_sha256.__wrapped__()
    assert here == boxcal.version.code_sha256()
    (tmp_path / "further.py").write_text("x = 1")
    monkeypatch.setattr(boxcal.calib, "__path__", [*boxcal.calib.__path__, str(tmp_path)])
    assert boxcal.version.code_sha256.__wrapped__() != here


def test_a_full_disk_is_one_line_a_robot_and_the_same_command_goes_on(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run()
    before = (tmp_path / "out" / "r1" / "calibration.json").read_bytes()

    def full(folder: Path, files: object, **further: object) -> None:
        raise OSError(28, "No space left on device", str(folder / ".camera.urdf.part"))

    monkeypatch.setattr(put_files, "write_together", full)
    status, states, said = run("--tilt-prior-deg", 2)
    assert status == 1
    assert states["r1"][0] == "failed"
    assert states["r1"][1].startswith("r1.npz: ")
    assert states["r1"][1].endswith("No space left on device")
    assert (tmp_path / "out" / "r1" / "calibration.json").read_bytes() == before
    assert "Traceback" not in said
    monkeypatch.setattr(put_files, "write_together", write_together)
    assert run("--tilt-prior-deg", 2)[1]["r1"][0] == "done"


@pytest.mark.slow
def test_a_run_that_was_killed_goes_on_to_the_same_results(tmp_path: Path) -> None:
    words = [sys.executable, str(ROOT / "benchmarks" / "killed_runs.py"), "--robots", "4", "--moments", "1"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 of 1 runs ended as an undisturbed one" in done.stdout
