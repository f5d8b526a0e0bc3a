"""fleet-calibrate: good robots come out right, bad logs get one clear line, and never hide the others."""

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from boxcal.calib.cli import main
from boxcal.calib.compare.ground_truth import compare, load_truth
from boxcal.calib.results.json_format import load_calibration
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.calib.simulate.robot import khepera, turtlebot
from boxcal.calib.simulate.truth import truth_bytes
from boxcal.detect.correspondences import load_correspondences
from boxcal.target.box import Box, make_target
from boxcal.target.files.target_json import save_target
from boxcal.target.measure.measured_size import Measured

STORE = get_typestore(Stores.ROS2_HUMBLE)
RECORD = RecordOptions(frames=2, moving_frames=1)
JOINTS, CAMERA = "/joint_states", "/camera/image_raw/compressed"
Change = Callable[[str, Any], Any]
SHORT = ("--quiet", "--no-report", "--jobs", 1)
"""For tests that look at neither the report nor the progress."""


def _simulate(path: Path, *, seed: int = 5, stops: Any = None, target: Any = None, count: int = 7) -> Path:
    rng = np.random.default_rng(seed)
    target = target or make_target()
    robot, options = khepera(path.stem), DriveOptions(stops=count)
    drive = simulate_drive(robot, target, options, rng, stops)
    write_log(path, robot, target, drive, RECORD, rng=rng)
    return path


def _rewrite(source: Path, path: Path, change: Change) -> Path:
    """A copy of a log with each message as ``change(topic, message)`` returns it; None leaves a message out."""
    with source.open("rb") as file, LogWriter(path) as log:
        for _, channel, record in make_reader(file).iter_messages():
            kind = "sensor_msgs/msg/JointState" if channel.topic == JOINTS else "sensor_msgs/msg/CompressedImage"
            message = change(channel.topic, STORE.deserialize_cdr(record.data, kind))
            if message is not None:
                log.message(channel.topic, record.log_time, message)
    return path


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log that calibrates well, its truth beside it."""
    folder = tmp_path_factory.mktemp("robots")
    rng = np.random.default_rng(5)
    robot, target, options = khepera("good"), make_target(), DriveOptions(stops=7, slip=5e-5)
    drive = simulate_drive(robot, target, options, rng)
    names, pictures = write_log(folder / "good.mcap", robot, target, drive, RECORD, rng=rng)
    assert pictures == 7 * 2 + 6
    truth = truth_bytes(robot, drive, options, RECORD, names)
    (folder / "good.truth.json").write_bytes(truth)
    return folder / "good.mcap"


@pytest.fixture(scope="session")
def calibrated(good: Path) -> Path:
    """The folder of the good robot's results, without a report."""
    out = good.parent / "out"
    assert main([str(good), "--out", str(out), "--quiet", "--no-report"]) == 0
    return out / "good"


def _run(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    status = main([str(word) for word in words])
    out, err = capsys.readouterr()
    return status, out, err


def test_a_simulated_robot_is_calibrated_and_compared_with_truth(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = _run(capsys, good, "--truth", "--out", tmp_path / "out")
    assert status == 0
    assert "good" in out
    assert "error against truth" in out
    assert re.search(r"\[1/1\] good\.mcap: usable in \d", err)
    assert all(len(line) <= 80 for line in out.splitlines() if str(tmp_path) not in line)
    document = json.loads((tmp_path / "out" / "good" / "calibration.json").read_text())
    assert document["schema"] == 1
    assert document["robot"] == "good"
    assert set(document["camera"]) == {"fu", "fv", "cu", "cv", "kr"}
    assert {"rR", "rL", "b"} <= set(document["wheels"])
    assert np.shape(document["T_body_cam"]) == (4, 4)
    provenance = document["provenance"]
    assert "--truth" in provenance["command"]
    assert len(provenance["inputs"]["good.mcap"]) == 64
    errors = compare(
        load_calibration(tmp_path / "out" / "good" / "calibration.json"), load_truth(good.with_name("good.truth.json"))
    )
    assert max(abs(errors.rR), abs(errors.rL), abs(errors.b)) < 0.01
    assert errors.rotation < np.radians(0.25)
    assert max(abs(errors.fu), abs(errors.fv)) < 0.003


def test_saved_correspondences_calibrate_without_the_log(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = _run(capsys, calibrated / "correspondences.npz", "--out", tmp_path, "--quiet")
    assert status == 0, err
    a, b = (json.loads((k / "calibration.json").read_text()) for k in (calibrated, tmp_path / "good"))
    for key in ("camera", "wheels", "T_body_cam", "stops"):
        assert a[key] == b[key]


def test_per_stop_mode_is_taken_and_recorded(good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = _run(capsys, good, "--per-stop", "--closed-form", "--out", tmp_path, "--quiet")
    assert status == 0, err
    result = load_calibration(tmp_path / "good" / "calibration.json")
    assert result.provenance.settings["camera_mode"] == "per-stop"


def _cut(source: Path, path: Path) -> Path:
    path.write_bytes(source.read_bytes()[: source.stat().st_size // 4])
    return path


def _poses(*rows: Sequence[float]) -> Any:
    return np.array(rows, dtype=float)


def _joints(change: Callable[[Any], Any]) -> Change:
    return lambda topic, message: change(message) if topic == JOINTS else message


def _wheels(left: float, right: float, swap: bool = False) -> Change:
    """Joint states with each wheel's angle multiplied, and the names exchanged."""

    def change(message: Any) -> Any:
        signs = np.array([left if "left" in name else right for name in message.name])
        names = message.name[::-1] if swap else message.name
        return replace(message, position=message.position * signs, velocity=message.velocity * signs, name=names)

    return _joints(change)


def _images(change: Callable[[Any], Any]) -> Change:
    return lambda topic, message: change(message) if topic == CAMERA else message


def _later(seconds: int) -> Callable[[Any], Any]:
    def change(message: Any) -> Any:
        stamp = replace(message.header.stamp, sec=message.header.stamp.sec + seconds)
        return replace(message, header=replace(message.header, stamp=stamp))

    return change


def _blank(message: Any) -> Any:
    content = cv2.imencode(".jpg", np.full((480, 640), 128, np.uint8))[1].ravel()
    return replace(message, data=content)


def _garbage(message: Any) -> Any:
    return replace(message, data=np.frombuffer(b"\xff\xd8\xff\xe0 this is no picture", np.uint8))


def _spin(folder: Path) -> Path:
    headings = np.pi + np.radians([0, 14, -12, 22, 5, -20])
    return _simulate(folder / "bad.mcap", stops=np.array([(0.62, 0.0, h) for h in headings]))


def _straight(folder: Path) -> Path:
    rows = [(x, 0.12, np.pi) for x in (0.9, 0.82, 0.75, 0.68, 0.6)]
    return _simulate(folder / "bad.mcap", stops=_poses(*rows))


def _two_stops(folder: Path) -> Path:
    return _simulate(folder / "bad.mcap", stops=_poses((0.6, 0.1, np.pi), (0.1, 0.65, -np.pi / 2)))


def _other_box(folder: Path) -> Path:
    return _simulate(folder / "bad.mcap", target=make_target(Box(first_id=200)), count=3)


def _text_file(folder: Path) -> Path:
    (folder / "bad.mcap").write_text("time,left,right\n0,0,0\n")
    return folder / "bad.mcap"


BAD: dict[str, tuple[Callable[[Path, Path], Path], list[str]]] = {
    "no such file": (lambda good, folder: folder / "bad.mcap", ["no such file"]),
    "not an MCAP": (lambda good, folder: _text_file(folder), ["not an MCAP"]),
    "truncated": (lambda good, folder: _cut(good, folder / "bad.mcap"), ["truncated", "3 such stops are needed"]),
    "no camera": (
        lambda good, folder: _rewrite(good, folder / "bad.mcap", _images(lambda m: None)),
        ["no camera", JOINTS],
    ),
    "no wheel joints": (
        lambda good, folder: _rewrite(good, folder / "bad.mcap", _joints(lambda m: replace(m, name=["pan", "tilt"]))),
        ["no wheel joints", "pan", "tilt", "--left-joint", "--right-joint"],
    ),
    "fewer than three stops": (lambda good, folder: _two_stops(folder), ["2 stops", "3 such stops are needed"]),
    "box never seen": (
        lambda good, folder: _rewrite(good, folder / "bad.mcap", _images(_blank)),
        ["box"],
    ),
    "tags of another target": (lambda good, folder: _other_box(folder), ["200", "0 to 139", "target.json"]),
    "an image that does not decode": (
        lambda good, folder: _rewrite(good, folder / "bad.mcap", _images(_garbage)),
        ["image", "neither JPEG nor PNG"],
    ),
    "left and right swapped": (
        lambda good, folder: _rewrite(good, folder / "bad.mcap", _wheels(1, 1, swap=True)),
        ["left and right wheel joints are swapped", "--left-joint"],
    ),
    "left wheel reversed": (
        lambda good, folder: _rewrite(good, folder / "bad.mcap", _wheels(-1, 1)),
        ["the left wheel's readings fall while it rolls forward"],
    ),
    "right wheel reversed": (
        lambda good, folder: _rewrite(good, folder / "bad.mcap", _wheels(1, -1)),
        ["the right wheel's readings fall while it rolls forward"],
    ),
    "pure rotation": (lambda good, folder: _spin(folder), ["turned on the spot", "drive forward"]),
    "pure translation": (lambda good, folder: _straight(folder), ["largest turn", "translation"]),
}


def test_bad_logs_get_one_clear_line_each_and_the_others_are_calibrated(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All in one run, so that the good one is calibrated once."""
    bad = {}
    for case, (make, _) in BAD.items():
        (tmp_path / case).mkdir()
        made = make(good, tmp_path / case)
        bad[case] = made.with_name(f"{case.replace(' ', '-')}.mcap")
        if made.exists():
            made.rename(bad[case])
    status, out, err = _run(capsys, *bad.values(), good, "--out", tmp_path / "out", "--quiet", "--jobs", 1)
    assert status == 1
    assert "good" in out
    assert (tmp_path / "out" / "good" / "calibration.json").exists()
    for case, (_, words) in BAD.items():
        path = bad[case]
        assert not (tmp_path / "out" / path.stem).exists()
        lines = [line for line in err.splitlines() if path.name in line]
        assert len(lines) == 1, (case, err)
        named = path if case == "no such file" else path.name  # what is not there is named with its whole path
        assert lines[0].startswith(f"fleet-calibrate: {named}: ")
        for word in words:
            assert word in lines[0], (case, lines[0])
    assert "Traceback" not in err
    assert f"{len(BAD)} of {len(BAD) + 1} robots failed" in err


def test_a_camera_whose_clock_is_off_is_put_right_by_the_times_of_recording_and_said(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = _rewrite(good, tmp_path / "late.mcap", _images(_later(1000)))
    assert _run(capsys, good, late, "--out", tmp_path / "out", *SHORT)[0] == 0
    found, right = (load_correspondences(tmp_path / "out" / r / "correspondences.npz") for r in ("late", "good"))
    assert found.source.clock_offset == pytest.approx(1000, abs=0.1)
    assert any("clock is 1000.0 s ahead" in note for note in found.source.notes)
    for a, b in zip(found.stops, right.stops, strict=True):
        np.testing.assert_allclose(a.uv_px, b.uv_px, atol=1e-9)


def test_ambiguous_topics_are_listed_and_can_be_named(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    two = tmp_path / "two.mcap"
    with good.open("rb") as file, LogWriter(two) as log:
        for _, channel, record in make_reader(file).iter_messages():
            kind = "sensor_msgs/msg/JointState" if channel.topic == JOINTS else "sensor_msgs/msg/CompressedImage"
            message = STORE.deserialize_cdr(record.data, kind)
            log.message(channel.topic, record.log_time, message)
            if channel.topic == CAMERA:
                log.message("/rear/image_raw/compressed", record.log_time, message)
    status, _, err = _run(capsys, two, "--out", tmp_path / "out", "--quiet")
    assert status == 1
    assert CAMERA in err
    assert "/rear/image_raw/compressed" in err
    assert "--camera-topic" in err
    status, _, err = _run(capsys, two, "--out", tmp_path / "out", *SHORT, "--camera-topic", CAMERA)
    assert status == 0, err


def test_a_swapped_log_calibrates_when_the_joints_are_named(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = _rewrite(good, tmp_path / "swapped.mcap", _wheels(1, 1, swap=True))
    names = ("--left-joint", "right_wheel_joint", "--right-joint", "left_wheel_joint")
    status, _, err = _run(capsys, bad, "--out", tmp_path / "out", *SHORT, *names)
    assert status == 0, err


def test_two_workers_give_what_one_gives(good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    second = tmp_path / "second.mcap"
    shutil.copy(good, second)
    for jobs in (1, 2):
        status, _, err = _run(capsys, good, second, "--jobs", jobs, "--no-report", "--out", tmp_path / str(jobs))
        assert status == 0, err
    for robot in ("good", "second"):
        a, b = (json.loads((tmp_path / k / robot / "calibration.json").read_text()) for k in "12")
        # Sums are taken in another order where arrays lie elsewhere in memory: far below a sigma, yet not to the bit.
        np.testing.assert_allclose(a["T_body_cam"], b["T_body_cam"], atol=1e-6)


def test_drives_of_one_robot_are_solved_together(
    good: Path, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = tmp_path / "again.mcap"
    rng = np.random.default_rng(6)
    drive = simulate_drive(khepera("again"), make_target(), DriveOptions(stops=6, slip=5e-5), rng)
    write_log(again, khepera("again"), make_target(), drive, RECORD, rng=rng)
    status, _, err = _run(capsys, good, again, "--same-robot", "--out", tmp_path / "out", "--quiet")
    assert status == 0, err
    names = {p.name for p in (tmp_path / "out" / "good").iterdir()}
    assert {"calibration.json", "correspondences-1.npz", "correspondences-2.npz", "report.html"} <= names
    both = load_calibration(tmp_path / "out" / "good" / "calibration.json")
    assert both.quality.stops == 13
    assert {stop.drive for stop in both.stops} == {0, 1}
    assert set(both.provenance.inputs) == {"good.mcap", "again.mcap", "target"}
    one = load_calibration(calibrated / "calibration.json")
    assert both.detail is not None
    assert one.detail is not None
    assert both.detail.covariance.sigma["b"] < one.detail.covariance.sigma["b"]


def test_drives_of_two_robots_given_as_one_are_refused(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.mcap"
    rng = np.random.default_rng(7)
    drive = simulate_drive(turtlebot("other"), make_target(), DriveOptions(stops=5), rng)
    write_log(other, turtlebot("other"), make_target(), drive, RECORD, rng=rng)
    status, _, err = _run(capsys, good, other, "--same-robot", "--out", tmp_path / "out", "--quiet")
    assert status == 1
    assert "not drives of one robot" in err


def test_everything_that_users_take_away_is_written(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "nominal.yaml").write_text("wheel_radius: 0.021\nwheel_separation: 0.09\n")
    out = tmp_path / "out"
    viewer = ("--results-mcap", tmp_path / "drive.mcap")
    status, text, err = _run(
        capsys,
        good,
        "--out",
        out,
        "--draw",
        "--validate",
        "--nominal",
        tmp_path / "nominal.yaml",
        *viewer,
        "--lens",
        "radial",
    )
    assert status == 0, err
    assert re.search(r"^good: (GOOD|USABLE|REDO) - ", text, flags=re.MULTILINE)
    assert {p.name for p in out.iterdir()} == {
        "good",
        "fleet.csv",
        "fleet-columns.csv",
        "run.json",
        "fleet.xlsx",
        "fleet.html",
        "fleet.json",
    }
    names = {p.name for p in (out / "good").iterdir()}
    assert {"calibration.json", "correspondences.npz", "report.html", "camera_info.yaml", "camera.urdf"} <= names
    assert {"static_transform.sh", "diff_drive_controller.yaml", "camchain.yaml", "stops"} <= names
    assert "wheel_radius: 0.021" in (out / "good" / "diff_drive_controller.yaml").read_text()
    assert len(list((out / "good" / "stops").iterdir())) == 7
    result = load_calibration(out / "good" / "calibration.json")
    assert result.detail is not None
    assert len(result.detail.held_out) == 6
    assert [g.stops for g in result.detail.growth][-1] == 7
    with (tmp_path / "drive.mcap").open("rb") as file:
        assert make_reader(file).get_summary() is not None


def test_every_prior_and_lens_is_taken(calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved = calibrated / "correspondences.npz"
    for words, unknown in (
        (("--lens", "auto"), ""),
        (("--lens", "brown"), "k2"),
        (("--scale-prior-percent", "0.5"), "scale_x"),
        (("--size-prior-mm", "0.5"), "face0_tz"),
        (("--face-prior-mm", "0.5"), "face"),
        (("--ink-prior-mm", "0", "--tilt-prior-deg", "0"), "growth"),
        (("--encoder-step-deg", "0.1302", "--slip-mm", "0.2"), ""),
    ):
        status, out, err = _run(capsys, saved, *words, "--out", tmp_path / "b", "--quiet", "--no-report")
        assert status == 0, err
        again = load_calibration(tmp_path / "b" / "good" / "calibration.json")
        detail = again.detail
        assert detail is not None
        names = [*detail.extra, *again.camera.further]
        assert any(unknown in name for name in names) or not unknown, (words, names)
        if words[1] == "auto":
            assert "(chosen by the images)" in out
        if words[0] == "--ink-prior-mm":
            assert not {"ink", "tilt_x", "tilt_y"} & set(detail.extra)
        if words[0] == "--encoder-step-deg":
            assert detail.noise.slip == pytest.approx(2e-4)


def test_a_folder_with_another_fleets_results_is_not_touched(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert _run(capsys, good, "--out", out, "--quiet", "--no-report")[0] == 0
    save_target(make_target(Box(first_id=140)), tmp_path / "other.json")
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    status, _, err = _run(capsys, good, "--target", tmp_path / "other.json", "--out", out)
    assert status == 2
    assert "drove around another box" in err
    assert "from id 140" in err
    assert before == {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    (out / "fleet.json").write_text("[1]")
    assert _run(capsys, good, "--out", out)[0] == 2


def test_a_box_measured_later_corrects_what_was_read_before(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = calibrated / "correspondences.npz"
    cov = np.diag([1e-3, 1e-3, 2.5e-4, 2.5e-4, 2e-4]) ** 2
    measured = Measured(sx=1.01, sy=1.01, width=0.2525, depth=0.2525, height=0.202, cov=cov)
    save_target(make_target(Box(), measured), tmp_path / "measured.json")
    words = ("--target", tmp_path / "measured.json", "--out", tmp_path / "b", "--quiet", "--no-report")
    status, _, err = _run(capsys, saved, *words)
    assert status == 0, err
    a, b = (load_calibration(k / "calibration.json") for k in (calibrated, tmp_path / "b" / "good"))
    assert any("measuring" in note and "better would help most" in note for note in b.notes)
    assert not any("measuring" in note for note in a.notes)
    assert b.wheels.b / a.wheels.b == pytest.approx(1.01, abs=2e-3)
    assert a.detail is not None
    assert b.detail is not None
    assert b.detail.covariance.sigma["b"] > a.detail.covariance.sigma["b"]
    save_target(make_target(Box(first_id=140)), tmp_path / "other.json")
    status, _, err = _run(capsys, saved, "--target", tmp_path / "other.json", "--out", tmp_path / "c", "--quiet")
    assert status == 1
    assert "the target does not carry it" in err


def test_no_report_is_written_when_none_is_wanted(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = _run(capsys, good, "--no-report", "--out", tmp_path, "--quiet")
    assert status == 0
    assert "reports:" not in out
    assert not list(tmp_path.rglob("*.html"))


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["--tagret", "x.json"], 2, "--tagret"),
        ([], 2, "LOG"),
        (["x.mcap", "--jobs", "0"], 2, "a whole number from 1"),
        (["x.mcap", "--target", "none.json"], 2, "none.json: cannot be read"),
        (["a/x.mcap", "b/x.mcap"], 2, "several logs are named x"),
        (["a/...mcap"], 2, "no name for a robot"),
        (["a.mcap", "b.mcap", "--rerun", "x.rrd"], 2, "show one robot"),
        (["a.mcap", "--nominal", "none.yaml"], 2, "none.yaml"),
        (["a.mcap", "--tilt-prior-deg", "-1"], 2, "a number from 0 to 1000"),
    ],
)
def test_wrong_usage_is_said_with_exit_status_2(
    words: list[str], status: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        found = main(words)
    except SystemExit as leave:
        found = int(leave.code or 0)
    assert found == status
    assert message in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="file names are bytes on Linux")
def test_a_file_name_that_cannot_be_printed_is_shown_without_and_names_a_robot(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Control characters and bytes that are no text ended the run; the logs beside it were not calibrated either."""
    names = "a\nb\x1b[31m.mcap", os.fsdecode(b"r\xff2.mcap")
    for name in names:
        shutil.copy(good, tmp_path / name)
    (tmp_path / "c\x1b[31m.mcap").write_bytes(b"nothing")
    out = tmp_path / "out"
    status, said, err = _run(capsys, *sorted(tmp_path.glob("*.mcap")), "--out", out, "--no-report")
    assert status == 1
    assert "c?[31m.mcap: " in err
    assert all(letter.isprintable() for letter in (said + err).replace("\n", ""))
    assert {path.name for path in out.iterdir() if path.is_dir()} == {"a_b_[31m", "r_2"}
    for name, robot in zip(names, ("a_b_[31m", "r_2"), strict=True):
        assert load_calibration(out / robot / "calibration.json").robot == robot
        assert json.loads((out / "run.json").read_text())["robots"][robot]["logs"] == [str(tmp_path / name)]


def test_the_target_file_decides_what_is_looked_for(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_target(make_target(), tmp_path / "same.json")
    save_target(make_target(Box(first_id=140)), tmp_path / "other.json")
    assert _run(capsys, good, "--target", tmp_path / "same.json", "--out", tmp_path / "a", *SHORT)[0] == 0
    status, _, err = _run(capsys, good, "--target", tmp_path / "other.json", "--out", tmp_path / "b", "--quiet")
    assert status == 1
    assert "good.mcap" in err


def test_a_missing_truth_file_is_said(good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lonely = tmp_path / "lonely.mcap"
    shutil.copy(good, lonely)
    status, out, err = _run(capsys, lonely, "--truth", "--out", tmp_path, *SHORT)
    assert status == 1
    assert "lonely" in out
    assert "no truth: " in err
    assert "lonely.truth.json cannot be found" in err


def test_a_folder_that_cannot_be_written_is_said_before_the_work(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("a file stands where the folder should be")
    status, _, err = _run(capsys, good, "--out", tmp_path / "out", "--quiet")
    assert status == 2
    assert "cannot be written" in err
    assert "give another folder with --out" in err
    assert "Traceback" not in err


@pytest.mark.slow
def test_logs_that_nobody_here_wrote_are_calibrated(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two path-traced robots, with the errors that the closed form may have on drives with slip."""
    logs = sorted((shared_data / "fleet").glob("*.mcap"))
    status, _, err = _run(capsys, *logs, "--out", tmp_path)
    assert status == 0, err
    for log in logs:
        result = load_calibration(tmp_path / log.stem / "calibration.json")
        e = compare(result, load_truth(log.with_name(f"{log.stem}.truth.json")))
        assert max(abs(e.rL), abs(e.rR), abs(e.b)) < 0.01
        assert e.rotation < np.radians(0.25)
        assert max(abs(e.tx), abs(e.ty)) < 0.006
        assert max(abs(e.fu), abs(e.fv)) < 0.003
        assert result.quality.stops == 20


def test_a_drive_that_is_given_twice_is_refused_and_said_where_it_is_named_as_two_robots(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy.mcap"
    shutil.copy(good, copy)
    status, _, err = _run(capsys, good, copy, "--out", tmp_path / "two", *SHORT)
    assert status == 0
    assert "copy, good were calibrated from one recording" in err
    saved = tmp_path / "two" / "good" / "correspondences.npz"
    for again in (copy, saved):
        status, _, err = _run(capsys, good, again, "--same-robot", "--out", tmp_path / "one", *SHORT)
        assert status == 1
        assert f"{again.name}: the same drive as good.mcap; give each drive once" in err
