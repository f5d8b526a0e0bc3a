"""Clock offset between images and wheels, estimated from when messages were recorded."""

from dataclasses import dataclass

import numpy as np

from boxcal.target.arrays import Ids

LEAST_OFFSET_S = 0.4
"""Smaller differences are what images take to arrive; stops are longer."""
_MAX_SPREAD_S = 0.5
_FEWEST = 3


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
    copies of the stamps tell nothing.
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


def offset_by_standstills(image_t: Ids, still: "np.ndarray[tuple[int], np.dtype[np.bool_]]", stands: Ids) -> int | None:
    """Return by how many ns the images' clock is ahead, so that they stand still when the wheels do; None if unknown.

    Parameters
    ----------
    image_t : (F,) ns
        Stamps of frames, ascending.
    still : (F - 1,) bool
        Whether the picture stayed the same from each frame to the next.
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
