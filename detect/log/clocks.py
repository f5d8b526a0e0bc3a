"""Clock offset between images and wheels, estimated from when messages were recorded."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from boxcal.target.arrays import Array, Ids

LEAST_OFFSET_S = 0.4
"""Smaller differences are what images take to arrive; stops are longer."""
_MAX_SPREAD_S = 0.5
_FEWEST = 3
_LEVEL, _STEADY_S = 5, 0.1
"""Messages that show a level of ages before and after a jump, and how far ages may spread about it, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StampedTimes:
    """The stamps of one kind of message put right.

    Attributes
    ----------
    t_ns : (N,) ns
        Times to use.
    note
        What was done, empty if the stamps stay.
    """

    t_ns: Ids
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """Jump of a clock: ``later_s`` seconds later stamps from a time of recording ``at_ns`` on."""

    later_s: float
    at_ns: int


def usable_stamps(t_ns: Ids, log_ns: Ids, what: str) -> StampedTimes:
    """Return the stamps, or the times of recording where most stamps are zero.

    A few zeros among right stamps mark messages of no use; they stay zero, for the caller to drop.
    """
    if t_ns.size and np.mean(t_ns == 0) > 0.5:
        return StampedTimes(t_ns=log_ns, note=f"{what} carry no stamps, the times of their recording were taken")
    return StampedTimes(t_ns=t_ns)


def offset_by_recording(image_t: Ids, image_log: Ids, wheel_t: Ids, wheel_log: Ids) -> int:
    """Return by how many ns the images' clock is ahead of the wheels', 0 if recording times show no difference.

    Both kinds of message are recorded by one clock, soon after they were stamped: stamp less time of recording is the
    same for both but for what an image takes longer, unless one of the clocks is off. Recordings whose times are
    copies of the stamps carry no information.
    """
    ages = [(t - log) / 1e9 for t, log in ((image_t, image_log), (wheel_t, wheel_log)) if t.size >= _FEWEST]
    if len(ages) < 2 or any(np.all(age == 0) for age in ages):
        return 0
    medians = [float(np.median(age)) for age in ages]
    spreads = [float(np.median(np.abs(age - m))) for age, m in zip(ages, medians, strict=True)]
    offset = medians[0] - medians[1]
    if abs(offset) < LEAST_OFFSET_S or max(spreads) > _MAX_SPREAD_S:
        return 0
    youngest = [float(np.quantile(age, 0.9)) for age in ages]  # the messages that arrived soonest say it best
    return round((youngest[0] - youngest[1]) * 1e9)


def without_jumps(t_ns: Ids, log_ns: Ids, others: tuple[Ids, Ids]) -> tuple[Ids, tuple[Jump, ...]]:
    """Return stamps with jumps of their clock taken out, (N,) ns, and the jumps.

    A clock that is set during a recording changes stamp less time of recording for good. The longest stretch without a
    jump keeps its stamps. Where those of other messages jump, too, it is the recorder's clock, and nothing is changed.

    Parameters
    ----------
    t_ns, log_ns : (N,), ns
        Stamps and times of recording, in the order in which they were recorded.
    others : (M,) and (M,), ns
        Those of messages stamped by another clock.
    """
    steps = _steps((t_ns - log_ns) / 1e9)
    if not steps or _steps((others[0] - others[1]) / 1e9):
        return t_ns, ()
    return _put_right(t_ns, log_ns, steps)


def without_own_jumps(t_ns: Ids, log_ns: Ids) -> tuple[Ids, tuple[Jump, ...]]:
    """Return stamps with jumps of their clock removed, found from the stamps alone, (N,) ns, and the jumps.

    Of messages that come regularly either the stamps or the times of recording go on as usual at a jump: those of the
    clock that did not jump. See :func:`without_jumps`.
    """
    steps = _steps((t_ns - log_ns) / 1e9)
    if not steps:
        return t_ns, ()
    usual = np.median(np.diff(log_ns))
    own = [k for k in steps if abs(log_ns[k] - log_ns[k - 1] - usual) < abs(t_ns[k] - t_ns[k - 1] - usual)]
    return _put_right(t_ns, log_ns, own) if len(own) == len(steps) else (t_ns, ())


def _put_right(t_ns: Ids, log_ns: Ids, steps: list[int]) -> tuple[Ids, tuple[Jump, ...]]:
    """Return stamps whose age steps nowhere, and the jumps taken out; unchanged where ages do not keep a level."""
    age = (t_ns - log_ns) / 1e9
    edges = [0, *steps, len(age)]
    levels = [float(np.quantile(age[a:b], 0.9)) for a, b in pairwise(edges)]
    spreads = [float(np.median(np.abs(age[a:b] - np.median(age[a:b])))) for a, b in pairwise(edges)]
    if max(spreads) > _STEADY_S:
        return t_ns, ()
    kept = int(np.argmax(np.diff(edges)))
    out = t_ns.copy()
    for (a, b), level in zip(pairwise(edges), levels, strict=True):
        out[a:b] -= round((level - levels[kept]) * 1e9)
    found = [
        Jump(later_s=after - before, at_ns=int(log_ns[edge]))
        for edge, (before, after) in zip(edges[1:-1], pairwise(levels), strict=True)
        if abs(after - before) > LEAST_OFFSET_S
    ]
    return out, tuple(found)


def _steps(age: Array) -> list[int]:
    """Return where ages (N,), s, step from one level to another for good."""
    n = _LEVEL
    if len(age) < 2 * n:
        return []
    windows = np.lib.stride_tricks.sliding_window_view(age, n)
    low, high = windows.min(axis=1), windows.max(axis=1)
    apart = np.maximum(low[n:] - high[:-n], low[:-n] - high[n:])  # of n messages from those before
    return [int(k) + n for k in np.flatnonzero(apart > LEAST_OFFSET_S)]


def offset_by_standstills(image_t: Ids, still: "np.ndarray[tuple[int], np.dtype[np.bool_]]", stands: Ids) -> int | None:
    """Return by how many ns the images' clock is ahead, so that they stand still when the wheels do; None if unknown.

    Parameters
    ----------
    image_t : (F,) ns
        Stamps of frames, ascending.
    still : (F - 1,) bool
        Whether the image stayed the same from each frame to the next.
    stands : (P, 2) ns
        First and last time of each stand of the wheels.
    """
    runs = _runs(image_t, still)
    if len(runs) < _FEWEST or len(stands) < _FEWEST:
        return None
    middles = runs.mean(axis=1)
    places = np.unique(np.round((middles[:, None] - stands.mean(axis=1)[None, :]).ravel() / 5e7)) * 5e7
    best: list[tuple[float, float]] = []
    for offset in places:
        score = 0.0
        moved = runs - offset
        at = np.searchsorted(stands[:, 0], moved[:, 0] + 2e8, side="right") - 1
        for k, last in zip(at, moved[:, 1], strict=True):
            inside = k >= 0 and last - 2e8 <= stands[k, 1]
            score += 1.0 if inside else -1.0
        used = len(set(at[at >= 0].tolist()))
        best.append((score + 0.5 * used, offset))
    best.sort(reverse=True)
    top = [offset for score, offset in best if score >= best[0][0] - 1e-9]
    rest = [score for score, offset in best if abs(offset - np.median(top)) > 1.5e9]
    if best[0][0] < 0.8 * (len(runs) + 0.5 * min(len(runs), len(stands))) or (rest and max(rest) > 0.75 * best[0][0]):
        return None
    return round(float(np.median(top)))


def _runs(
    image_t: Ids, still: "np.ndarray[tuple[int], np.dtype[np.bool_]]"
) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    """Return first and last time of each run of frames that stay the same, (R, 2) ns.

    Runs of less than half the usual length are no stands: two frames are alike where a robot starts or creeps.
    """
    edges = np.diff(np.concatenate([[0], still.astype(np.int8), [0]]))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    runs = np.stack([image_t[first], image_t[last]], axis=1).astype(np.float64).reshape(-1, 2)
    lengths = runs[:, 1] - runs[:, 0]
    return runs[lengths >= 0.5 * np.median(lengths)] if lengths.size else runs
