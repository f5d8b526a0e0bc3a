"""Frames on the move: what they add, what their clock tells, and that they are left out where they would spoil."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import boxcal
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import one_time
from boxcal.calib.likelihood.moving.merge import with_moving_frames
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import Joint, joined, linearized
from boxcal.calib.likelihood.moving.weave import weave
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.calib.simulate.simulated_drive import SimulatedDrive
from boxcal.detect.correspondences import Correspondences, load_correspondences

FRAMES = 24


@cache
def _stops() -> SimulatedDrive:
    return boxcal.simulate(options=DriveOptions(stops=14, slip=1e-3), seed=4)


@cache
def _solved() -> tuple[Estimate, Fit]:
    """The estimate of the stops alone."""
    options = EstimateOptions(target=_stops().target, systematic_share=0.0)
    found = fit([_stops().correspondences], None, options)
    return reported(found, [_stops().correspondences], options), found


def _drive(shutter: ShutterOptions, seed: int = 1) -> Correspondences:
    """The drive with frames of a camera of some shutter and clock."""
    simulated, rng = _stops(), np.random.default_rng(seed)
    frames = moving_frames(simulated.robot, simulated.target, simulated.drive, shutter, rng)
    kept = np.sort(rng.permutation(len(frames))[:FRAMES])
    return replace(simulated.correspondences, moving=tuple(frames[k] for k in kept))


def _with(shutter: ShutterOptions, moving: Moving = Moving.AUTO) -> Estimate:
    alone, found = _solved()
    return with_moving_frames(alone, found, [_drive(shutter)], moving)


def _errors(found: Estimate) -> dict[str, float]:
    """Errors of wheels and camera position in standard deviations."""
    robot = _stops().robot
    off = found.T_body_cam[:3, 3] - robot.T_body_cam[:3, 3]
    errors = {"rR": found.rR - robot.rR, "rL": found.rL - robot.rL, "b": found.b - robot.b}
    errors |= dict(zip(("tx", "ty", "tz"), off.tolist(), strict=True))
    return {name: error / found.sigma[name] for name, error in errors.items()}


@pytest.mark.parametrize("late_s", [-0.08, 0.0, 0.08])
def test_frames_on_the_move_tell_the_clock_offset_and_where_the_camera_is(late_s: float) -> None:
    alone, found = _solved()[0], _with(ShutterOptions(late_s=late_s))
    value = dict(zip(found.names, found.values.tolist(), strict=True))
    assert abs(value["camera_late"] - late_s) < 3.5 * found.extra_sigma["camera_late"]
    assert found.extra_sigma["camera_late"] < 5e-4
    assert found.sigma["tx"] < 0.3 * alone.sigma["tx"]
    assert found.sigma["ty"] < 0.5 * alone.sigma["ty"]
    assert max(abs(z) for z in _errors(found).values()) < 3.5


def test_jitter_is_found_and_said_and_does_no_harm() -> None:
    found = _with(ShutterOptions(late_s=0.02, jitter_s=0.005))
    assert "jitter by" in found.notes[-1]
    assert max(abs(z) for z in _errors(found).values()) < 3.5


def test_frames_of_a_rolling_shutter_are_used_and_its_readout_time_is_told() -> None:
    simulated = boxcal.simulate(options=DriveOptions(stops=12, slip=2e-4), seed=11)
    options = EstimateOptions(target=simulated.target, systematic_share=0.0)
    solved = fit([simulated.correspondences], None, options)
    frames = moving_frames(
        simulated.robot, simulated.target, simulated.drive, ShutterOptions(readout_s=0.02), np.random.default_rng(2)
    )
    drive = replace(simulated.correspondences, moving=frames[::2])
    alone = reported(solved, [drive], options)
    found = with_moving_frames(alone, solved, [drive])
    value = dict(zip(found.names, found.values.tolist(), strict=True))
    assert "the shutter rolls: a frame takes 20.0" in found.notes[-1]
    assert abs(value["camera_readout"] - 0.02) < 3e-4
    assert found.sigma["tx"] < 0.5 * alone.sigma["tx"]
    off = found.T_body_cam[:3, 3] - simulated.robot.T_body_cam[:3, 3]
    assert abs(off[0]) < 3.5 * found.sigma["tx"]
    assert abs(off[1]) < 3.5 * found.sigma["ty"]
    assert abs(found.rR - simulated.robot.rR) < 3.5 * found.sigma["rR"]


def test_slip_while_a_frame_is_read_is_in_the_model_and_frames_are_used_all_the_same() -> None:
    alone, found = _solved()[0], _with(ShutterOptions(readout_s=0.02))
    assert "frames taken on the move were used" in found.notes[-1]
    assert "disagree" not in found.notes[-1]
    assert found.sigma["tx"] < 0.4 * alone.sigma["tx"]
    value = dict(zip(found.names, found.values.tolist(), strict=True))
    assert abs(value["camera_readout"] - 0.02) < 3.5 * found.extra_sigma["camera_readout"] < 1e-3
    assert max(abs(z) for z in _errors(found).values()) < 3.5


def test_frames_that_take_longer_than_the_course_is_told_for_are_left_out() -> None:
    alone, found = _solved()[0], _with(ShutterOptions(readout_s=0.07))
    assert "left out: the shutter rolls: a frame takes" in found.notes[-1]
    np.testing.assert_array_equal(found.cov_all, alone.cov_all)


def test_a_long_exposure_does_no_harm_and_is_told_by_motion_blur() -> None:
    found = _with(ShutterOptions(exposure_s=0.02))
    assert "were used" in found.notes[-1]
    said = re.search(r"the shutter is open for ([\d.]+) \+- ([\d.]+) ms", found.notes[-1])
    assert said is not None
    assert abs(float(said[1]) - 20) < 4 * float(said[2]) + 0.05 < 4
    assert max(abs(z) for z in _errors(found).values()) < 3.5


def test_frames_late_by_more_than_a_leg_are_left_out_and_the_stops_stay_the_answer() -> None:
    alone, found = _solved()[0], _with(ShutterOptions(late_s=7.0))
    assert f"{FRAMES} frames taken on the move were left out" in found.notes[-1]
    np.testing.assert_array_equal(found.cov_all, alone.cov_all)
    np.testing.assert_array_equal(found.T_body_cam, alone.T_body_cam)


def test_a_drive_whose_frames_must_be_used_and_cannot_is_refused() -> None:
    with pytest.raises(CalibError, match="frames on the move cannot be used"):
        _with(ShutterOptions(late_s=7.0), Moving.ON)
    with pytest.raises(CalibError, match="0 frames on the move cannot be used"):
        with_moving_frames(*_solved(), [_stops().correspondences], Moving.ON)


def test_one_frame_of_another_time_is_left_out_and_the_others_used() -> None:
    drive = _drive(ShutterOptions())
    moving = list(drive.moving)
    moving[9] = replace(moving[9], t_ns=moving[9].t_ns + 60_000_000)
    found = with_moving_frames(*_solved(), [replace(drive, moving=tuple(moving))])
    assert "(1 more, which contradicts them, left out)" in found.notes[-1]
    assert max(abs(z) for z in _errors(found).values()) < 3.5


@pytest.mark.parametrize("jump_ms", [5, 20, 60, 150])
def test_a_clock_that_jumps_is_said_and_the_frames_on_its_longer_side_are_used(jump_ms: int) -> None:
    alone, found = _solved()[0], _with(ShutterOptions(late_s=0.01, clock_jump_s=jump_ms / 1e3))
    said = re.search(r"the camera's clock jumps by (\d+) ms against the wheels'.*side (\d+) frames", found.notes[-1])
    assert said is not None
    assert abs(int(said[1]) - jump_ms) <= 1 + 0.15 * jump_ms
    assert 3 <= int(said[2]) <= FRAMES / 2
    assert "jitter" not in found.notes[-1]
    assert "ppm" not in found.notes[-1]
    assert found.sigma["tx"] < 0.5 * alone.sigma["tx"]
    assert max(abs(z) for z in _errors(found).values()) < 3.5


def test_without_frames_on_the_move_nothing_changes() -> None:
    drive = _drive(ShutterOptions())
    off = boxcal.calibrate(drive, settings=Settings(report=False, moving=Moving.OFF))
    none = boxcal.calibrate(_stops().correspondences, settings=Settings(report=False))
    assert off.wheels == none.wheels
    np.testing.assert_array_equal(off.T_body_cam, none.T_body_cam)
    assert off.detail is not None
    assert none.detail is not None
    np.testing.assert_array_equal(off.detail.covariance.matrix, none.detail.covariance.matrix)


def test_frames_split_the_way_of_the_wheels_and_lose_none_of_it() -> None:
    drive = _drive(ShutterOptions(late_s=0.03))
    woven = weave(drive, np.arange(len(drive.stops)), np.arange(FRAMES), 0.03)
    assert len(woven.moving) >= FRAMES - 4
    inner = woven.drives[0]
    parts = [inner.leg(i) for i in range(len(woven.frame) - 1)]
    way = np.array([np.abs(np.diff(phi)).sum() for phi, _ in parts])
    leg = np.cumsum(woven.frame < 0)[:-1] - 1
    whole = [np.abs(np.diff(drive.leg(i)[0])).sum() for i in range(len(drive.stops) - 1)]
    np.testing.assert_allclose(np.bincount(leg, way), whole, rtol=0, atol=1e-9)


def _joint() -> Joint:
    noise = FrameNoise(slip=1e-3, jitter_s=1e-3, sway=1.0, scale=1.0)
    drive = _drive(ShutterOptions())
    return joined(_solved()[1], [drive], np.arange(FRAMES), one_time(1), noise)


@pytest.mark.parametrize(
    ("unknown", "step"), [("camera_late", 2e-4), ("camera_clock_rate", 2e-6), ("camera_readout", 2e-4)]
)
def test_derivatives_by_clock_and_readout_are_those_of_central_differences(unknown: str, step: float) -> None:
    joint = _joint()
    column = joint.problem.names.index(unknown)
    k = column - joint.problem.explained.start
    ends = []
    for sign in (-1, 1):
        explained = joint.state.explained.copy()
        explained[k] += sign * step
        ends.append(linearized(joint, replace(joint.state, explained=explained)))
    corners = -(ends[1].corners.residual - ends[0].corners.residual) / (2 * step)
    legs = -(ends[1].legs.residual - ends[0].legs.residual) / (2 * step)
    at = joint.at
    by_corner = at.corners.jacobian @ at.corners.J_shared[at.corners.group][:, :, column][:, :, None]
    np.testing.assert_allclose(corners, by_corner[:, :, 0], rtol=2e-3, atol=2e-3 * np.abs(by_corner).max() + 1e-9)
    np.testing.assert_allclose(legs, at.legs.J_explained[:, :, k], rtol=0, atol=1e-3 * max(1, np.abs(legs).max()))


def test_frames_are_saved_and_read_back_and_files_without_them_are_read(tmp_path: object) -> None:
    drive = _drive(ShutterOptions())
    path = f"{tmp_path}/drive.npz"
    drive.save(path)
    again = load_correspondences(path)
    assert [f.t_ns for f in again.moving] == [f.t_ns for f in drive.moving]
    np.testing.assert_array_equal(again.moving[3].uv_px, drive.moving[3].uv_px)
    np.testing.assert_array_equal(again.moving[3].cov_px2, drive.moving[3].cov_px2)
    np.testing.assert_array_equal(again.moving[3].blur_px2, drive.moving[3].blur_px2)
    replace(drive, moving=()).save(path)
    assert load_correspondences(path).moving == ()
