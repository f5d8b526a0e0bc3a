"""Jumps of a camera's clock during a drive, by when its frames were taken."""

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from boxcal.calib.likelihood.moving.faults import own_lateness
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.target.arrays import Array

_EITHER_SIDE = 3
"""Frames that a clock must have shown before and after a jump."""
_LEAST_S = 2e-3
_CHANCE = 1e-5
"""Of a jump where there is none, over all places where it may be."""
_LEFT = 0.75
"""Share of the scatter that a jump may leave unexplained."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """Jump of the camera's clock.

    Attributes
    ----------
    drive
        From 0.
    later_s : s
        How much later stamps are from there on.
    at_s : s
        When, since the first sample of the wheels.
    """

    drive: int
    later_s: float
    at_s: float

    def said(self, drives: int) -> str:
        """Return it in words."""
        of = f" of drive {self.drive + 1}" if drives > 1 else ""
        return (
            f"the camera's clock jumps by {1e3 * abs(self.later_s):.0f} ms some {self.at_s:.0f} s after the start{of}"
        )


def jump(found: Settled) -> Jump | None:
    """Return the clearest jump of a clock that stops and frames show; None if there is none.

    Offset and rate are straight lines over time: a jump leaves a saw tooth of what each frame is late by besides.
    """
    woven = found.joint.woven
    late = own_lateness(found)
    for d, drive in enumerate(woven.drives):
        rows = woven.moving[woven.drive[woven.moving] == d]
        step = _step(woven.since_s[rows], late[rows])
        if step is not None:
            k, later_s = step
            when = np.mean(
                [drive.stops[int(row - np.searchsorted(woven.drive, d))].t_start_ns for row in rows[k - 1 : k + 1]]
            )
            return Jump(drive=d, later_s=later_s, at_s=float(when - drive.wheels.t_ns[0]) / 1e9)
    return None


def _step(since_s: Array, late_s: Array) -> tuple[int, float] | None:
    """Return the first frame after a step and the step's height, s, in (F,) latenesses; None if there is none."""
    count = len(late_s)
    line = np.stack([np.ones(count), since_s], axis=1)
    left = float(np.sum((late_s - line @ np.linalg.lstsq(line, late_s, rcond=None)[0]) ** 2))
    best: tuple[float, int, float] | None = None
    for k in range(_EITHER_SIDE, count - _EITHER_SIDE + 1):
        stepped = np.column_stack([line, np.arange(count) >= k])
        found = np.linalg.lstsq(stepped, late_s, rcond=None)[0]
        rest = float(np.sum((late_s - stepped @ found) ** 2))
        if best is None or rest < best[0]:
            best = rest, k, float(found[2])
    if best is None or left <= 0:
        return None
    rest, k, height = best
    freedom = count - 3
    ratio = (left - rest) / max(rest / freedom, 1e-30)
    clear = rest < _LEFT * left and abs(height) > _LEAST_S and float(fdtrc(1, freedom, ratio)) * count < _CHANCE
    return (k, height) if clear else None
