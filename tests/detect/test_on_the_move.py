"""Frames between stops: which are looked at, and what is measured in them."""

from pathlib import Path

import numpy as np
import pytest

import boxcal
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import ExtractSettings, extract
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.stops import Stop
from boxcal.detect.tags.on_the_move import (
    LEAST_WITHOUT_STOPS,
    MOST_WITHOUT_STOPS,
    Candidates,
    Choice,
    budget,
    candidates,
    spread_frames,
)
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import project


def test_frames_between_stops_are_measured_where_the_box_is_in_view(tmp_path: Path) -> None:
    simulated = boxcal.simulate(options=DriveOptions(stops=4), seed=3)
    robot, target, drive = simulated.robot, simulated.target, simulated.drive
    options = RecordOptions(moving_frames=8, exposure_s=1e-4)
    write_log(tmp_path / "r.mcap", robot, target, drive, options, rng=np.random.default_rng(1))
    found = extract(tmp_path / "r.mcap", target)
    assert 2 <= len(found.moving) <= budget(3)
    for frame in found.moving:
        T_cam_box = inverse(drive.T_box_cam_at(np.array([frame.t_ns]), 0)[0])
        uv = project(robot.camera, frame.p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        assert np.sqrt(np.mean((frame.uv_px - uv) ** 2)) < 0.5
        assert all(not s.t_start_ns <= frame.t_ns <= s.t_end_ns for s in found.stops)
    none = extract(tmp_path / "r.mcap", target, settings=ExtractSettings(moving=False))
    assert none.moving == ()
    for a, b in zip(found.stops, none.stops, strict=True):
        np.testing.assert_array_equal(a.uv_px, b.uv_px)
        np.testing.assert_array_equal(a.cov_px2, b.cov_px2)


def _stop(first: int, last: int, phi: float) -> Stop:
    at = (first * 10**8, last * 10**8)
    return Stop(t_start_ns=at[0], t_end_ns=at[1], first_sample=first, last_sample=last, phi_R=phi, phi_L=phi)


def test_only_frames_on_known_way_at_which_the_wheels_turn_are_candidates() -> None:
    phi = np.concatenate([np.zeros(10), np.linspace(0, 5, 20), np.full(10, 5.0), np.linspace(5, 9, 20), np.full(10, 9)])
    covered = np.ones(70, dtype=np.bool_)
    covered[45] = False
    wheels = WheelSamples(t_ns=np.arange(70) * 10**8, phi_R=phi, phi_L=phi, covered=covered)
    stops = [_stop(0, 9, 0.0), _stop(30, 39, 5.0), _stop(60, 69, 9.0)]
    frames = np.arange(0, 70, 2) * 10**8 + 3 * 10**7
    found = candidates(wheels, stops, stops, frames)
    assert set(found.frames.tolist()) == {k for k, t in enumerate(frames) if 10**9 - 10**8 < t < 3 * 10**9 - 5 * 10**7}
    assert np.all(found.turn == 0)
    nearer_before = found.side % 2 == 0
    assert np.all(frames[found.frames[nearer_before]] < 2 * 10**9)


def test_what_turns_keep_the_box_in_view_is_learned() -> None:
    n = 40
    turn = np.where(np.arange(n) % 2, 0.7, 0.3)
    among = Candidates(
        frames=np.arange(n), side=2 * np.arange(n), turn=turn, path=np.full(n, 0.5), rate=np.full(n, 3.0)
    )
    choice, looked = Choice(among=among), list[int]()
    for _ in range(12):
        at = choice.next()
        assert at is not None
        looked.append(at)
        choice.learn(at, shown=bool(turn[at] < 0.5))
    assert np.mean(turn[looked[-5:]] < 0.5) == 1
    assert len(set(looked)) == len(looked)


def test_a_few_frames_are_looked_at_where_none_is_predicted_to_show_the_box() -> None:
    n = 40
    same = np.full(n, 0.4)
    among = Candidates(frames=np.arange(n), side=2 * np.arange(n), turn=same, path=same, rate=same)
    looked = {}
    for shown in (False, True):
        choice, looked[shown] = Choice(among=among, in_view=lambda rows: np.zeros(len(rows), dtype=bool)), 0
        while (at := choice.next()) is not None and looked[shown] < 20:
            looked[shown] += 1
            choice.learn(at, shown=shown)
    assert 0 < looked[False] < 10
    assert looked[True] == 20
    in_view = np.arange(n) == 7
    choice = Choice(among=among, in_view=lambda rows: in_view[rows])
    assert choice.next() == 7
    choice.learn(7, shown=False)
    assert choice.next() is None


def test_a_drive_without_frames_between_stops_has_no_candidate() -> None:
    none = Candidates(
        frames=np.zeros(0, dtype=np.int64),
        side=np.zeros(0, dtype=np.int64),
        turn=np.zeros(0),
        path=np.zeros(0),
        rate=np.zeros(0),
    )
    assert Choice(among=none).next() is None


def test_a_robot_that_never_stood_still_gives_frames_spread_over_its_drive(tmp_path: Path) -> None:
    simulated = boxcal.simulate(options=DriveOptions(stops=5, stand_s=(0.1, 0.15)), seed=3)
    robot, target, drive = simulated.robot, simulated.target, simulated.drive
    options = RecordOptions(moving_frames=16, exposure_s=1e-4)
    write_log(tmp_path / "r.mcap", robot, target, drive, options, rng=np.random.default_rng(1))
    found = extract(tmp_path / "r.mcap", target)
    assert found.stops == ()
    assert LEAST_WITHOUT_STOPS <= len(found.moving) <= MOST_WITHOUT_STOPS
    for frame in found.moving:
        at = drive.stop_at(frame.t_ns)
        T_cam_box = inverse(drive.T_box_cam_at(np.array([frame.t_ns]), at)[0])
        uv = project(robot.camera, frame.p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        assert np.sqrt(np.mean((frame.uv_px - uv) ** 2)) < 0.5
    with pytest.raises(DetectError, match="let the robot stand still for two seconds"):
        extract(tmp_path / "r.mcap", target, settings=ExtractSettings(moving=False))


def test_frames_are_spread_by_the_travel_of_the_wheels() -> None:
    phi = np.concatenate([np.linspace(0, 8, 50), np.full(100, 8.0), np.linspace(8, 16, 50)])
    wheels = WheelSamples(t_ns=np.arange(200) * 10**8, phi_R=phi, phi_L=phi)
    frames = np.arange(5, 195) * 10**8
    rows = spread_frames(wheels, frames)
    assert len(set(rows.tolist())) == len(rows)
    first = np.sort(np.interp(frames[rows[:7]], wheels.t_ns, phi))
    np.testing.assert_allclose(first, np.arange(2, 15, 2), atol=0.2)
    assert len(spread_frames(replace_angles(wheels, np.zeros(200)), frames)) == 0


def replace_angles(wheels: WheelSamples, phi: Array) -> WheelSamples:
    """Return samples of wheels at other angles."""
    return WheelSamples(t_ns=wheels.t_ns, phi_R=phi, phi_L=phi)
