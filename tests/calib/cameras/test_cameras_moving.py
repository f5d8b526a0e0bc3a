"""Frames on the move of several cameras: one path of the wheels, a clock for each camera."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.likelihood.cameras.equations import About, about
from boxcal.calib.likelihood.cameras.estimates import Cameras, solve_cameras
from boxcal.calib.likelihood.cameras.moving import merge
from boxcal.calib.likelihood.cameras.moving.joint import AllMoving, SettledAll, settled_together
from boxcal.calib.likelihood.cameras.moving.merge import with_frames_of_all
from boxcal.calib.likelihood.cameras.moving.row import MovingRow, Seen, clocks_of, moving_row
from boxcal.calib.likelihood.cameras.state import stepped
from boxcal.calib.likelihood.moving.clock import LATE, Clocks
from boxcal.calib.likelihood.moving.faults import sound
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.simulate.more_cameras import seen_by
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from tests.calib.cameras.conftest import SIGMA_PX, Rigged

LATE_S = (0.03, -0.02)


def with_frames(rigged: Rigged, late_s: Sequence[float] = LATE_S, jitter_s: float = 2e-4) -> list[Correspondences]:
    """What each camera saw, frames on the move at one moment for both among it."""
    rng, target = np.random.default_rng(8), make_target()
    drives = (rigged.drive, seen_by(rigged.drive, *rigged.robots))
    return [
        replace(view, moving=moving_frames(robot, target, drive, shutter, rng))
        for view, robot, drive, shutter in zip(
            rigged.views,
            rigged.robots,
            drives,
            [ShutterOptions(late_s=t, jitter_s=jitter_s, sigma_px=SIGMA_PX, period_s=0.4) for t in late_s],
            strict=True,
        )
    ]


def of_stops(rigged: Rigged) -> Cameras:
    return solve_cameras(rigged.found, rigged.fits, [[view] for view in rigged.views])


def seen_of(rigged: Rigged, drives: Sequence[Correspondences]) -> list[Seen]:
    seen = []
    for fit, drive in zip(rigged.fits, drives, strict=True):
        noise = FrameNoise(slip=fit.components.slip, jitter_s=1e-3, sway=1.0, scale=1.0)
        seen.append(
            Seen(fit=fit, drive=drive, settled=sound(fit, [drive], np.arange(len(drive.moving)), noise).settled)
        )
    return seen


def joined(rigged: Rigged, drives: Sequence[Correspondences]) -> SettledAll:
    stops = of_stops(rigged)
    assert stops.fit is not None
    found = settled_together(stops.fit, stops.drives[0], seen_of(rigged, drives))
    assert found is not None
    return found


def test_frames_stay_chosen_while_the_clocks_are_moved(stereo: Rigged) -> None:
    """Chosen anew, frames at one moment would change places with each step, and the solver never come to rest."""
    stops, seen = of_stops(stereo), seen_of(stereo, with_frames(stereo, late_s=(0.0, 0.0), jitter_s=1e-3))
    assert stops.fit is not None
    clocks = clocks_of(seen)
    first = moving_row(stops.fit, stops.drives[0], seen, clocks)
    later = clocks.plus(np.array([2e-3, -2e-3]), np.zeros(2))

    def chosen(row: MovingRow) -> set[tuple[int, int]]:
        return {(c, k) for c, k in zip(row.camera.tolist(), row.number.tolist(), strict=True) if c >= 0}

    assert chosen(moving_row(stops.fit, stops.drives[0], seen, later)) != chosen(first)
    assert chosen(moving_row(stops.fit, stops.drives[0], seen, later, first)) == chosen(first)


def test_of_frames_at_one_moment_stamps_do_not_tell_which_is_used(stereo: Rigged) -> None:
    """The earlier of two stamps that jitter is early: chosen for that, clocks came out a standard deviation early."""
    drives = with_frames(stereo, late_s=(0.0, 0.0), jitter_s=1e-3)
    stops, seen = of_stops(stereo), seen_of(stereo, drives)
    assert stops.fit is not None
    agreeing = Clocks(late_s=np.zeros(2), rate=np.zeros(2))
    row = moving_row(stops.fit, stops.drives[0], seen, agreeing)
    used = {(c, k) for c, k in zip(row.camera.tolist(), row.number.tolist(), strict=True) if c >= 0}
    t_ns = [np.array([frame.t_ns for frame in drive.moving]) for drive in drives]
    earlier = []
    for c, k in used:
        apart = t_ns[c][k] - t_ns[1 - c]
        twin = int(np.argmin(np.abs(apart)))
        if abs(apart[twin]) < 5e6 and (1 - c, twin) not in used:
            earlier.append(apart[twin] < 0)
    assert len(earlier) > 20
    assert abs(np.mean(earlier) - 0.5) < 0.2


@pytest.mark.parametrize("which", ["front_and_rear", "stereo"])
def test_frames_of_both_cameras_make_wheels_and_cameras_surer_and_find_both_clocks(
    which: str, request: pytest.FixtureRequest
) -> None:
    rigged: Rigged = request.getfixturevalue(which)
    drives = with_frames(rigged)
    alone = [(e, f, [d]) for e, f, d in zip(rigged.found, rigged.fits, drives, strict=True)]
    before = of_stops(rigged)
    after = with_frames_of_all(before, alone)
    for robot, old, new, late_s in zip(rigged.robots, before.estimates, after.estimates, LATE_S, strict=True):
        at = new.names.index(LATE)
        assert abs(new.values[at] - late_s) < 4 * np.sqrt(new.cov_all[at, at])
        sigma, earlier = np.sqrt(np.diag(new.cov)), np.sqrt(np.diag(old.cov))
        assert np.all(sigma[5:8] < 0.8 * earlier[5:8])
        assert np.all(sigma[11:13] < 0.6 * earlier[11:13])
        error = np.array([new.rR - robot.rR, new.rL - robot.rL, new.b - robot.b])
        error = np.concatenate([error, new.T_body_cam[:3, 3] - robot.T_body_cam[:3, 3]])
        assert np.all(np.abs(error) < 4 * sigma[[5, 6, 7, 11, 12, 13]])
        assert np.linalg.eigvalsh(new.cov / np.outer(sigma, sigma))[0] > 0
    assert np.all(np.diag(after.mountings) < np.diag(before.mountings))
    assert len([note for note in after.notes if "taken on the move by camera" in note]) == 2


def test_covariance_stays_one_where_stops_of_a_camera_disagree(front_and_rear: Rigged) -> None:
    drives = with_frames(front_and_rear)
    first, second = front_and_rear.found
    ratio = first.jackknife.ratio.copy()
    ratio[11] = 6.0 + first.jackknife.limit
    doubtful = replace(first, jackknife=replace(first.jackknife, ratio=ratio, unexplained=True))
    found = [doubtful, second]
    before = solve_cameras(found, front_and_rear.fits, [[view] for view in front_and_rear.views])
    alone = [(e, f, [d]) for e, f, d in zip(found, front_and_rear.fits, drives, strict=True)]
    after = with_frames_of_all(before, alone)
    assert any("camera 1 has none that can be used (the stops do not agree" in note for note in after.notes)
    for e in after.estimates:
        sigma = np.sqrt(np.diag(e.cov))
        assert np.linalg.eigvalsh(e.cov / np.outer(sigma, sigma))[0] > 0
    scale = np.sqrt(np.diag(after.mountings))
    assert np.linalg.eigvalsh(after.mountings / np.outer(scale, scale))[0] > 0


def test_of_frames_at_one_moment_each_camera_gives_as_many(stereo: Rigged) -> None:
    row = joined(stereo, with_frames(stereo, late_s=(0.0, 0.0), jitter_s=0.0)).joint.row
    counts = [int(np.sum(row.camera == c)) for c in (0, 1)]
    assert abs(counts[0] - counts[1]) <= 4
    assert min(counts) > 5
    starts = [stop.t_start_ns for stop in row.woven.drives[0].stops]
    assert np.diff(starts).min() > 4e6


def test_derivatives_by_clock_and_readout_of_each_camera_are_those_of_the_residuals(front_and_rear: Rigged) -> None:
    joint = joined(front_and_rear, with_frames(front_and_rear)).joint
    robot = joint.row.robot
    names, first = robot.problem.names, robot.problem.explained.start
    own = ("camera_late", "camera_clock_rate", "camera_readout")
    for name in (*own, *(f"camera2-{name}" for name in own)):
        k = names.index(name)
        plus, minus = (_moved(joint, k, h) for h in (1e-5, -1e-5))
        legs = (plus.at.legs.residual - minus.at.legs.residual) / 2e-5
        assert np.allclose(-legs, joint.here.at.legs.J_explained[:, :, k - first], atol=1e-6 * (1 + np.abs(legs).max()))
        for c, part in enumerate(robot.parts):
            seen = (plus.cameras[c].corners.residual - minus.cameras[c].corners.residual) / 2e-5
            corners = joint.here.cameras[c].corners
            columns = corners.jacobian @ corners.J_shared[corners.group][:, :, k][:, :, None]
            assert np.allclose(-seen, columns[:, :, 0], atol=1e-5 * (1 + np.abs(seen).max())), (name, c)
            assert np.any(seen != 0) == (name == ("camera_readout", "camera2-camera_readout")[c])
            assert len(part.places) == len(np.unique(part.places))


def test_frames_stamped_at_random_are_left_out_and_said(front_and_rear: Rigged) -> None:
    drives = with_frames(front_and_rear)
    rng = np.random.default_rng(3)
    order = rng.permutation(len(drives[1].moving))
    mixed = [
        replace(frame, t_ns=drives[1].moving[k].t_ns) for frame, k in zip(drives[1].moving, np.sort(order), strict=True)
    ]
    shuffled = tuple(replace(mixed[k], t_ns=mixed[j].t_ns) for j, k in enumerate(order))
    drives[1] = replace(drives[1], moving=shuffled)
    alone = [(e, f, [d]) for e, f, d in zip(front_and_rear.found, front_and_rear.fits, drives, strict=True)]
    after = with_frames_of_all(of_stops(front_and_rear), alone)
    assert any("camera 2 has none that can be used" in note for note in after.notes)
    assert any("taken on the move by camera 1" in note for note in after.notes)
    assert LATE not in after.estimates[1].names


def _moved(joint: AllMoving, k: int, h: float) -> About:
    d: Array = np.zeros(len(joint.row.robot.problem.names))
    d[k] = h
    P = len(joint.row.woven.frame)
    nothing = np.zeros((P, joint.sigma.shape[1]))
    state = stepped(joint.row.robot, joint.state, d, np.zeros((P, 5)), nothing)
    return about(joint.row.robot, state, joint.levels.scales)


def test_equations_without_a_solution_leave_a_cameras_frames_out(
    front_and_rear: Rigged, monkeypatch: pytest.MonkeyPatch
) -> None:
    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(merge, "leave_out", singular)
    drives = with_frames(front_and_rear)
    alone = [(e, f, [d]) for e, f, d in zip(front_and_rear.found, front_and_rear.fits, drives, strict=True)]
    before = of_stops(front_and_rear)
    after = with_frames_of_all(before, alone)
    assert [e.b for e in after.estimates] == [e.b for e in before.estimates]
    assert "wheels and pictures do not fit there" in " ".join(after.notes)
