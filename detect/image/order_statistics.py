"""Order statistics of a few values: numpy's own have ten times the overhead."""

from math import isnan, nan

import numpy as np

from boxcal.target.arrays import Array


def median(values: Array) -> float:
    """Return the median of values (N,), N > 0; NaN if one is."""
    return quantile(values, 0.5)


def quantile(values: Array, probability: float) -> float:
    """Return a quantile (probability 0 to 1) of values (N,), N > 0, interpolated; NaN if one is."""
    ordered = np.sort(values)
    last = len(ordered) - 1
    if isnan(ordered[last]):
        return nan
    at = probability * last
    low = int(at)
    below, above = float(ordered[low]), float(ordered[min(low + 1, last)])
    return below + (at - low) * (above - below)
