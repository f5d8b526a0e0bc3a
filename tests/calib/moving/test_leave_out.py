"""Frames on the move left out leg by leg: changes are those of solving again, and disagreement is found."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import boxcal
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.faults import sound
from boxcal.calib.likelihood.moving.grid import Axis
from boxcal.calib.likelihood.moving.leave_out import LeaveOut, leave_out, leg_of_places
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import linearized, solved
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.detect.correspondences import Correspondences


@cache
def _stops(readout_s: float = 0.0) -> tuple[Correspondences, Fit]:
    """A drive with its frames of an ideal camera but for its shutter, and the solution of its stops."""
    simulated = boxcal.simulate(options=DriveOptions(stops=12, slip=3e-4), seed=11)
    shutter = ShutterOptions(readout_s=readout_s)
    frames = moving_frames(simulated.robot, simulated.target, simulated.drive, shutter, np.random.default_rng(2))
    options = EstimateOptions(target=simulated.target, systematic_share=0.0)
    drive = replace(simulated.correspondences, moving=frames[::2])
    return drive, fit([drive], None, options)


def _settled(drive: Correspondences) -> Settled:
    noise = FrameNoise(slip=3e-4, jitter_s=1e-3, sway=1.0, scale=1.0)
    found = sound(_stops()[1], [drive], np.arange(len(drive.moving)), noise).settled
    assert found is not None
    return found


@cache
def _left_out(readout_s: float = 0.0) -> tuple[Settled, LeaveOut]:
    found = _settled(_stops(readout_s)[0])
    return found, leave_out(_stops()[1], found)


@pytest.mark.parametrize("readout_s", [0.0, 0.02])
@pytest.mark.parametrize("wheels", [False, True])
def test_a_leg_left_out_changes_the_answer_as_solving_without_it_does(wheels: bool, readout_s: float) -> None:
    (found, among), solution = _left_out(readout_s), _stops()[1]
    joint, place = found.joint, leg_of_places(found.joint.woven)
    level = (np.array([found.levels.slip[found.best]]), np.array([found.levels.jitter_s[found.best]]))
    leg = int(np.bincount(place[joint.woven.moving]).argmax())
    corners, legs = joint.weights.corners.copy(), joint.weights.legs.copy()
    if wheels:
        legs[place[joint.problem.leg_stop] == leg] = 0
    else:
        frames = joint.woven.moving[place[joint.woven.moving] == leg]
        corners[np.isin(joint.problem.corner_stop, frames)] = 0
    less = replace(joint, weights=replace(joint.weights, corners=corners, legs=legs))
    less = replace(less, at=linearized(less, joint.state))
    whole, part = (solved(solution, j, found.noise, *level).solution for j in (joint, less))
    legs_with_frames = np.unique(place[joint.woven.moving]).tolist()
    row = len(legs_with_frames) + leg if wheels else legs_with_frames.index(leg)
    change = part.d_shared[0] - whole.d_shared[0]
    change[11:14] = joint.state.T_body_cam[:3, :3] @ change[11:14]
    sigma = np.sqrt(np.diag(whole.cov[0]))
    off = (among.changes[row] - change) / sigma
    np.testing.assert_allclose(off, 0, atol=1e-4)  # what is taken off again cancels, and hangs on rounding


def test_frames_as_the_model_has_them_enlarge_no_sigma() -> None:
    among = _left_out()[1]
    np.testing.assert_array_equal(among.inflation, 1.0)
    assert 0.3 < np.median(among.ratio[5:14]) < 3


def test_frames_whose_corners_err_alike_within_a_leg_enlarge_the_sigmas() -> None:
    drive, solution = _stops()
    leg = np.searchsorted([stop.t_end_ns for stop in drive.stops], [frame.t_ns for frame in drive.moving])
    shift = np.random.default_rng(3).choice([-0.5, 0.5], size=(len(drive.stops) + 1, 2))
    moving = tuple(
        replace(frame, uv_px=frame.uv_px + shift[k]) for frame, k in zip(drive.moving, leg.tolist(), strict=True)
    )
    among = leave_out(solution, _settled(replace(drive, moving=moving)))
    assert among.inflation[:14].max() > 2
    cov = np.diag(np.arange(1.0, len(among.ratio) + 1))
    enlarged = among.enlarged(cov)
    np.testing.assert_allclose(np.diag(enlarged)[:11], (np.diag(cov) * among.inflation**2)[:11], rtol=1e-12)
    assert np.all(np.linalg.eigvalsh(enlarged - cov) > -1e-9 * enlarged.max())


def test_a_grid_whose_end_is_probable_does_not_reach_far_enough() -> None:
    axis = Axis(quiet=1e-4, least=1e-6, coarse=np.geomspace(1e-5, 1e-1, 9), fine=5)
    levels = np.geomspace(1e-3, 1e-2, 5)
    assert axis.covers(levels, np.array([0.001, 0.2, 0.5, 0.2, 0.001]))
    assert not axis.covers(levels, np.array([0.5, 0.2, 0.1, 0.0, 0.0]))
    assert not axis.covers(levels, np.array([0.0, 0.0, 0.1, 0.2, 0.5]))
    assert axis.covers(np.geomspace(1e-5, 1e-3, 5), np.array([0.5, 0.2, 0.1, 0.0, 0.0]))
