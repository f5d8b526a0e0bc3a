"""Detection of stops from the wheels alone.

A *stand* is a run of samples in which each wheel stays within a band of a little more than one encoder step, for long
enough. Slow creep seen through a coarse encoder looks like a stand too, until the next step comes; what separates them
apart needs no speed: a robot that stood leaves the place (several bands away) in less time than it stood there, a
creeping one never does. Everything is scale-free but the shortest stand and the smallest band. Noise of the
readings widens the band: it is read off the quietest part of the drive.
"""

from dataclasses import dataclass

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array

MIN_STOPS = 3
"""Places at which a robot must stand still: with two pairs of motions the four steps determine the camera
extrinsics."""
_BAND_STEPS = 1.5
_BAND_SIGMAS = 8.0
"""From the lowest to the highest of some thousand readings with normal noise."""
_QUIET = 0.2
"""Part of the time that a robot stands at least: noise is read off the quietest of its readings."""
_FEWEST_READINGS = 8
_AWAY_BANDS = 3.0
_CREEP_RATIO = 1.25
_AT_END_RATIO = 0.5
_SAME_PLACE_BANDS = 0.8
_BLOCK = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class StopSettings:
    """Settings of the detection of stops.

    Attributes
    ----------
    min_stand : s
        Shortest stop.
    max_angle : rad
        How far a wheel may wander in a stop; with an encoder coarser than this, one and a half of its steps.
    """

    min_stand: float = 0.4
    max_angle: float = 0.003

    def __post_init__(self) -> None:
        for name in ("min_stand", "max_angle"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise DetectError(f"{name} is {value}, a positive number is needed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """One time that the robot stood still.

    Attributes
    ----------
    t_start_ns, t_end_ns : ns
        Stamps of the first and last sample at rest.
    first_sample, last_sample
        Their rows.
    phi_R, phi_L : rad
        Median wheel angles.
    """

    t_start_ns: int
    t_end_ns: int
    first_sample: int
    last_sample: int
    phi_R: float
    phi_L: float


def find_stops(wheels: WheelSamples, settings: StopSettings | None = None) -> tuple[Stop, ...]:
    """Return the stops in order of time.

    Parameters
    ----------
    wheels
        Samples at any rate, with or without gaps.
    settings
        The defaults if None.
    """
    settings = settings or StopSettings()
    if len(wheels) < 2:
        return ()
    t = (wheels.t_ns - wheels.t_ns[0]) / 1e9
    noise = np.array([rest_noise(t, phi, settings.min_stand) for phi in (wheels.phi_R, wheels.phi_L)])
    band = np.maximum.reduce(
        [np.full(2, settings.max_angle), _BAND_STEPS * np.array(wheels.encoder_steps), _BAND_SIGMAS * noise]
    )
    q = np.stack([wheels.phi_R, wheels.phi_L], axis=1) / band  # in bands: still means a range of at most 1
    runs = [run for run in _still_runs(t, q, settings.min_stand) if t[run[1]] - t[run[0]] >= settings.min_stand]
    runs = [run for run in _joined(q, runs) if _left_faster_than_stood(t, q, run)]
    return tuple(_stop(wheels, first, last) for first, last in _longest_of_nudged(t, q, runs))


def rest_noise(t: Array, phi: Array, min_stand: float) -> float:
    """Return the standard deviation of one wheel's readings while it stands, rad.

    Second differences of readings do not see steady motion; of windows half as long as the shortest stop the quietest
    fifth counts. A clean encoder that stands reads the same: zero.

    Parameters
    ----------
    t : (S,), s
    phi : (S,), rad
    min_stand : s
        Shortest stop.
    """
    if phi.size < 5 * _FEWEST_READINGS:
        return 0.0
    window = max(int(min_stand / 2 / float(np.median(np.diff(t)))), _FEWEST_READINGS)
    bend = phi[2:] - 2 * phi[1:-1] + phi[:-2]
    count = bend.size // window
    if count < 5:
        return 0.0
    squares = np.mean(bend[: count * window].reshape(count, window) ** 2, axis=1)
    quiet = np.sort(squares)[: max(int(_QUIET * count), 1)]
    return float(np.sqrt(np.median(quiet) / 6))  # of white noise a second difference has six times the variance


def _stop(wheels: WheelSamples, first: int, last: int) -> Stop:
    rows = slice(first, last + 1)
    return Stop(
        t_start_ns=int(wheels.t_ns[first]),
        t_end_ns=int(wheels.t_ns[last]),
        first_sample=first,
        last_sample=last,
        phi_R=float(np.median(wheels.phi_R[rows])),
        phi_L=float(np.median(wheels.phi_L[rows])),
    )


def _still_runs(t: Array, q: Array, min_stand: float) -> list[tuple[int, int]]:
    """Return runs (first, last) within one band, cut greedily from the stretches that can hold a stand.

    Any sample of a stand of length T keeps within the band for T/2 after it or before it.
    """
    later = np.searchsorted(t, t + min_stand / 2, side="right") - 1
    sooner = np.searchsorted(t, t - min_stand / 2, side="left")
    near = [np.all(np.abs(q[other] - q) <= 1, axis=1) for other in (later, sooner)]
    edges = np.diff(np.concatenate([[0], (near[0] | near[1]).astype(np.int8), [0]]))
    runs = []
    for begin, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        first = int(begin)
        while first < end:
            last = _end_of_band(q, first, int(end))
            runs.append((first, last))
            first = last + 1
    return runs


def _end_of_band(q: Array, first: int, end: int) -> int:
    """Return the last sample before ``end`` up to which all samples from ``first`` span at most one band."""
    size, high, low, at = _BLOCK, q[first], q[first], first
    while at < end:
        block = q[at : min(at + size, end)]
        highs = np.maximum(np.maximum.accumulate(block), high)
        lows = np.minimum(np.minimum.accumulate(block), low)
        out = np.flatnonzero(np.any(highs - lows > 1, axis=1))
        if out.size:
            return at + int(out[0]) - 1
        high, low, at, size = highs[-1], lows[-1], at + len(block), size * 2
    return end - 1


def _left_faster_than_stood(t: Array, q: Array, run: tuple[int, int]) -> bool:
    """Return whether a stand is none of slow creep: coming and going took little longer than the stand.

    Where the log ends before the robot got away, it must have stood for most of what is left of it.
    """
    first, last = run
    centre = np.median(q[first : last + 1], axis=0)
    stood = t[last] - t[first]
    limit = _CREEP_RATIO * stood
    stop = int(np.searchsorted(t, t[last] + 2 * limit, side="right"))
    start = int(np.searchsorted(t, t[first] - 2 * limit, side="left"))
    after = np.flatnonzero(np.any(np.abs(q[last + 1 : stop] - centre) > _AWAY_BANDS, axis=1))
    before = np.flatnonzero(np.any(np.abs(q[start:first] - centre) > _AWAY_BANDS, axis=1))
    leaving = t[last + int(after[0])] - t[last] if after.size else t[stop - 1] - t[last]
    arriving = t[first] - t[start + int(before[-1]) + 1] if before.size else t[first] - t[start]
    leave_limit = limit if after.size or stop < t.size else _AT_END_RATIO * stood
    arrive_limit = limit if before.size or start > 0 else _AT_END_RATIO * stood
    return bool(leaving <= leave_limit and arriving <= arrive_limit)


def _joined(q: Array, runs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join runs in one place that no motion parts: a flicker or a glitch split them."""
    out: list[tuple[int, int]] = []
    for run in runs:
        if out and not _moved_between(q, out[-1], run) and _apart(q, out[-1], run) <= _SAME_PLACE_BANDS:
            out[-1] = (out[-1][0], run[1])
        else:
            out.append(run)
    return out


def _longest_of_nudged(t: Array, q: Array, runs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Keep the longest of runs a little apart that no real motion parts: the robot was nudged, or settled late."""
    out: list[tuple[int, int]] = []
    for run in runs:
        if not out or _moved_between(q, out[-1], run):
            out.append(run)
        elif t[run[1]] - t[run[0]] > t[out[-1][1]] - t[out[-1][0]]:
            out[-1] = run
    return out


def _moved_between(q: Array, run: tuple[int, int], later: tuple[int, int]) -> bool:
    centre = np.median(q[run[0] : run[1] + 1], axis=0)
    return bool(np.any(np.abs(q[run[1] : later[0] + 1] - centre) > _AWAY_BANDS))


def _apart(q: Array, run: tuple[int, int], later: tuple[int, int]) -> float:
    centres = [q[first : last + 1].mean(axis=0) for first, last in (run, later)]
    return float(np.max(np.abs(centres[1] - centres[0])))
