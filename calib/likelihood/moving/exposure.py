"""Exposure time of frames on the move, by how much they are blurred along their known motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.rolling import motions_px_s
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_LEAST_SHAPE = 0.2
"""Difference of the PSF's variances along and across its longest direction, over their sum, that counts as motion."""
_ALONG = 0.8
"""Cosine of twice the angle between blur and motion from which on one is that of the other."""
FEWEST = 3
_OF_MEDIAN = 1.2533
"""Standard deviation of a median over that of a mean, of normal values."""
_OF_SPREAD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """Time for which the shutter is open: ``time_s`` and its standard deviation ``sigma_s``, s."""

    time_s: float
    sigma_s: float


def exposure(found: Settled, drives: Sequence[Correspondences]) -> Exposure | None:
    """Return the exposure time estimated from the frames' blur; None where too few frames are blurred along it.

    A point that moves by L during the exposure is blurred along its path by a variance of L^2 / 12.

    Parameters
    ----------
    found
        Stops and frames: it knows the motions.
    drives
        The drives: their frames know their blur.
    """
    woven = found.joint.woven
    frames = [frame for drive in drives for frame in drive.moving]
    motion = motions_px_s(found.joint.problem, found.joint.at.corners, found.joint.state, woven.course)
    times = [_of_frame(frames[woven.frame[k]].blur_px2, motion[k]) for k in woven.moving.tolist()]
    positive = np.array([t for t in times if t > 0])
    if len(positive) < FEWEST:
        return None
    middle = float(np.median(positive))
    spread = _OF_SPREAD * float(np.median(np.abs(positive - middle)))
    return Exposure(time_s=middle, sigma_s=_OF_MEDIAN * spread / float(np.sqrt(len(positive))))


def _of_frame(blur_px2: Array, motion: Array) -> float:
    """Return the exposure, s, that a PSF's covariance (2, 2) and a motion (2,), px/s, give; 0 where they give none."""
    total, speed = float(np.trace(blur_px2)), float(motion @ motion)
    if not (total > 0 and speed > 0):
        return 0.0
    longer = np.array([blur_px2[0, 0] - blur_px2[1, 1], 2 * blur_px2[0, 1]])
    direction = np.array([motion[0] ** 2 - motion[1] ** 2, 2 * motion[0] * motion[1]]) / speed
    along = float(longer @ direction)
    length = float(np.linalg.norm(longer))
    if length < _LEAST_SHAPE * total or along < _ALONG * length:
        return 0.0
    return float(np.sqrt(12 * along / speed))
