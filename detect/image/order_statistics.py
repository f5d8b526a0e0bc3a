"""Order statistics of a few figures: numpy's own take ten times as long to begin with as they do for these."""

from math import isnan, nan

import numpy as np

from boxcal.target.arrays import Array


def median(values: Array) -> float:
    """Return the median of figures (N,), N > 0; NaN if one is."""
    return quantile(values, 0.5)


def quantile(values: Array, share: float) -> float:
    """Return what a share (0 to 1) of figures (N,), N > 0, lies below, interpolated; NaN if one is."""
    ordered = np.sort(values)
    last = len(ordered) - 1
    if isnan(ordered[last]):
        return nan
    at = share * last
    low = int(at)
    below, above = float(ordered[low]), float(ordered[min(low + 1, last)])
    return below + (at - low) * (above - below)
