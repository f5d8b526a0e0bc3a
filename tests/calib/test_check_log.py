"""The quick check: what it says of good drives, of faulty ones, and of what cannot be read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from boxcal.calib.check_log.check import LogCheck, check_log
from boxcal.calib.check_log.cli import main
from boxcal.calib.check_log.findings import listed_stops
from boxcal.calib.check_log.recorded import gaps, recording_findings
from boxcal.calib.check_log.timeline import timeline_bytes
from boxcal.calib.results.verdict import Level
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.open_recording import open_recording
from boxcal.target.box import make_target

TARGET = make_target()


def drive(stops: int, slip: float = 3e-4) -> Correspondences:
    rng = np.random.default_rng(4)
    driven = simulate_drive(turtlebot(), TARGET, DriveOptions(stops=stops, slip=slip), rng)
    return exact_correspondences(turtlebot(), TARGET, driven, 0.05, rng)


def checked(seen: Correspondences, tmp_path: Path) -> LogCheck:
    path = tmp_path / "run.npz"
    seen.save(path)
    return check_log(path, TARGET)


def texts(check: LogCheck, topic: str, *, fine: bool = False) -> str:
    return " ".join(f.text for f in check.findings if f.topic == topic and (f.level is Level.GOOD) == fine)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng, robot = np.random.default_rng(2), turtlebot()
    driven = simulate_drive(robot, TARGET, DriveOptions(stops=5, slip=3e-4), rng)
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    write_log(path, robot, TARGET, driven, RecordOptions(frames=2, moving_frames=0), rng=rng)
    return path


def test_a_good_drive_has_nothing_wrong_and_says_what_is_known(tmp_path: Path) -> None:
    check = checked(drive(14), tmp_path)
    assert check.worst is Level.GOOD, [f.line for f in check.findings if f.level is not Level.GOOD]
    assert "Position after 10 m" in texts(check, "known", fine=True)
    assert "14 stops" in texts(check, "stops", fine=True)


def test_what_there_is_one_of_is_not_said_as_of_many(log: Path) -> None:
    recording = open_recording(log)
    first = replace(recording, frame_t_ns=recording.frame_t_ns[:1], frame_numbers=recording.frame_numbers[:1])
    said = " ".join(f.text for f in recording_findings(first))
    assert ": 1 image at" in said
    assert "1 images" not in said


def test_a_short_drive_says_what_is_missing_and_where_to_stop_next(tmp_path: Path) -> None:
    check = checked(drive(4), tmp_path)
    missing = texts(check, "missing")
    assert "is wanted" in missing
    assert "Stop at x" in missing
    assert "4 stops" in texts(check, "stops")


def test_slip_and_a_blurred_stop_are_named(tmp_path: Path) -> None:
    seen = drive(12, slip=6e-3)
    stops = list(seen.stops)
    stops[4] = replace(stops[4], cov_px2=stops[4].cov_px2 * 20**2)
    check = checked(replace(seen, stops=tuple(stops)), tmp_path)
    assert "slip" in texts(check, "drive")
    assert "Stop 5: much less sharp" in texts(check, "sharpness")


def test_a_leg_without_wheels_is_named(tmp_path: Path) -> None:
    seen = drive(10)
    covered = seen.wheels.covered.copy()
    covered[seen.stops[3].last_sample + 5] = False
    check = checked(replace(seen, wheels=replace(seen.wheels, covered=covered)), tmp_path)
    assert "From stop 4 to 5 the wheels" in texts(check, "wheels")


def test_a_face_that_was_not_seen_is_named(tmp_path: Path) -> None:
    seen = drive(12)
    one_side = [stop for stop in seen.stops if not np.any(stop.faces == 2)]
    check = checked(replace(seen, stops=tuple(one_side)), tmp_path)
    assert "Face 2 never seen" in texts(check, "box")


def test_exchanged_wheels_are_wrong_not_unsure(tmp_path: Path) -> None:
    seen = drive(8)
    wheels = replace(seen.wheels, phi_R=seen.wheels.phi_L, phi_L=seen.wheels.phi_R)
    stops = tuple(replace(s, phi_R=s.phi_L, phi_L=s.phi_R) for s in seen.stops)
    check = checked(replace(seen, wheels=wheels, stops=stops), tmp_path)
    assert check.worst is Level.REDO
    assert "swapped" in texts(check, "drive")


def test_a_recording_is_checked_and_drawn(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "run.svg"
    status = main([str(log), "--timeline", str(picture)])
    lines = capsys.readouterr().out.splitlines()
    assert status in {0, 1}
    for topic in ("wheels", "camera", "clock", "stops", "box", "sharpness", "light"):
        assert any(line.split()[1] == topic for line in lines), topic
    assert "joint_states: positions at 50 Hz" in "\n".join(lines)
    assert "face 3" in picture.read_text()


def test_a_note_on_stamps_is_said_and_no_clock_is_vouched_for(log: Path) -> None:
    note = "the images in /camera carry no stamps, the times of their recording were taken"
    recording = open_recording(log)
    found = recording_findings(replace(recording, notes=(note,)))
    assert [f.text for f in found if f.topic == "recording"] == [f"T{note[1:]}."]
    apart = replace(recording, frame_t_ns=recording.frame_t_ns + 10**12)
    assert not [f for f in recording_findings(apart) if f.topic == "clock"]


@pytest.mark.parametrize("stops", [0, 1, 2])
def test_too_few_stops_are_wrong_and_it_is_said_how_many_are_needed(stops: int, tmp_path: Path) -> None:
    seen = drive(4)
    check = checked(replace(seen, stops=seen.stops[:stops]), tmp_path)
    assert check.worst is Level.REDO
    assert "at least 3 are needed" in texts(check, "drive")


def test_what_the_verdict_calls_useless_is_wrong(tmp_path: Path) -> None:
    seen = drive(14, slip=3e-2)
    check = checked(seen, tmp_path)
    missing = [f for f in check.findings if f.topic == "missing"]
    assert any(f.level is Level.REDO and "10 m" in f.text for f in missing), [f.line for f in check.findings]


def test_what_cannot_be_read_is_one_wrong_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.mcap").write_bytes(b"no recording")
    assert main([str(tmp_path / "bad.mcap")]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("wrong")
    assert b"nothing could be read" in timeline_bytes(check_log(tmp_path / "bad.mcap", TARGET))


def test_gaps_are_much_longer_than_usual_and_stops_are_listed_as_people_count() -> None:
    t = np.cumsum(np.full(100, 20_000_000))
    t[60:] += 1_000_000_000
    assert gaps(t) == ((int(t[59]), int(t[60])),)
    assert listed_stops([2]) == "stop 3"
    assert listed_stops([0, 3, 4]) == "stops 1, 4 and 5"
    assert listed_stops(range(12)).endswith("and 4 more")


@pytest.mark.parametrize(
    ("log_name", "words"),
    [
        ("moved", "box was pushed"),
        ("slippery", "slip all along"),
        ("face_low", "Sheet 1 sits"),
        ("print_xy", "printed at"),
    ],
)
def test_faults_of_path_traced_logs_are_named(shared_data: Path, log_name: str, words: str) -> None:
    check = check_log(shared_data / "rooms" / f"{log_name}.mcap", TARGET)
    assert check.worst is not Level.GOOD
    assert words in texts(check, "drive")
