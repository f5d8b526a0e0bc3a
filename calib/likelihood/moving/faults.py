"""Frames on the move that the others contradict: taken at another time, or not showing what their corners say."""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import one_time
from boxcal.calib.likelihood.moving.levels import Settled, settled
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import joined
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids

FEWEST = 4
"""With fewer frames there is no telling which of them is wrong."""
_ROUNDS = 6
_LATE_SIGMAS, _LEAST_LATE_S = 7.0, 5e-4
"""A frame later than the usual one by so many standard deviations of it (robust, and at least this, s) is odd."""
_MOST_SHARE = 0.34
_MISFIT = 6.0
"""A frame whose corners' mean square is so many times that of the usual frame shows something else."""


def enough_frames(drives: Sequence[Correspondences]) -> Ids:
    """Return the numbers, counted through all drives, of the frames of drives that have enough of them."""
    counts = np.array([len(drive.moving) for drive in drives])
    return np.flatnonzero(np.repeat(counts >= FEWEST, counts))


def sound(fit: Fit, drives: Sequence[Correspondences], frames: Ids, noise: FrameNoise) -> tuple[Settled | None, int]:
    """Return stops and frames without frames that the others contradict, and how many those are.

    None where too few frames are left, or too many contradict each other.

    Parameters
    ----------
    fit, drives
        Solution of the stops, and their drives.
    frames
        Frames to use, counted through all drives.
    noise
        To begin with.
    """
    clocks, left_out = one_time(len(drives)), 0
    for _ in range(_ROUNDS):
        joint = joined(fit, drives, frames, clocks, noise)
        if len(joint.woven.moving) < FEWEST:
            return None, left_out
        found = settled(fit, drives, joint, noise)
        if found is None:
            return None, left_out
        there = found.joint.woven
        if len(there.moving) < FEWEST:  # the offset puts the others into stands
            return None, left_out
        odd = _odd(fit, found)
        if odd is None:
            return found, left_out
        left_out += 1
        if left_out > _MOST_SHARE * (len(frames) + left_out):
            return None, left_out
        used = there.frame[there.moving]
        frames, clocks = used[used != there.frame[odd]], found.joint.clocks
    return None, left_out


def _odd(fit: Fit, found: Settled) -> int | None:
    """Return the frame (its place in the row) that fits worst, if it fits too badly; None if all fit."""
    joint = found.joint
    rows = joint.woven.moving
    limit = float(chdtri(2, fit.options.false_alarm / len(rows)))
    late = np.abs(own_lateness(found)[rows])
    usual = _LATE_SIGMAS * (1.4826 * np.median(late) + _LEAST_LATE_S)
    times = np.maximum(_in_time(found)[rows] / limit, late / usual)
    count = np.maximum(np.bincount(joint.problem.corner_stop, minlength=len(joint.woven.frame)), 1)
    square = np.bincount(joint.problem.corner_stop, np.sum(joint.at.residual_px**2, axis=1)) / count
    corners = square[rows] / (_MISFIT * np.median(square[rows]))
    worst = np.maximum(times, corners)
    k = int(np.argmax(worst))
    return int(rows[k]) if worst[k] > 1 else None


def own_lateness(found: Settled) -> Array:
    """Return by how much stops and frames were taken earlier than their stamps say, beyond all others, (P,), s.

    One that is far off makes the jitter large, which then explains it; so it is compared with the usual frame.
    """
    joint = found.joint
    rates = joint.woven.rates
    turned = joint.state.encoder_errors * (joint.problem.step / np.sqrt(12))
    return np.asarray(np.sum(turned * rates, axis=1) / np.maximum(np.sum(rates**2, axis=1), 1e-12))


def _in_time(found: Settled) -> Array:
    """Return the squared distances of the readings' errors at stops and frames from what is usual there, (P,)."""
    joint, jitter = found.joint, found.noise.jitter_s
    unit = joint.problem.step / np.sqrt(12)
    rates = joint.woven.rates / unit * jitter
    cov = np.eye(2) * (1 + (joint.woven.bend / unit) ** 2)[:, :, None] + rates[:, :, None] * rates[:, None, :]
    e = joint.state.encoder_errors
    return np.asarray(np.einsum("pi,pij,pj->p", e, np.linalg.inv(cov), e))
