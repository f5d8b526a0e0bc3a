"""Frames on the move that the others contradict: taken at another time, or not showing what their corners say."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import one_time
from boxcal.calib.likelihood.moving.frame_times import FrameTimes, frame_times, gains
from boxcal.calib.likelihood.moving.jumps import Jump, Step, clearest_step, longer_side
from boxcal.calib.likelihood.moving.levels import Settled, settled
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import joined
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids

FEWEST = 4
"""With fewer frames which of them is wrong cannot be decided."""
_ROUNDS = 6
_LEAST_LATE_S = 1e-3
"""Frames of another time by less than this, s, are jitter."""
_MOST_FRACTION = 0.34
_MISFIT = 6.0
"""A frame whose corners' mean square is this many times that of the usual frame shows something else."""


def enough_frames(drives: Sequence[Correspondences]) -> Ids:
    """Return the numbers, counted through all drives, of the frames of drives that have enough of them."""
    counts = np.array([len(drive.moving) for drive in drives])
    return np.flatnonzero(np.repeat(counts >= FEWEST, counts))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sound:
    """Stops and frames without frames that the others contradict.

    Attributes
    ----------
    settled
        Those; None where too few frames are left, or too many contradict each other.
    odd
        How many frames do.
    jumps
        Of the camera's clock; frames on the longer side are left.
    """

    settled: Settled | None
    odd: int = 0
    jumps: tuple[Jump, ...] = ()

    def said(self, why: str, drives: int) -> str:
        """Return in words why frames cannot be used, behind what is known of them."""
        parts = [jump.said(drives) for jump in self.jumps]
        if self.settled is None:
            why = f"{self.odd} of them contradict the others" if self.odd else "wheels and pictures do not fit there"
        return "; ".join([*parts, why])

    def jumps_said(self, drives: int) -> list[str]:
        """Return the jumps in words, with what was left out for them."""
        return [
            f"{jump.said(drives)}, of whose shorter side {jump.without} frames were left out" for jump in self.jumps
        ]


def sound(fit: Fit, drives: Sequence[Correspondences], frames: Ids, noise: FrameNoise) -> Sound:
    """Return stops and frames without frames that the others contradict, and without the shorter side of jumps.

    Parameters
    ----------
    fit, drives
        Solution of the stops, and their drives.
    frames
        Frames to use, counted through all drives.
    noise
        To begin with.
    """
    clocks, out = one_time(len(drives)), Sound(settled=None)
    for _ in range(_ROUNDS):
        joint = joined(fit, drives, frames, clocks, noise)
        found = settled(fit, drives, joint, noise) if len(joint.woven.moving) >= FEWEST else None
        if found is None or len(found.joint.woven.moving) < FEWEST:  # the offset may put frames into stands
            return out
        there = found.joint.woven
        odd, step = _odd(fit, found)
        if step is not None:
            frames, jump = longer_side(there, step)
            out = replace(out, jumps=(*out.jumps, jump))
            continue
        if not len(odd):
            return replace(out, settled=found)
        out = replace(out, odd=out.odd + len(odd))
        if out.odd > _MOST_FRACTION * (len(frames) + out.odd):
            return out
        used = there.frame[there.moving]
        frames, clocks = used[~np.isin(used, there.frame[odd])], found.joint.clocks
    return out


def _odd(fit: Fit, found: Settled) -> tuple[Ids, Step | None]:
    """Return the frames (their places in the row) that fit too badly, or a jump of the clock that explains more."""
    joint = found.joint
    times = frame_times(fit, found)
    late = _of_another_time(fit, times)
    step = clearest_step(times)
    if step is not None and step.gain > late[1]:
        return late[0][:0], step
    if len(late[0]):
        return late[0], None
    rows = joint.woven.moving
    limit = float(chdtri(2, fit.options.false_alarm / len(rows)))
    count = np.maximum(np.bincount(joint.problem.corner_stop, minlength=len(joint.woven.frame)), 1)
    square = np.bincount(joint.problem.corner_stop, np.sum(joint.at.residual_px**2, axis=1)) / count
    worst = np.maximum(_in_time(found)[rows] / limit, square[rows] / (_MISFIT * np.median(square[rows])))
    k = int(np.argmax(worst))
    return rows[[k]] if worst[k] > 1 else rows[:0], None


def _of_another_time(fit: Fit, times: FrameTimes) -> tuple[Ids, float]:
    """Return the frames (places in the row) that were taken at another time than all others, and what the first gains.

    One after the other is added, and those that then need it no longer are taken back.
    """
    count = len(times.places)
    limit = float(chdtri(1, fit.options.false_alarm / count))
    odd: list[int] = []
    first = 0.0
    for _ in range(int(_MOST_FRACTION * count) + 1):
        gain, late_s = _apart(times, odd)
        gain[odd] = -np.inf
        k = int(np.argmax(gain))
        if gain[k] < limit or abs(late_s[k]) < _LEAST_LATE_S:
            break
        first = first or float(gain[k])
        odd.append(k)
    for k in odd[:-1]:
        others = [j for j in odd if j != k]
        if _apart(times, others)[0][k] < limit:
            odd = others
    return times.places[np.array(sorted(odd), dtype=np.int64)], first


def _apart(times: FrameTimes, odd: list[int]) -> tuple[Array, Array]:
    """Return what it gains to take each frame as of another time, some being so already, and how late it is, (F,)."""
    every = np.eye(len(times.places))
    return gains(times, np.column_stack([times.lines, every[:, odd]]), every)


def _in_time(found: Settled) -> Array:
    """Return the squared distances of the readings' errors at stops and frames from what is usual there, (P,)."""
    joint, jitter = found.joint, found.noise.jitter_s
    unit = joint.problem.step / np.sqrt(12)
    rates = joint.woven.rates / unit * jitter
    cov = np.eye(2) * (1 + (joint.woven.bend / unit) ** 2)[:, :, None] + rates[:, :, None] * rates[:, None, :]
    e = joint.state.encoder_errors
    return np.asarray(np.einsum("pi,pij,pj->p", e, np.linalg.inv(cov), e))
