"""Encoder counters that jump: they wrap around, or begin anew, within one sample."""

import numpy as np

from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids

JUMP_RAD = 0.5
"""Wheel travel within one sample (20 ms, usually) that no motor makes."""
MANY_TIMES = 5.0
"""And this many times as much as the largest but a few of its kind."""
_ALIKE = 0.2
_LARGE_QUANTILE = 0.95
_NEIGHBOURS = 3
"""A jump is compared with this many samples before it and after it."""


def largest_steps(wheels: WheelSamples) -> Array:
    """Return the larger of both wheels' travel in each sample, (S - 1,) rad; in a usual one where some are missing."""
    travel = np.abs(np.diff(np.stack([wheels.phi_R, wheels.phi_L]), axis=1)).max(axis=0)
    dt = np.maximum(np.diff(wheels.t_ns).astype(np.float64), 1.0)
    return np.asarray(travel * np.minimum(1.0, np.median(dt) / dt)) if dt.size else travel


def jumps(steps: Array) -> Ids:
    """Return the samples in which readings jump: more than a motor turns, than usual in the log, and than around them.

    A log that mostly stands has a usual travel of nought, so wheels that are sampled seldom need the neighbours.
    """
    usual = float(np.quantile(steps, _LARGE_QUANTILE)) if steps.size else 0.0
    large = np.flatnonzero(steps > max(JUMP_RAD, MANY_TIMES * usual))
    window = min(2 * _NEIGHBOURS + 1, max(steps.size, 1))
    first = np.clip(large - _NEIGHBOURS, 0, steps.size - window)  # near an end the window lies to one side
    around = steps[first[:, None] + np.arange(window)]
    return np.asarray(large[steps[large] > MANY_TIMES * np.median(around, axis=1)], dtype=np.int64)


WRAPS = 3
"""Jumps from which on readings wrap around: no leg can be trusted then; fewer cost the legs that they are on."""


def counter_finding(wheels: WheelSamples, least: int = 1) -> Finding | None:
    """Return what is said of readings that jump, as often as given or more; None if they do not."""
    steps = largest_steps(wheels)
    jumped = steps[jumps(steps)]
    if jumped.size < max(least, 1):
        return None
    size = float(np.median(jumped))
    alike = jumped.size > 1 and float(np.ptp(jumped)) < _ALIKE * size
    often = "once" if jumped.size == 1 else f"{jumped.size} times"
    why = "counters that wrap around" if alike else "counters that begin anew, or lost messages"
    return Finding(
        cause="encoder-restart",
        text=f"the wheels' readings jump {often}, by {size:.1f} rad within one sample ({why})",
        advice="Make the driver's counters go on beyond their range, and look for restarts of the driver.",
        blocks=True,
        size=size,
        unit="rad",
    )
