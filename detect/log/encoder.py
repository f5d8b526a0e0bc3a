"""One encoder's readings put right: sorted, unwrapped, checked; and the two wheels on one time base."""

from typing import NamedTuple

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.encoder_step import encoder_step
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids

MAX_ANGLE = 1e9
"""Largest wheel angle that is believed, rad."""
_RESET_SPEED = 20.0
_RESET_ANGLE = 1.0
_FEWEST_COUNTS = 256
"""Smallest range of a counter, steps."""


class Encoder(NamedTuple):
    """One wheel's readings: stamps (S,) ns, strictly ascending; angles (S,) rad; the encoder's step, rad (0: none)."""

    t_ns: Ids
    phi: Array
    step: float


def clean(t_ns: Ids, phi: Array, who: str) -> Encoder:
    """Return one wheel's readings in order of their stamps, unwrapped.

    Of equal stamps the last reading is kept. Readings modulo a turn, or modulo a power of two of encoder steps (a
    counter that overflows), are unwrapped where the data show it: the readings fill one period and jump by nearly all
    of it.

    Parameters
    ----------
    t_ns : (S,) ns
        Header stamps in order of arrival; readings stamped zero are dropped where others are not.
    phi : (S,), rad
        Finite.
    who
        File and joint, for messages.

    Raises
    ------
    DetectError
        If fewer than two different stamps remain, an angle is unreasonable, or the encoder was reset.
    """
    stamped = t_ns != 0
    t_ns, phi = (t_ns[stamped], phi[stamped]) if np.any(stamped) else (t_ns, phi)
    order = np.argsort(t_ns, kind="stable")
    t_ns, phi = t_ns[order], phi[order]
    last = np.concatenate([np.diff(t_ns) > 0, [True]])
    if np.sum(last) < 2:
        raise DetectError(
            f"{who}: {t_ns.size} positions with {np.sum(last)} different header stamp, times are needed; make the "
            "driver stamp its messages"
        )
    t_ns, phi = t_ns[last], phi[last]
    if np.max(np.abs(phi)) > MAX_ANGLE:
        raise DetectError(f"{who}: position {np.max(np.abs(phi)):.3g}, angles in rad are needed; check the driver")
    step = encoder_step(phi)
    phi = _unwrapped(phi, step)
    _refuse_reset(t_ns, phi, who)
    return Encoder(t_ns=t_ns, phi=phi, step=step)


def join(right: Encoder, left: Encoder, who: str) -> WheelSamples:
    """Return both wheels on one time base: all stamps of either within the time that both cover.

    Where a stamp has the reading of one wheel only, the other's angle is interpolated linearly (exact for constant
    speed between its readings).

    Raises
    ------
    DetectError
        If the two do not overlap in time.
    """
    steps = (right.step, left.step)
    if np.array_equal(right.t_ns, left.t_ns):
        return WheelSamples(t_ns=right.t_ns, phi_R=right.phi, phi_L=left.phi, encoder_steps=steps)
    start, end = max(right.t_ns[0], left.t_ns[0]), min(right.t_ns[-1], left.t_ns[-1])
    t_ns = np.union1d(right.t_ns, left.t_ns)
    t_ns = t_ns[(t_ns >= start) & (t_ns <= end)]
    if t_ns.size < 2:
        raise DetectError(
            f"{who}: the right wheel was read from {span(right.t_ns)} and the left from {span(left.t_ns)}, times that "
            "overlap are needed; record both with one clock"
        )
    at = (t_ns - start).astype(np.float64)
    phi_R, phi_L = (np.interp(at, (e.t_ns - start).astype(np.float64), e.phi) for e in (right, left))
    return WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L, encoder_steps=steps)


def span(t_ns: Ids) -> str:
    """Return ``first to last s`` of stamps in ns."""
    return f"{t_ns.min() / 1e9:.3f} to {t_ns.max() / 1e9:.3f} s"


def _unwrapped(phi: Array, step: float) -> Array:
    extent = float(np.ptp(phi))
    periods = [2 * float(np.pi)]
    if step > 0 and extent > 0.75 * _FEWEST_COUNTS * step:
        periods.append(step * 2.0 ** round(float(np.log2(extent / step + 1))))
    delta = np.diff(phi)
    for period in periods:
        jump = np.abs(delta) > period / 2
        if not np.any(jump) or np.all(jump) or extent > period * (1 + 1e-9) + step / 2:
            continue
        rest = np.abs(delta[jump]) - period
        usual = float(np.max(np.abs(delta[~jump])))
        slack = 3 * usual + 2 * step
        if usual < period / 4 and np.max(np.abs(rest)) <= slack and extent >= period - slack:
            return np.asarray(np.unwrap(phi, period=period))
    return phi


def _refuse_reset(t_ns: Ids, phi: Array, who: str) -> None:
    dt = np.diff(t_ns) / 1e9
    delta = np.abs(np.diff(phi))
    speed = delta / np.maximum(dt, np.median(dt))
    moving = speed[speed > 0]
    if moving.size == 0:
        return
    limit = _RESET_SPEED * float(np.quantile(moving, 0.99))
    jumps = np.flatnonzero((speed > limit) & (delta > _RESET_ANGLE))
    if jumps.size:
        k = int(jumps[0])
        raise DetectError(
            f"{who}: jumps from {phi[k]:.3f} to {phi[k + 1]:.3f} rad at {t_ns[k + 1] / 1e9:.3f} s, wheel angles "
            "without a reset are needed; cut the log there or record again"
        )
