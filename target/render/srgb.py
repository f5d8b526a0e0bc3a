"""The sRGB curve (IEC 61966-2-1): signal from linear intensity and back. All packages use this one."""

import numpy as np

from boxcal.target.arrays import Reals

_LINEAR_END = 0.0031308
"""Linear intensity up to which the curve is a straight line (IEC 61966-2-1)."""
_SIGNAL_END = 0.04045
"""Signal up to which it is one."""
_SLOPE, _SCALE, _OFFSET, _GAMMA = 12.92, 1.055, 0.055, 2.4


def srgb_from_linear(intensity: Reals) -> Reals:
    """Return the sRGB signal (0..1) of linear intensity (0..1), in its precision."""
    high = _SCALE * np.maximum(intensity, _LINEAR_END) ** (1 / _GAMMA) - _OFFSET
    return np.where(intensity <= _LINEAR_END, _SLOPE * intensity, high)


def linear_from_srgb(signal: Reals) -> Reals:
    """Return the linear intensity (0..1) of an sRGB signal (0..1), in its precision."""
    return np.where(signal <= _SIGNAL_END, signal / _SLOPE, ((signal + _OFFSET) / _SCALE) ** _GAMMA)
