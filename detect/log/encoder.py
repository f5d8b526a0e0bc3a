"""One encoder's readings put right: sorted, strays dropped, unwrapped, resets joined; and the wheels on one time base.

What cannot be known is marked, not guessed: a wheel that moved while its readings were missing or its counter was set
anew costs the leg in which that happened, never the log.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.encoder_step import encoder_step
from boxcal.detect.log.losses import MOST_STRAYS
from boxcal.detect.log.unwrapping import unwrapped
from boxcal.detect.log.wheel_samples import Flags, WheelSamples
from boxcal.target.arrays import Array, Ids

MAX_ANGLE = 1e9
"""Largest wheel angle that is believed, rad."""
_RESET_SPEED = 6.0
"""A jump is faster than so many times the fastest of ordinary motion (its 90 % quantile)."""
_RESET_BESIDE = 4.0
"""And than so many times the motion just before and after it."""
_RESET_ANGLE = 0.5
"""Smallest jump that counts as a reset of the counter, rad."""
_GAP_S, _GAP_SAMPLES = 0.5, 6.0
"""Readings are missing where the next comes later than this, s, and later than so many usual intervals."""
_STILL = 0.01
"""A wheel that reads the same before and after missing readings, to this angle, rad, stood still."""
_STRAY_RUN = 3
"""Most readings in a row that can be strays."""
_STRAY_STEPS = 4.0
_BESIDE = 4
"""Travel is compared with so many readings on either side."""
_STRAY_ANGLE = 0.02
"""A stray is off by more than so many encoder steps and rad, while its neighbours agree."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Encoder:
    """One wheel's readings.

    Attributes
    ----------
    t_ns : (S,) ns
        Stamps, strictly ascending.
    phi : (S,), rad
        Angles, unwrapped.
    step : rad
        The encoder's step, 0 if none shows.
    covered : (S,) bool
        Whether the travel since the reading before is known.
    notes
        What was put right, in words.
    """

    t_ns: Ids
    phi: Array
    step: float
    covered: Flags
    notes: tuple[str, ...] = ()


def clean(t_ns: Ids, phi: Array, who: str, periods: Sequence[float] = (), step: float | None = None) -> Encoder:
    """Return one wheel's readings in order of their stamps, unwrapped, without strays, resets joined.

    Of equal stamps the last reading is kept. Single readings far off neighbours that agree are dropped. Readings modulo
    a turn, modulo a power of two of encoder steps, or modulo any other range of a counter are unwrapped where the data
    show it: the readings fill one period and jump by nearly all of it. A jump that is no wrap is a reset: the readings
    go on from where they were, and the travel across it is known only if the wheel stood still.

    Parameters
    ----------
    t_ns : (S,) ns
        Stamps in order of arrival.
    phi : (S,), rad
        Finite.
    who
        Recording and joint, for messages.
    periods : rad
        Ranges of the counter that the message type defines.
    step : rad, optional
        Of the encoder, where it is known; else it is read off the readings.

    Raises
    ------
    DetectError
        If fewer than two different stamps remain, or an angle is unreasonable.
    """
    if np.any(t_ns[1:] < t_ns[:-1]):
        order = np.argsort(t_ns, kind="stable")
        t_ns, phi = t_ns[order], phi[order]
    last = np.concatenate([t_ns[1:] > t_ns[:-1], [True]])
    if np.sum(last) < 2:
        raise DetectError(
            f"{t_ns.size} positions with {np.sum(last)} different header stamp",
            source=who,
            needed="times are needed",
            remedy="make the driver stamp its messages",
        )
    if not np.all(last):
        t_ns, phi = t_ns[last], phi[last]
    step = encoder_step(phi) if step is None else step
    phi, period = unwrapped(phi, step, periods)
    kept = ~strays(phi, step)
    dropped = int(np.sum(~kept))
    if dropped:
        t_ns, phi = t_ns[kept], phi[kept]
    if np.max(np.abs(phi)) > MAX_ANGLE:
        raise DetectError(
            f"position {np.max(np.abs(phi)):.3g}",
            source=who,
            needed="angles in rad are needed",
            remedy="check the driver",
        )
    if not period:
        phi, period = unwrapped(phi, step, periods)
    phi, resets, known = _resets_joined(t_ns, phi, step)
    covered = gaps_covered(t_ns, phi)
    covered[resets[~known] + 1] = False
    notes = []
    if dropped:
        notes.append(f"{dropped} stray reading{'s' if dropped > 1 else ''} dropped")
    if resets.size:
        times = f"{resets.size} time{'s' if resets.size > 1 else ''}"
        notes.append(f"its counter was set anew {times}, first at {t_ns[resets[0] + 1] / 1e9:.3f} s")
    return Encoder(t_ns=t_ns, phi=phi, step=step, covered=covered, notes=tuple(notes))


def gaps_covered(t_ns: Ids, phi: Array) -> Flags:
    """Return whether the travel since the reading before is known, (S,): False where readings are missing in motion.

    Parameters
    ----------
    t_ns : (S,) ns
        Ascending.
    phi : (S,), rad
        Angles of one wheel.
    """
    covered = np.ones(t_ns.size, dtype=np.bool_)
    if t_ns.size > 2:
        dt = np.diff(t_ns) / 1e9
        gap = (dt > _GAP_S) & (dt > _GAP_SAMPLES * float(np.median(dt)))
        covered[1:] = ~(gap & (np.abs(np.diff(phi)) > _STILL))
    return covered


def strays(phi: Array, step: float) -> Flags:
    """Return which readings, (S,), stray: up to three in a row far off readings before and after that agree.

    Parameters
    ----------
    phi : (S,), rad
        In order of time.
    step : rad
        Of the encoder.
    """
    out = np.zeros(phi.size, dtype=np.bool_)
    if phi.size < 5:
        return out
    limit = max(_STRAY_ANGLE, _STRAY_STEPS * step)
    travel = np.abs(np.diff(phi))
    # A stray is off by more than three times what its neighbours differ by, so nearly all of that from the one before.
    leaps = np.flatnonzero(travel > limit * 5 / 6)
    for run in range(1, _STRAY_RUN + 1):
        at = leaps[leaps < phi.size - run - 1]
        before, after = phi[at], phi[at + run + 1]
        agree = np.abs(after - before)
        inside = phi[at[:, None] + np.arange(1, run + 1)]
        off = np.min(np.abs(inside - ((before + after) / 2)[:, None]), axis=1)
        astray = (off > limit) & (off > 3 * agree + 3 * step)
        if np.sum(astray) > MOST_STRAYS * phi.size:
            continue
        for k, far in zip(at[astray], off[astray], strict=True):  # the run is k + 1 to k + run
            beside = np.concatenate([travel[max(k - _BESIDE, 0) : k], travel[k + run + 1 : k + run + 1 + _BESIDE]])
            if beside.size and far > 2 * float(beside.max()) and not np.any(out[k : k + run + 2]):
                out[k + 1 : k + 1 + run] = True
    return out


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
        return WheelSamples(
            t_ns=right.t_ns,
            phi_R=right.phi,
            phi_L=left.phi,
            encoder_steps=steps,
            covered=right.covered & left.covered,
        )
    start, end = max(right.t_ns[0], left.t_ns[0]), min(right.t_ns[-1], left.t_ns[-1])
    t_ns = np.union1d(right.t_ns, left.t_ns)
    t_ns = t_ns[(t_ns >= start) & (t_ns <= end)]
    if t_ns.size < 2:
        raise DetectError(
            f"the right wheel was read from {span(right.t_ns)} and the left from {span(left.t_ns)}",
            source=who,
            needed="times that overlap are needed",
            remedy="record both with one clock",
        )
    at = (t_ns - start).astype(np.float64)
    phi_R, phi_L = (np.interp(at, (e.t_ns - start).astype(np.float64), e.phi) for e in (right, left))
    covered = np.ones(t_ns.size, dtype=np.bool_)
    for encoder in (right, left):
        for k in np.flatnonzero(~encoder.covered):  # all of the joined samples up to such a reading
            first = np.searchsorted(t_ns, encoder.t_ns[k - 1], side="right")
            covered[first : np.searchsorted(t_ns, encoder.t_ns[k], side="right")] = False
    return WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L, encoder_steps=steps, covered=covered)


def averaged(wheels: Sequence[Encoder], who: str) -> Encoder:
    """Return the mean of a side's wheels, as one wheel (DetectError if they do not overlap in time)."""
    mean = wheels[0]
    for number, other in enumerate(wheels[1:], 1):
        both = join(mean, other, who)
        weight = 1 / (number + 1)
        phi = (both.phi_R - both.phi_R[0]) * (1 - weight) + (both.phi_L - both.phi_L[0]) * weight
        step = float(np.hypot((1 - weight) * mean.step, weight * other.step))
        mean = Encoder(t_ns=both.t_ns, phi=phi, step=step, covered=both.covered, notes=mean.notes + other.notes)
    return mean


def span(t_ns: Ids) -> str:
    """Return ``first to last s`` of stamps in ns."""
    return f"{t_ns.min() / 1e9:.3f} to {t_ns.max() / 1e9:.3f} s"


def without_strays(wheels: WheelSamples) -> tuple[WheelSamples, int]:
    """Return wheel samples whose strays stand where their neighbours say, and how many there were."""
    found = 0
    angles = []
    for phi, step in ((wheels.phi_R, wheels.encoder_steps[0]), (wheels.phi_L, wheels.encoder_steps[1])):
        stray = strays(phi, step)
        found += int(np.sum(stray))
        rows = np.arange(phi.size)
        angles.append(np.interp(rows, rows[~stray], phi[~stray]) if np.any(stray) else phi)
    return replace(wheels, phi_R=angles[0], phi_L=angles[1]), found


def _resets_joined(t_ns: Ids, phi: Array, step: float) -> tuple[Array, Ids, Flags]:
    """Return angles that go on across resets, the samples before them, and whether the wheel stood at each."""
    dt = np.diff(t_ns) / 1e9
    delta = np.diff(phi)
    usual_dt = float(np.median(dt))
    speed = np.abs(delta) / np.maximum(dt, usual_dt)
    moving = speed[speed > 0]
    none = np.zeros(0, dtype=np.int64)
    if moving.size < 3:
        return phi, none, none.astype(np.bool_)
    limit = _RESET_SPEED * float(np.quantile(moving, 0.9))
    jumps = np.flatnonzero((speed > limit) & (np.abs(delta) > max(_RESET_ANGLE, 4 * step)))
    beside = np.max(speed[np.clip([jumps - 1, jumps + 1], 0, speed.size - 1)], axis=0, initial=0.0)
    jumps = jumps[speed[jumps] > _RESET_BESIDE * beside]
    if not jumps.size or jumps.size > max(20, phi.size // 100):
        return phi, none, none.astype(np.bool_)
    change = delta.copy()
    known = np.zeros(jumps.size, dtype=np.bool_)
    for number, k in enumerate(jumps):
        near = np.abs(np.concatenate([delta[max(k - 3, 0) : k], delta[k + 1 : k + 4]]))
        known[number] = near.size > 2 and float(near.max()) <= 1.5 * step + 1e-4
        change[k] = 0.0
    return np.concatenate([[phi[0]], phi[0] + np.cumsum(change)]), jumps, known
