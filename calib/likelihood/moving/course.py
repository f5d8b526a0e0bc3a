"""Course of the wheels around a moment: a cubic through their readings, as rows of a rolling shutter need it."""

import numpy as np

from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids

ORDERS = 3
"""Derivatives of the wheels' angles that are estimated: rate, acceleration and its change."""
_HALF_S = 0.08
"""Readings so near to a moment are used (s): their rounding averages out, and a robot's speed is a cubic over it."""
_LEAST, _MOST = 2, 16
"""Readings on either side."""
_LONGEST_S = 1.0
"""Where they lie further apart in all than this, s, the rate between the nearest two is taken, and no acceleration."""


def wheel_course(wheels: WheelSamples, t_ns: Ids, after: Ids) -> Array:
    """Return derivatives of the wheels' angles at some times, (F, 3, 2): rad/s, rad/s^2, rad/s^3; right and left.

    Parameters
    ----------
    wheels
        All samples, two at least.
    t_ns : (F,), ns
        The times.
    after : (F,)
        The sample behind each.
    """
    count = len(wheels)
    phi = np.stack([wheels.phi_R, wheels.phi_L], axis=1)
    step = np.median(np.diff(wheels.t_ns)) / 1e9
    half = int(np.clip(round(_HALF_S / step), _LEAST, min(_MOST, max(count // 2, 1))))
    first = np.clip(after - half, 0, max(count - 2 * half, 0))
    rows = np.minimum(first[:, None] + np.arange(2 * half), count - 1)
    t = (wheels.t_ns[rows] - t_ns[:, None]) / 1e9
    between = (wheels.t_ns[after] - wheels.t_ns[after - 1]) / 1e9
    out = np.zeros((len(t_ns), ORDERS, 2))
    out[:, 0] = (phi[after] - phi[after - 1]) / between[:, None]
    known = np.all(wheels.covered[rows[:, 1:]], axis=1) & (t[:, -1] - t[:, 0] < _LONGEST_S) & (2 * half > ORDERS)
    if not known.any():
        return out
    scale = np.abs(t[known]).max(axis=1)[:, None]
    powers = (t[known] / scale)[:, :, None] ** np.arange(ORDERS + 1)
    found = np.linalg.pinv(powers) @ (phi[rows[known]] - phi[rows[known, :1]])
    by = np.array([1.0, 2.0, 6.0]) / scale ** np.arange(1, ORDERS + 1)
    out[known] = found[:, 1:] * by[:, :, None]
    return out


def turned(course: Array, since_s: Array) -> Array:
    """Return how far the wheels turn from each of some moments on, (L, 2), rad.

    Parameters
    ----------
    course : (L, 3, 2)
        Derivatives of the wheels' angles at the moments.
    since_s : (L,), s
        For how long.
    """
    by = since_s[:, None] ** np.arange(1, ORDERS + 1) / np.array([1.0, 2.0, 6.0])
    return np.asarray(np.einsum("lk,lkw->lw", by, course))


def rates_after(course: Array, since_s: Array) -> Array:
    """Return how fast the wheels turn some time after each of some moments, (L, 2), rad/s; see :func:`turned`."""
    by = since_s[:, None] ** np.arange(ORDERS) / np.array([1.0, 1.0, 2.0])
    return np.asarray(np.einsum("lk,lkw->lw", by, course))
