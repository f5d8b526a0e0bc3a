"""Clocks that are off, drift or jump, and long exposures, from log to result: right, or said in one line."""

import re
import weakref
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

import boxcal
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Settings
from boxcal.detect.log.clocks import without_jumps, without_own_jumps
from boxcal.detect.log.frames import FrameSource
from boxcal.detect.tags.on_the_move import TRIED, budget
from tests.calib.clocks.logs import TARGET, driven, worst, write

SECOND = 1_000_000_000


def _calibrated(tmp_path: Path, **options: float) -> Calibration:
    return boxcal.calibrate(write(tmp_path / "r.mcap", **options), TARGET, settings=Settings(report=False))


def _said(found: Calibration, words: str) -> str:
    said = [note for note in found.notes if words in note]
    assert len(said) == 1, found.notes
    return said[0]


def test_frames_late_by_more_than_a_leg_are_put_right_by_the_times_of_recording(tmp_path: Path) -> None:
    found = _calibrated(tmp_path, late_s=8.0)
    assert "camera's clock is 8.0 s ahead" in _said(found, "times of recording")
    assert "frames taken on the move were used" in _said(found, "on the move")
    assert worst(found) < 3.5


@pytest.mark.parametrize("later_s", [5.0, -1.0])
def test_a_clock_that_is_set_half_way_is_put_right_by_the_times_of_recording(tmp_path: Path, later_s: float) -> None:
    found = _calibrated(tmp_path, clock_jump_s=later_s)
    assert f"camera's clock jumps by {later_s:+.1f} s" in _said(found, "times of recording")
    assert "frames taken on the move were used" in _said(found, "on the move")
    assert worst(found) < 3.5


def test_a_small_jump_of_the_clock_is_found_by_the_frames_themselves(tmp_path: Path) -> None:
    found = _calibrated(tmp_path, clock_jump_s=0.06)
    said = _said(found, "on the move")
    assert re.search(r"frames taken on the move were used.*the camera's clock jumps by (5[89]|6[0-2]) ms against", said)
    assert worst(found) < 3.5


@pytest.mark.parametrize("later_s", [3.0, -1.0])
def test_a_clock_of_the_wheels_that_is_set_half_way_is_put_right_by_the_times_of_recording(
    tmp_path: Path, later_s: float
) -> None:
    found = _calibrated(tmp_path, wheels_jump_s=later_s)
    assert f"the wheels' clock (/joint_states) jumps by {later_s:+.1f} s" in _said(found, "times of recording")
    assert "frames taken on the move were used" in _said(found, "on the move")
    assert worst(found) < 3.5


@pytest.mark.parametrize("later_ms", [50, -300])
def test_a_small_jump_of_the_wheels_clock_is_told_as_one_of_the_camera_against_it(
    tmp_path: Path, later_ms: int
) -> None:
    found = _calibrated(tmp_path, wheels_jump_s=later_ms / 1e3)
    said = re.search(r"the camera's clock jumps by (\d+) ms against the wheels'", _said(found, "on the move"))
    assert said is not None
    assert abs(int(said[1]) - abs(later_ms)) <= 5
    assert worst(found) < 3.5


def test_both_clocks_set_half_way_are_put_right_together(tmp_path: Path) -> None:
    found = _calibrated(tmp_path, wheels_jump_s=3.0, clock_jump_s=3.0)
    assert len([note for note in found.notes if "jumps by +3.0 s" in note]) == 2
    assert "frames taken on the move were used" in _said(found, "on the move")
    assert worst(found) < 3.5


def test_a_clock_that_runs_fast_is_told_its_rate(tmp_path: Path) -> None:
    found = _calibrated(tmp_path, clock_rate=5e-4, late_s=0.02)
    assert found.detail is not None
    rate, sigma = (values["camera_clock_rate"] for values in (found.detail.extra, found.detail.extra_sigma))
    assert abs(rate - 5e-4) < 3.5 * sigma < 3e-4
    assert "ppm fast" in _said(found, "on the move")
    assert worst(found) < 3.5


def test_frames_on_the_move_know_their_motion_blur(tmp_path: Path) -> None:
    seen = boxcal.extract(write(tmp_path / "r.mcap", exposure_s=0.013), TARGET)
    assert len(seen.moving) >= 4
    spread = [np.linalg.eigvalsh(frame.blur_px2) for frame in seen.moving]
    assert min(low for low, _ in spread) > 0.1
    assert max(high / low for low, high in spread) > 1.5


def test_how_many_frames_are_decoded_and_kept_does_not_grow_with_the_rate_of_the_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, decoded, kept = FrameSource.decoded, list[weakref.ref[object]](), list[int]()

    def counted(source: FrameSource, numbers: Iterable[int]) -> Iterator[tuple[int, object]]:
        for number, image in read(source, numbers):
            decoded.append(weakref.ref(image))
            kept.append(sum(frame() is not None for frame in decoded))
            yield number, image

    monkeypatch.setattr(FrameSource, "decoded", counted)
    stops = len(driven().drive.stop_t_ns)
    most = TRIED * budget(stops - 1)
    counts, at_once = [], []
    for moving_frames in (8, 24):
        decoded.clear()
        kept.clear()
        path = write(tmp_path / "r.mcap", moving_frames=moving_frames)
        assert worst(boxcal.calibrate(path, TARGET, settings=Settings(report=False))) < 3.5
        counts.append(len(decoded))
        at_once.append(max(kept))
    assert min(counts) >= 2 * stops
    assert max(counts) <= 2 * stops + most
    assert counts[1] - counts[0] <= most
    assert max(at_once) <= 3


def test_jumps_are_taken_out_unless_the_recorder_s_own_clock_jumps() -> None:
    rng = np.random.default_rng(0)
    log_ns = (np.arange(60) * 0.3 * SECOND + rng.exponential(2e6, 60)).astype(np.int64)
    stamps = log_ns - 30_000_000
    wheels = log_ns - 2_000_000
    set_twice = stamps + np.where(np.arange(60) >= 20, 3 * SECOND, 0) - np.where(np.arange(60) >= 45, SECOND, 0)
    right, jumps = without_jumps(set_twice, log_ns, (wheels, log_ns))
    assert [round(jump.later_s, 1) for jump in jumps] == [3.0, -1.0]
    assert np.ptp(right - stamps) < 1_000_000
    late = np.where(np.arange(60) >= 20, 3 * SECOND, 0)
    same, none = without_jumps(stamps + late, log_ns, (wheels + late, log_ns))
    np.testing.assert_array_equal(same, stamps + late)
    assert none == ()
    held_up = log_ns + np.where(np.arange(60) // 10 == 3, (10 - np.arange(60) % 10) * SECOND // 5, 0)
    kept, none = without_jumps(stamps, held_up, (wheels, log_ns))
    np.testing.assert_array_equal(kept, stamps)
    assert none == ()


def test_jumps_of_the_wheels_are_their_clock_s_where_the_recorder_goes_on_as_usual() -> None:
    rng = np.random.default_rng(0)
    log_ns = (np.arange(600) * 0.02 * SECOND).astype(np.int64)
    stamps = log_ns - 2_000_000 - (rng.exponential(2e5, 600)).astype(np.int64)
    back = stamps - np.where(np.arange(600) >= 200, 2 * SECOND, 0) + np.where(np.arange(600) >= 450, 7 * SECOND, 0)
    right, jumps = without_own_jumps(back, log_ns)
    assert [round(jump.later_s, 1) for jump in jumps] == [-2.0, 7.0]
    assert np.ptp(right - stamps) < 2_000_000
    recorder = log_ns + np.where(np.arange(600) >= 300, SECOND, 0)
    for kept, log in ((stamps, recorder), (stamps, log_ns), (back, recorder)):
        same, none = without_own_jumps(kept, log)
        np.testing.assert_array_equal(same, kept)
        assert none == ()
