"""Frames between stops: which are looked at, and what is measured in them."""

from pathlib import Path

import numpy as np

import boxcal
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.detect.extract import ExtractSettings, extract
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.stops import Stop
from boxcal.detect.tags.on_the_move import Candidates, Choice, budget, candidates
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
    among = Candidates(frames=np.arange(n), side=2 * np.arange(n), turn=turn, way=np.full(n, 0.5), rate=np.full(n, 3.0))
    choice, looked = Choice(among=among), list[int]()
    for _ in range(12):
        at = choice.next()
        assert at is not None
        looked.append(at)
        choice.learn(at, shown=bool(turn[at] < 0.5))
    assert np.mean(turn[looked[-5:]] < 0.5) == 1
    assert len(set(looked)) == len(looked)


def test_a_drive_without_frames_between_stops_has_no_candidate() -> None:
    none = Candidates(
        frames=np.zeros(0, dtype=np.int64),
        side=np.zeros(0, dtype=np.int64),
        turn=np.zeros(0),
        way=np.zeros(0),
        rate=np.zeros(0),
    )
    assert Choice(among=none).next() is None
