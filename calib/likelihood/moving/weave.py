"""Frames on the move set among the stops of drives, at the times that the camera's clock gives them.

Wheel readings at a frame's time are interpolated and become samples of their own, so that a frame is a stop of no
length: each leg falls into parts, and the slip of each is the noise of what the wheels rolled in it.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from boxcal.calib.likelihood.moving.clock import RATE, Clocks, since_middle_s, suffixes
from boxcal.calib.likelihood.moving.course import ORDERS, wheel_course
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.arrays import Array, Ids, Mask

_LEAST_RATE = 0.05
"""Wheel rate (rad/s) below which a frame carries no information about the clocks, and may belong to a stand."""
_ROOM_NS = 2
"""Least time between two samples that a third fits between."""
APART_S = 0.005
"""Frames nearer in time than this to a stop or to each other are not used: hardly anything rolls between."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Woven:
    """Drives whose stops and frames on the move stand in one row.

    Attributes
    ----------
    drives
        Each with its stops and frames, in order of time.
    drive : (P,)
        The drive of each place in the row.
    frame : (P,)
        Number of the moving frame at each place, counted through all drives; -1 for a stop.
    since_s : (P,), s
        Stamps of frames since the middle of their drive's; 0 at stops.
    course : (P, 3, 2)
        How the right and the left wheel turn there, see :mod:`boxcal.calib.likelihood.moving.course`; 0 at stops.
    bend : (P, 2), rad
        By how much readings may be wrong for being interpolated; 0 at stops.
    allowed
        Values of unknowns with priors that the places allow for already, by name: the clocks' rates.
    """

    drives: tuple[Correspondences, ...]
    drive: Ids
    frame: Ids
    since_s: Array
    course: Array
    bend: Array
    allowed: Mapping[str, float] = field(default_factory=dict)

    @property
    def rates(self) -> Array:
        """Rates of the right and the left wheel at each place, (P, 2), rad/s; 0 at stops."""
        return self.course[:, 0]

    @property
    def moving(self) -> Ids:
        """Places of the frames in the row, (F,)."""
        return np.flatnonzero(self.frame >= 0)


def weave_drives(drives: Sequence[Correspondences], kept: Sequence[Ids], frames: Ids, clocks: Clocks) -> Woven:
    """Return drives with some frames on the move set among some of their stops; see :func:`weave`.

    Parameters
    ----------
    drives
        One behind the other.
    kept
        Numbers of the stops to use, for each drive.
    frames : (F,)
        Numbers of the frames to use, counted through all drives, ascending.
    clocks
        Of the drives.
    """
    starts = np.cumsum([0, *(len(drive.moving) for drive in drives)])
    parts = []
    for d, (drive, stops) in enumerate(zip(drives, kept, strict=True)):
        own = frames[(frames >= starts[d]) & (frames < starts[d + 1])] - starts[d]
        parts.append(weave(drive, stops, own, clocks.late(d, since_middle_s(drive, own))))
    return Woven(
        drives=tuple(part.drives[0] for part in parts),
        drive=np.repeat(np.arange(len(parts)), [len(part.frame) for part in parts]),
        frame=np.concatenate([np.where(p.frame < 0, -1, p.frame + starts[d]) for d, p in enumerate(parts)]),
        since_s=np.concatenate([part.since_s for part in parts]),
        course=np.concatenate([part.course for part in parts]),
        bend=np.concatenate([part.bend for part in parts]),
        allowed={f"{RATE}{suffix}": float(r) for suffix, r in zip(suffixes(len(parts)), clocks.rate, strict=True)},
    )


def weave(drive: Correspondences, kept: Ids, frames: Ids, late_s: Array | float) -> Woven:
    """Return a drive with some frames on the move set among some of its stops.

    Frames that the offset puts into a stand, before the first or behind the last stop, where the wheels hardly turn or
    where their travel is not known are passed over.

    Parameters
    ----------
    drive
        The drive, with its frames on the move. Without any stop, all of its path counts.
    kept : (K,)
        Numbers of the stops to use, ascending.
    frames : (F,)
        Numbers of the frames to use, ascending.
    late_s : (F,) or one for all, s
        Stamp of each less the time at which it was taken.
    """
    wheels = drive.wheels
    t0 = int(wheels.t_ns[0])
    t = (wheels.t_ns - t0) / 1e9
    at = np.array([(drive.moving[f].t_ns - t0) / 1e9 for f in frames]) - late_s
    kept = kept if drive.stops else kept[:0]
    usable = _between_stops(drive, kept, at, t0) if drive.stops else (at > t[0]) & (at < t[-1])
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    # a frame stamped as a sample that was woven in before does not fit between the two: it goes before both
    after = after - ((wheels.t_ns[after] - wheels.t_ns[after - 1] < _ROOM_NS) & (after > 1))
    phi = np.stack([wheels.phi_R, wheels.phi_L], axis=1)
    course = wheel_course(wheels, t0 + np.rint(at * 1e9).astype(np.int64), after)
    usable &= ((np.abs(course[:, 0]).max(axis=1) > _LEAST_RATE) | (len(kept) == 0)) & wheels.covered[after]
    usable &= np.diff(at, prepend=-np.inf) > APART_S
    rows = np.flatnonzero(usable)
    at, after, course = at[rows], after[rows], course[rows]
    fraction = ((at - t[after - 1]) / (t[after] - t[after - 1]))[:, None]
    between = phi[after - 1] + fraction * (phi[after] - phi[after - 1])
    around = phi[np.minimum(after + 1, len(t) - 1)] - phi[after] - phi[after - 1] + phi[np.maximum(after - 2, 0)]
    bend = np.abs(around) / 2 * fraction * (1 - fraction) / 2
    stamps = np.maximum(np.round(at * 1e9).astype(np.int64) + t0, wheels.t_ns[after - 1] + 1)
    stamps = np.minimum(stamps, wheels.t_ns[after] - 1)
    more = replace(
        wheels,
        t_ns=np.insert(wheels.t_ns, after, stamps),
        phi_R=np.insert(wheels.phi_R, after, between[:, 0]),
        phi_L=np.insert(wheels.phi_L, after, between[:, 1]),
        covered=np.insert(wheels.covered, after, True),
    )
    stops = [_shifted(drive.stops[int(j)], after) for j in kept]
    sample = after + np.arange(len(after))
    seen = [_as_stop(drive, int(frames[row]), int(sample[k]), between[k], int(stamps[k])) for k, row in enumerate(rows)]
    order = np.argsort([s.first_sample for s in (*stops, *seen)], kind="stable")
    nothing = np.zeros((len(stops), ORDERS, 2))
    return Woven(
        drives=(_with(drive, wheels=more, stops=tuple((*stops, *seen)[k] for k in order), moving=()),),
        drive=np.zeros(len(order), dtype=np.int64),
        frame=np.concatenate([np.full(len(stops), -1), np.asarray(frames)[rows]]).astype(np.int64)[order],
        since_s=np.concatenate([np.zeros(len(stops)), since_middle_s(drive, np.asarray(frames)[rows])])[order],
        course=np.concatenate([nothing, course])[order],
        bend=np.concatenate([nothing[:, 0], bend])[order],
    )


def _between_stops(drive: Correspondences, kept: Ids, at: Array, t0: int) -> Mask:
    """Return whether times (F,), s, lie between the first and the last stop that count, and in no stand, (F,) bool."""
    if not len(kept):
        return np.zeros(len(at), dtype=np.bool_)
    spans = np.array([(s.t_start_ns - t0, s.t_end_ns - t0) for s in drive.stops]) / 1e9
    standing = np.zeros(len(at), dtype=np.bool_)
    for start, end in spans:
        standing |= (at > start - APART_S) & (at < end + APART_S)
    return np.asarray(~standing & (at > spans[kept[0], 1]) & (at < spans[kept[-1], 0]))


def _shifted(stop: StopObservation, inserted: Ids) -> StopObservation:
    """Return a stop with its samples numbered anew, samples inserted before those at some numbers."""
    before = int(np.searchsorted(inserted, stop.first_sample, side="right"))
    return _with(stop, first_sample=stop.first_sample + before, last_sample=stop.last_sample + before)


Kept = TypeVar("Kept", Correspondences, StopObservation)


def _with(whole: Kept, **changes: Any) -> Kept:
    """Return a copy with some fields otherwise, whose landmarks are not checked again: they were when it was made."""
    out = copy(whole)
    for name, value in changes.items():
        object.__setattr__(out, name, value)
    return out


def _as_stop(drive: Correspondences, number: int, sample: int, phi: Array, t_ns: int) -> StopObservation:
    """Return a frame as a stop of one sample."""
    frame = drive.moving[number]
    return StopObservation(
        t_start_ns=t_ns,
        t_end_ns=t_ns,
        first_sample=sample,
        last_sample=sample,
        phi_R=float(phi[0]),
        phi_L=float(phi[1]),
        landmark_ids=frame.landmark_ids,
        p_box=frame.p_box,
        faces=frame.faces,
        uv_px=frame.uv_px,
        cov_px2=frame.cov_px2,
        frames=1,
    )
