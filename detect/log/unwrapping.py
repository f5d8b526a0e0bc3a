"""Unwrapping of wheel angles modulo a turn or the range of a counter, which is found in the readings."""

from collections.abc import Sequence

import numpy as np

from boxcal.target.arrays import Array, Ids

_FEWEST_COUNTS = 256
"""Smallest range of a counter, steps."""
_MOVING_WRAPS = 0.6
"""Part of the wraps that must happen while the wheel turns."""


def unwrapped(phi: Array, step: float, periods: Sequence[float]) -> tuple[Array, float]:
    """Return unwrapped angles and the period, 0 if they do not wrap.

    Parameters
    ----------
    phi : (S,), rad
        Angles in order of time.
    step : rad
        Of the encoder, 0 if none shows.
    periods : rad
        Ranges of the counter that the message type defines; a turn and what the readings show are tried besides.
    """
    extent = float(np.ptp(phi))
    delta = np.diff(phi)
    tried = [*periods, 2 * float(np.pi)]
    odd = _period_by_jumps(phi, delta, step, extent)
    if step > 0 and extent > 0.75 * _FEWEST_COUNTS * step:
        binary = step * 2.0 ** round(float(np.log2(extent / step + 1)))
        tried.append(binary if odd == 0 or abs(odd - binary) < 2.5 * step else odd)
    for period in tried:
        jump = np.abs(delta) > period / 2
        if not np.any(jump) or np.all(jump) or extent > period * (1 + 1e-9) + step / 2:
            continue
        rest = np.abs(delta[jump]) - period
        usual = float(np.max(np.abs(delta[~jump])))
        slack = 3 * usual + 2 * step
        known = period in periods
        full = known or extent >= period - slack
        if usual < period / 4 and np.max(np.abs(rest)) <= slack and full and _in_motion(delta, np.flatnonzero(jump)):
            return np.asarray(np.unwrap(phi, period=period)), period
    return phi, 0.0


def _in_motion(delta: Array, jumps: Ids) -> bool:
    """Return whether jumps happen while the wheel turns, as wraps do; a counter that is set anew may stand."""
    beside = np.abs(delta[np.clip([jumps - 1, jumps + 1], 0, delta.size - 1)])
    return bool(np.mean(np.max(beside, axis=0) > 0) >= _MOVING_WRAPS)


def _period_by_jumps(phi: Array, delta: Array, step: float, extent: float) -> float:
    """Return the range of a counter in whole steps, 0 if the readings do not show it.

    Several jumps are needed that all lead from one end of the readings to the other; what a jump lacks of the period
    is the travel of one sample, which the neighbouring samples determine.
    """
    jumps = np.flatnonzero(np.abs(delta) > extent / 2)
    if step <= 0 or extent < _FEWEST_COUNTS * step or not 2 <= jumps.size <= phi.size // 4:
        return 0.0
    inner = jumps[(jumps > 0) & (jumps < delta.size - 1)]
    if inner.size < 2:
        return 0.0
    found = np.abs(delta[inner] - (delta[inner - 1] + delta[inner + 1]) / 2)
    usual = float(np.quantile(np.abs(np.delete(delta, jumps)), 0.99))
    period = float(np.median(found))
    if np.max(np.abs(found - period)) > 2 * usual + 3 * step:
        return 0.0
    steps = max(round(period / step), round(extent / step) + 1)
    near = range(max(steps - 2, round(extent / step) + 1), steps + 3)
    return next((n for n in near if n % 100 == 0), steps) * step  # such ranges are round numbers
