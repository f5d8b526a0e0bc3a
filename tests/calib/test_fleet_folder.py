"""The output folder is the team's: robots calibrated one after another, failed ones, stale results, interruptions."""

import csv
import ctypes
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import boxcal
from boxcal.calib.cli import main
from boxcal.calib.console.progress import make_progress
from boxcal.calib.console.tables import columns, shortened, table
from boxcal.calib.fleet.find_target import find_target
from boxcal.calib.fleet.interrupts import ended_by_sigterm, interrupts_held, interrupts_remembered
from boxcal.calib.fleet.store import natural
from boxcal.calib.settings import NOTE, Stage
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.source import Source
from boxcal.target.box import Box, make_target
from boxcal.target.files.atomic_write import clear_parts, write_atomically
from boxcal.target.files.target_json import save_target
from boxcal.target.measure.measured_size import Measured

PAPER = ("--lens", "radial", "--floor", "rigid", "--scale-prior-percent", "0", "--face-prior-mm", "0")
"""What the paper takes as exact: solved in a tenth of a second, for tests that are about files."""
MEASURED = Measured(
    sx=1.002, sy=1.001, width=0.2504, depth=0.2498, height=0.2, cov=np.diag([1e-3, 1e-3, 2e-4, 2e-4, 2e-4]) ** 2
)


@pytest.fixture(autouse=True)
def _interruptible() -> Iterator[None]:
    """Have commands that are started hear Ctrl-C, which a shell's background job, such as this one may be, does not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def drive() -> Correspondences:
    rng, target, robot = np.random.default_rng(3), make_target(), turtlebot("r2")
    simulated = simulate_drive(robot, target, DriveOptions(stops=9), rng)
    return exact_correspondences(robot, target, simulated, 0.1, rng)


@pytest.fixture
def logs(drive: Correspondences, tmp_path: Path) -> Path:
    """A folder with saved correspondences of two robots, and one that is no log."""
    folder = tmp_path / "robots"
    for name in ("r2", "r10"):
        named = replace(drive, source=Source(log=f"{name}.mcap", sha256=name * 20, target_sha256=""))
        named.save(folder / f"{name}.npz")
    (folder / "r3.npz").write_bytes(b"no log")
    return folder


def _run(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    status = main([str(word) for word in (*words, "--no-report", "--jobs", 1, *PAPER)])
    out, err = capsys.readouterr()
    return status, out, err


def _fleet(out: Path) -> tuple[dict[str, dict[str, str]], dict[str, object]]:
    rows = {row["robot"]: row for row in csv.DictReader(io.StringIO((out / "fleet.csv").read_text()))}
    return rows, json.loads((out / "fleet.json").read_text())


def test_robots_calibrated_one_after_another_are_one_fleet(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert _run(capsys, logs / "r10.npz", "--out", out)[0] == 0
    assert _run(capsys, logs / "r3.npz", "--out", out)[0] == 1
    assert _run(capsys, logs / "r2.npz", "--out", out)[0] == 0
    rows, document = _fleet(out)
    assert list(rows) == ["r2", "r10", "r3"]
    assert [rows[r]["verdict"] for r in ("r2", "r10", "r3")] == ["good", "good", "failed"]
    assert "r3.npz" in rows["r3"]["error"]
    assert document["robots"] == {"r2": "good", "r10": "good"}
    assert set(document["failed"]) == {"r3"}
    assert (out / "fleet.csv").read_text().startswith("robot,verdict,")
    legend = list(csv.reader(io.StringIO((out / "fleet-columns.csv").read_text())))
    assert [row[0] for row in legend[1:]] == list(rows["r2"])


def test_result_of_an_earlier_log_is_marked_stale_when_the_new_one_fails(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert _run(capsys, logs / "r2.npz", "--out", out)[0] == 0
    (logs / "r2.npz").write_bytes(b"no log")
    assert _run(capsys, logs / "r2.npz", "--out", out)[0] == 1
    rows, document = _fleet(out)
    assert "earlier log" in rows["r2"]["stale"]
    assert set(document["stale"]) == set(document["failed"]) == {"r2"}
    assert "earlier log" in (out / "r2" / "FAILED.txt").read_text()
    shutil.copy(logs / "r10.npz", logs / "r2.npz")
    assert _run(capsys, logs / "r2.npz", "--out", out)[0] == 0
    rows, document = _fleet(out)
    assert not rows["r2"]["stale"]
    assert not document["failed"]
    assert not (out / "r2" / "FAILED.txt").exists()


def test_a_run_in_which_all_failed_does_not_block_the_folder(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    save_target(make_target(Box(first_id=140)), tmp_path / "other.json")
    assert _run(capsys, logs / "r2.npz", "--target", tmp_path / "other.json", "--out", out)[0] == 1
    assert (out / "fleet.json").exists()
    status, _, err = _run(capsys, logs / "r2.npz", "--out", out)
    assert status == 0, err


def test_the_same_box_measured_anew_is_no_other_box(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert _run(capsys, logs / "r2.npz", "--out", out)[0] == 0
    save_target(make_target(Box(), MEASURED), tmp_path / "measured.json")
    status, _, err = _run(capsys, logs / "r10.npz", "--target", tmp_path / "measured.json", "--out", out)
    assert status == 0, err
    rows, _ = _fleet(out)
    assert "before the box was measured anew" in rows["r2"]["stale"]
    assert not rows["r10"]["stale"]


def test_the_box_beside_or_above_the_logs_is_taken(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = logs / "r2.npz"
    assert find_target(None, [log]).path is None
    save_target(make_target(Box(), MEASURED), tmp_path / "box" / "target.json")
    found = find_target(None, [log])
    assert found.target.measured is not None
    assert "as measured" in found.said
    save_target(make_target(), logs / "target.json")
    nearer = find_target(None, [log])
    assert nearer.path == logs / "target.json"
    assert "as designed" in nearer.said
    status, _, err = _run(capsys, log, "--out", tmp_path / "out")
    assert status == 0
    assert "robots/target.json (as designed)" in err
    elsewhere = tmp_path / "deep" / "a" / "b" / "c" / "r2.npz"
    elsewhere.parent.mkdir(parents=True)
    shutil.copy(log, elsewhere)
    status, _, err = _run(capsys, log, elsewhere.rename(elsewhere.with_name("r5.npz")), "--out", tmp_path / "out")
    assert status == 0, err  # three folders above is as far as is looked
    shutil.copytree(tmp_path / "box", tmp_path / "deep" / "box")
    status, _, err = _run(capsys, log, elsewhere.with_name("r5.npz"), "--out", tmp_path / "out")
    assert status == 2
    assert "different boxes" in err


def test_strict_tells_scripts_what_the_verdict_is(
    drive: Correspondences, logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = Correspondences(robot="few", image_size=drive.image_size, wheels=drive.wheels, stops=drive.stops[:5])
    few.save(tmp_path / "few.npz")
    out = tmp_path / "out"
    status, text, _ = _run(capsys, tmp_path / "few.npz", "--out", out)
    assert status == 0
    assert "  why: Only 5 stops were used" in text
    assert "  do: " in text
    status, _, err = _run(capsys, tmp_path / "few.npz", "--out", out, "--strict")
    assert status == 3
    assert "not good: few" in err
    assert _run(capsys, logs / "r2.npz", "--out", out, "--strict")[0] == 0


def test_resume_skips_what_is_there_already(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    _run(capsys, logs / "r2.npz", "--out", out)
    before = (out / "r2" / "calibration.json").read_bytes()
    status, text, _ = _run(capsys, logs / "r2.npz", logs / "r10.npz", "--out", out, "--resume")
    assert status == 0
    assert "r2 " in text
    assert (out / "r2" / "calibration.json").read_bytes() == before
    status, _, _ = _run(capsys, logs / "r2.npz", "--out", out, "--resume", "--tilt-prior-deg", 2)
    assert status == 0
    assert (out / "r2" / "calibration.json").read_bytes() != before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--draw",), "--draw needs the images"),
        (("--closed-form", "--validate"), "exclude each other"),
        (("--cluster", "tcp://127.0.0.1:1", "--results-mcap", "out.mcap"), "--cluster does it elsewhere"),
        (("--rerun", "x.rrd"), "rerun"),
    ],
)
def test_impossible_combinations_are_said_before_the_work(
    words: tuple[str, ...], said: str, logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    robots = [logs / "r2.npz"] if "--rerun" not in words else [logs / "r2.npz", logs / "r10.npz"]
    status, _, err = _run(capsys, *robots, "--out", out, *words)
    assert status == 2
    assert said in err
    assert not out.exists()


@pytest.mark.parametrize(("moment", "jobs"), [("starting", "2"), ("solving", "2"), ("[1/5]", "1"), ("[2/5]", "2")])
def test_ctrl_c_at_any_moment_leaves_a_readable_folder(
    moment: str, jobs: str, logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, robots = tmp_path / "out", [f"q{k:02d}" for k in range(5)]
    words = [*(str(shutil.copy(logs / "r2.npz", logs / f"{robot}.npz")) for robot in robots), *PAPER, "--out", str(out)]
    command = [sys.executable, "-m", "boxcal.calib.cli", *words, "--jobs", jobs]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, process_group=0
    ) as process:
        assert process.stderr is not None
        begun = time.monotonic()
        said = next(line for line in process.stderr if moment in line)
        if moment == "starting":  # before anything heavy is loaded
            assert time.monotonic() - begun < 2 or os.getloadavg()[0] > 2 * (os.cpu_count() or 1), said
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=240)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert err.splitlines()[-1].startswith("fleet-calibrate: interrupted")
    finished = {path.parent.name for path in out.glob("*/calibration.json")}
    assert not list(out.rglob("*.part")), "nothing half-written"
    if moment.startswith("["):
        assert len(finished) >= int(moment[1])
        rows, document = _fleet(out)
        assert set(rows) == finished == set(document["robots"])
    for robot in finished:
        boxcal.load_calibration(out / robot / "calibration.json")
    assert main([*words, "--jobs", "1", "--resume"]) == 0
    counted = re.findall(r"\[\d/(\d)\]", capsys.readouterr().err)
    assert len(counted) == len(robots) - len(finished)
    rows, document = _fleet(out)
    assert set(rows) == set(document["robots"]) == set(robots)


def test_ctrl_c_while_code_compiles_ends_both_processes_in_one_line(logs: Path, tmp_path: Path) -> None:
    cache, out = tmp_path / "cache", tmp_path / "out"
    command = [sys.executable, "-m", "boxcal.calib.cli", str(logs / "r2.npz"), *PAPER, "--out", str(out)]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment, process_group=0) as process:
        assert process.stderr is not None
        assert any("compiling, once" in line for line in process.stderr)
        time.sleep(1.0)  # the helper is on its way
        os.killpg(process.pid, signal.SIGINT)
        said = process.stderr.read()  # to the end that the last process makes of it
        process.wait(60)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert said.splitlines()[-1].startswith("fleet-calibrate: interrupted")
    assert not list(cache.rglob("complete"))


def test_nothing_is_compiled_for_logs_that_are_not_there(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    words = [sys.executable, "-m", "boxcal.calib.cli", str(tmp_path / "gone.mcap"), "--out", str(tmp_path / "out")]
    assert subprocess.run(words, env=environment, check=False, timeout=100).returncode == 1
    said = capfd.readouterr()
    assert "no such file" in said.err + said.out
    assert "compiling" not in said.err + said.out
    assert not (tmp_path / "cache").exists()


def test_ctrl_c_that_a_call_back_swallows_is_not_lost() -> None:
    with interrupts_remembered() as again:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            again()


@pytest.mark.parametrize(
    ("number", "raised", "handled"),
    [
        (signal.SIGINT, KeyboardInterrupt, interrupts_remembered),
        (signal.SIGTERM, SystemExit, ended_by_sigterm),
    ],
)
def test_a_signal_in_a_call_back_is_raised_again_when_it_has_returned(
    number: signal.Signals,
    raised: type[BaseException],
    handled: Callable[[], AbstractContextManager[object]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    presses = 0

    @ctypes.CFUNCTYPE(None)
    def call_back() -> None:
        nonlocal presses
        presses += 1
        if presses <= 3:  # in the first three call-backs, each of which drops it
            signal.raise_signal(number)

    begun = time.monotonic()
    with pytest.raises(raised), handled():  # noqa: PT012
        for _ in range(3):
            call_back()
        while time.monotonic() < begun + 5:
            time.sleep(0.01)
    assert presses == 3
    assert time.monotonic() - begun < 2
    assert not capsys.readouterr().err


def test_a_signal_that_comes_while_a_dropped_one_is_sent_again_is_not_lost(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    start, starts = threading.Timer.start, 0

    def slow_start(timer: threading.Timer) -> None:
        nonlocal starts
        starts += 1
        if starts <= 2:
            signal.raise_signal(signal.SIGTERM)
        start(timer)

    monkeypatch.setattr(threading.Timer, "start", slow_start)
    begun = time.monotonic()
    with pytest.raises(SystemExit), ended_by_sigterm():  # noqa: PT012
        ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGTERM))()
        while time.monotonic() < begun + 5:
            time.sleep(0.01)
    assert starts == 3
    assert not capsys.readouterr().err


def test_ctrl_c_stays_ignored_where_a_shell_ignores_it() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupts_remembered() as again, interrupts_held() as pressed:
            signal.raise_signal(signal.SIGINT)
            assert not pressed()
            again()
    finally:
        signal.signal(signal.SIGINT, before)


def test_closed_output_loses_no_file(logs: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    log = logs / "r2.npz"
    command = f"{sys.executable} -m boxcal.calib.cli {log} --out {out} 2>&1 | head -c 1"
    subprocess.run(["bash", "-c", command], check=True, capture_output=True, timeout=120)
    names = {p.name for p in out.iterdir()} | {p.name for p in (out / "r2").iterdir()}
    assert {"fleet.csv", "fleet.json", "calibration.json", "camera_info.yaml", "correspondences.npz"} <= names


def test_plain_progress_tells_stages_at_once_and_how_far_they_are_now_and_then() -> None:
    stream = io.StringIO()
    with make_progress(2, quiet=False, stream=stream) as progress:
        for k in range(50):
            progress.stage(Stage(robot="r1", name="read", text=f"stop {k}", share=k / 100))
        progress.stage(Stage(robot="r1", name="solve", text="solving 12 stops", share=0.7))
    assert stream.getvalue().splitlines() == ["r1: stop 0", "r1: solving 12 stops"]
    silent = io.StringIO()
    with make_progress(2, quiet=True, stream=silent) as progress:
        progress.stage(Stage(robot="r1", name="read", text="reading", share=0.0))
    assert not silent.getvalue()


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("stream", [io.StringIO(), _Terminal()])
def test_what_is_only_said_is_said_whole_and_is_no_robot(stream: io.StringIO) -> None:
    text = "worker tcp://10.0.0.7:41234 has boxcal's code 000000000000 there, 111111111111 here; left out"
    with make_progress(1, quiet=False, stream=stream) as progress:
        progress.stage(Stage(robot="cluster", name=NOTE, text=text, share=0.0))
    said = "".join(stream.getvalue().split())
    assert "".join(f"cluster: {text}".split()) in said
    assert said.count("cluster") == 1


def test_names_sort_with_their_numbers_as_numbers() -> None:
    assert sorted(["r10", "r2", "r1b", "R3", "r02"], key=natural) == ["R3", "r1b", "r2", "r02", "r10"]


def test_tables_line_up_with_wide_characters_and_long_names() -> None:
    lines = table(["robot", "x"], [["机器人一号", "1.0"], ["r2", "22.0"]]).splitlines()
    assert len({columns(line) for line in lines}) == 1
    assert shortened("r" * 24) == "r" * 24
    assert shortened("left-" + "x" * 40 + "-right") == "left-xxxxxx…xxxxx-right" or columns(shortened("x" * 60)) <= 24
    assert columns(shortened("机" * 40)) <= 24


def test_what_an_ended_process_left_half_written_is_removed(tmp_path: Path) -> None:
    write_atomically(tmp_path / "whole.json", b"{}")
    (tmp_path / ".calibration.json.abcdefgh.part").write_bytes(b"{")
    (tmp_path / ".written-together.abcdefgh.part").mkdir()
    (tmp_path / ".written-together.abcdefgh.part" / "camera.urdf").write_bytes(b"<")
    clear_parts(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["whole.json"]
    clear_parts(tmp_path / "nowhere")


def test_all_missing_truths_are_one_line(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = _run(capsys, logs / "r2.npz", logs / "r10.npz", "--truth", "--quiet", "--out", tmp_path / "out")
    assert status == 1
    (line,) = [line for line in err.splitlines() if "truth" in line]
    assert line.endswith("r2.truth.json and 1 more like it cannot be found; leave out --truth")
