"""The angle between two neighbouring readings of an incremental encoder, read off the angles that occur."""

import numpy as np
from numpy.typing import NDArray

_FLOAT_NOISE = 1e-7
"""Readings closer than this are one level, rad: more than single precision leaves of an angle of one turn."""
_FEW_STEPS = 4.5
"""Gaps of fewer steps than this refine the step, as the smallest gap alone is rough by the numbers' precision."""
_WHOLE, _SHARE = 0.1, 0.95
"""A gap is a multiple of the step if it is whole to a tenth of a step; nearly all gaps must be."""


def encoder_step(phi: NDArray[np.float64]) -> float:
    """Return an encoder's step, rad; 0 where the readings show none (a simulated, continuous joint).

    The levels that occur are sorted; where the smallest gap between two of them divides (nearly) all others, it is the
    step, refined by a straight line through the levels.

    Parameters
    ----------
    phi : (S,), rad
        Readings of one wheel as the encoder gave them: interpolated ones hide the step.
    """
    levels = np.unique(phi)
    if levels.size < 3:
        return 0.0
    levels = levels[np.concatenate([[True], np.diff(levels) > _FLOAT_NOISE])]
    gaps = np.diff(levels)
    if gaps.size < 2:
        return 0.0
    step = float(gaps.min())
    small = gaps[gaps < _FEW_STEPS * step]
    step = float(small.sum() / np.round(small / step).sum())
    multiples = np.round(gaps / step)
    if np.mean(np.abs(gaps / step - multiples) < _WHOLE) < _SHARE:
        return 0.0
    count = np.concatenate([[0.0], np.cumsum(multiples)])
    count -= count.mean()
    return float(count @ (levels - levels[0]) / (count @ count))
