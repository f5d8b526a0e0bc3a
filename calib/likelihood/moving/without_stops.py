"""Calibration from frames on the move alone, of a robot that stood still at too few places."""

from dataclasses import replace
from typing import NoReturn

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.explanation import in_pictures
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.covariance import joint_covariance
from boxcal.calib.likelihood.moving.faults import sound
from boxcal.calib.likelihood.moving.leave_out import leave_out
from boxcal.calib.likelihood.moving.merged_estimate import Doubts, merged, rolling
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import FIRST_JITTER_S
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.detect.tags.on_the_move import LEAST_WITHOUT_STOPS, TOO_FEW_PLACES

_STAND = "let the robot stand still for two seconds in three places or more where it sees the box"


def from_frames_alone(found: Estimate, fit: Fit, drive: Correspondences) -> Estimate:
    """Return the estimate of frames on the move alone: clock offset, jitter and rolling shutter among the unknowns.

    Parameters
    ----------
    found, fit
        The estimate, and its solution, of the frames as if the robot had stood still at each.
    drive
        The drive, its frames as its stops.

    Raises
    ------
    CalibError
        If they do not determine the calibration.
    """
    why = _unsuitable(found, fit)
    if why:
        raise _refused(why)
    frames = tuple(
        MovingFrame(
            t_ns=stop.t_start_ns,
            landmark_ids=stop.landmark_ids,
            p_box=stop.p_box,
            faces=stop.faces,
            uv_px=stop.uv_px,
            cov_px2=stop.cov_px2,
        )
        for stop in drive.stops
    )
    noise = FrameNoise(slip=fit.components.slip, jitter_s=FIRST_JITTER_S, sway=1.0, scale=1.0)
    try:
        among_all = sound(fit, [replace(drive, stops=(), moving=frames)], fit.problem.stop, noise)
    except np.linalg.LinAlgError as error:
        raise _refused("wheels and pictures do not fit together") from error
    settled = among_all.settled
    # offset and rate are a line over time, so that frames of one side of a jump are used, where there are enough
    if settled is None or (among_all.jumps and len(settled.joint.woven.moving) < LEAST_WITHOUT_STOPS):
        raise _refused(among_all.said(f"fewer than {LEAST_WITHOUT_STOPS} frames are left on its longer side", 1))
    cov = joint_covariance(fit, settled)
    rolls = rolling(settled, cov)
    if rolls:
        raise _refused(f"{rolls}, too long for the robot's course to be known over it")
    among = leave_out(fit, settled)
    doubts = Doubts(without=among_all, among=among, exposure=None)
    return merged(found, fit, settled, among.enlarged(cov), doubts, drive.source.clock_offset)


def refuse_unused() -> NoReturn:
    """Refuse a robot that stood still at too few places where frames on the move are not to be used."""
    raise CalibError(f"{TOO_FEW_PLACES}, and frames on the move are not to be used", remedy=_STAND)


def _unsuitable(found: Estimate, fit: Fit) -> str:
    """Return why frames on the move are not enough; empty if they may be."""
    if not np.all(np.isfinite(found.cov)):
        return next((f"{direction.text}" for direction in found.directions), "they do not determine all parameters")
    if any(map(in_pictures, fit.problem.explanations)):
        return "what happened to camera or box is known at stops only"
    return ""


def _refused(why: str) -> CalibError:
    return CalibError(f"{TOO_FEW_PLACES}, and its frames on the move do not do: {why}", remedy=_STAND)
