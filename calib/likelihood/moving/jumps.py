"""Jumps of a camera's clock during a drive, by when its frames were taken."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from boxcal.calib.likelihood.moving.frame_times import FrameTimes, gains
from boxcal.calib.likelihood.moving.weave import Woven
from boxcal.target.arrays import Ids

_EITHER_SIDE = 3
"""Frames that a clock must have shown before and after a jump."""
_LEAST_S = 2e-3
_CHANCE = 5e-4
"""Of a jump where there is none, over all places where it may be, if jitter were known; as it is not, twice that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """Jump of the camera's clock against the wheels'.

    Attributes
    ----------
    drive
        From 0.
    later_s : s
        How much later stamps are from there on.
    at_s : s
        When, since the first sample of the wheels.
    without
        How many frames lie on the shorter side of it.
    """

    drive: int
    later_s: float
    at_s: float
    without: int

    def said(self, drives: int) -> str:
        """Return it in words."""
        of = f" of drive {self.drive + 1}" if drives > 1 else ""
        return (
            f"the camera's clock jumps by {1e3 * abs(self.later_s):.0f} ms against the wheels' some {self.at_s:.0f} s "
            f"after the start{of}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Step in what a drive's frames are late by: ``gain`` as of :func:`gains`, ``later_s`` from ``place`` on."""

    gain: float
    later_s: float
    drive: int
    place: int


def clearest_step(times: FrameTimes) -> Step | None:
    """Return the step that explains most of what frames are late by, if it is clear; None if none is."""
    starts = [
        (int(d), int(k))
        for d in np.unique(times.drive)
        for k in np.flatnonzero(times.drive == d)[_EITHER_SIDE : 1 - _EITHER_SIDE]
    ]
    if not starts:
        return None
    row = np.arange(len(times.places))
    steps = np.array([(row >= k) & (times.drive == d) for d, k in starts], dtype=np.float64).T
    gain, later_s = gains(times, times.lines, steps)
    best = int(np.argmax(gain))
    if gain[best] < chdtri(1, _CHANCE / len(starts)) or abs(later_s[best]) < _LEAST_S:
        return None
    drive, k = starts[best]
    return Step(gain=float(gain[best]), later_s=float(later_s[best]), drive=drive, place=int(times.places[k]))


def longer_side(woven: Woven, step: Step) -> tuple[Ids, Jump]:
    """Return the frames on the longer side of a step, and all of other drives; and what the step is.

    Offset and rate are a straight line over time: they hold for one side.
    """
    moving, drive = woven.moving, woven.drive[woven.moving]
    own = moving[drive == step.drive]
    before, after = own[own < step.place], own[own >= step.place]
    shorter = before if len(before) < len(after) else after
    start = int(np.searchsorted(woven.drive, step.drive))
    there = woven.drives[step.drive]
    ends = (int(before[-1]) - start, int(after[0]) - start)
    when_ns = sum(there.stops[k].t_start_ns - int(there.wheels.t_ns[0]) for k in ends) / 2
    jump = Jump(
        drive=step.drive,
        later_s=step.later_s,
        at_s=when_ns / 1e9,
        without=len(shorter),
    )
    return woven.frame[np.setdiff1d(moving, shorter)], jump
