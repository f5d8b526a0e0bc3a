"""A differential drive: its wheels, the wheel travel of a drive, and the path that it describes, in closed form."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids, Mask


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheels:
    """The wheels of a differential drive.

    Attributes
    ----------
    rR, rL : m
        Radii of the right and the left wheel.
    b : m
        Wheel separation (wheelbase in the paper): distance between the wheels' contact points.
    """

    rR: float
    rL: float
    b: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Legs:
    """Wheel travel of a drive, sample by sample, and where the stops lie in it.

    Attributes
    ----------
    dphi_R, dphi_L : (S,), rad
        Angle travelled in each sample; the samples of all legs one behind the other.
    ends : (P,)
        How many samples lie before each stop; ``ends[0] = 0``, ``ends[-1] = S``.
    known : (P - 1,) bool
        Whether the wheels cover the whole path of each leg; all do if not given.
    phi_start : (S, 2), rad
        Readings at the start of each sample, right and left; those since the first stop if not given.
    t_start_ns : (S,), ns
        When each sample began; empty if not given.
    """

    dphi_R: Array
    dphi_L: Array
    ends: tuple[int, ...]
    known: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    phi_start: Array = field(default_factory=lambda: np.zeros((0, 2)))
    t_start_ns: Ids = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        if not self.known.size:
            object.__setattr__(self, "known", np.ones(max(len(self.ends) - 1, 0), dtype=np.bool_))
        if not self.phi_start.size:
            start = [np.concatenate([[0.0], np.cumsum(d)])[:-1] for d in (self.dphi_R, self.dphi_L)]
            object.__setattr__(self, "phi_start", np.stack(start, axis=1))

    @property
    def phi_R(self) -> Array:
        """Right wheel angle at each stop since the first, (P,), rad."""
        return np.concatenate([[0.0], np.cumsum(self.dphi_R)])[list(self.ends)]

    @property
    def phi_L(self) -> Array:
        """Left wheel angle at each stop since the first, (P,), rad."""
        return np.concatenate([[0.0], np.cumsum(self.dphi_L)])[list(self.ends)]


def legs_between(drive: Correspondences, kept: tuple[int, ...] | None = None) -> Legs:
    """Return the wheel travel between stops; stops not in ``kept`` are driven through.

    A leg on which some travel is not known, or no wheel turned, carries no information about the wheels: it is not
    ``known``.
    """
    return _legs_between(drive.wheels, drive.stops, tuple(range(len(drive.stops))) if kept is None else kept)


@lru_cache(maxsize=1)  # views between stops, the four steps and the likelihood ask for the same ones, in turn
def _legs_between(wheels: WheelSamples, stops: tuple[StopObservation, ...], kept: tuple[int, ...]) -> Legs:
    phi, times, at, unknown = _driven(wheels, stops[kept[0] : kept[-1] + 1])
    some = np.array(kept) - kept[0]
    dphi, ends = np.diff(phi, axis=0), at[some]
    turned = np.concatenate([[0], np.cumsum((dphi[:, 0] != 0) | (dphi[:, 1] != 0))])
    return Legs(
        dphi_R=dphi[:, 0],
        dphi_L=dphi[:, 1],
        ends=tuple(ends.tolist()),
        known=(np.diff(unknown[some]) == 0) & (np.diff(turned[ends]) > 0),
        phi_start=phi[:-1],
        t_start_ns=times[:-1],
    )


def _driven(wheels: WheelSamples, stops: tuple[StopObservation, ...]) -> tuple[Array, Ids, Ids, Ids]:
    """Return the wheel angles from one stop to another, (S + 1, 2), rad, and their times, ns.

    And of each stop (P,), where it is among them, and how many samples before it are not covered.
    """
    leaves = np.array([stop.last_sample + 1 for stop in stops[:-1]], dtype=np.int64)
    arrives = np.array([stop.first_sample for stop in stops[1:]], dtype=np.int64)
    way = slice(leaves[0], arrives[-1] + 1) if len(leaves) else slice(0, 0)
    count = way.stop - way.start
    on_the_way = np.zeros(count + 1, dtype=np.int64)
    np.add.at(on_the_way, leaves - way.start, 1)
    np.add.at(on_the_way, arrives - way.start, -1)
    at = np.concatenate([[0], np.cumsum(arrives - leaves + 1)])
    at_stop = np.zeros(at[-1] + 1, dtype=np.bool_)
    at_stop[at] = True
    row = np.empty(at[-1] + 1, dtype=np.int64)
    row[at] = count + np.arange(len(stops))
    row[~at_stop] = np.flatnonzero(np.cumsum(on_the_way))
    lost = np.concatenate([[0], np.cumsum(~wheels.covered[way])])
    unknown = np.concatenate([[0], np.cumsum(lost[arrives + 1 - way.start] - lost[leaves - way.start])])
    angles = [
        np.append(wheels.phi_R[way], [stop.phi_R for stop in stops]),
        np.append(wheels.phi_L[way], [stop.phi_L for stop in stops]),
    ]
    times = np.append(wheels.t_ns[way], np.array([stop.t_end_ns for stop in stops], dtype=np.int64))
    return np.stack(angles, axis=1)[row], times[row], at, unknown


def chord_lengths(distance: Array, turn: Array) -> Array:
    """Return the chords of arcs, m: exact for constant wheel speeds within a sample.

    Parameters
    ----------
    distance, turn : (...), m and rad
        Along the arcs.
    """
    h2 = (turn / 2) ** 2
    if np.all(h2 < _SMALL_TURN2):
        return np.asarray(distance * (1 - h2 / 6 * (1 - h2 / 20 * (1 - h2 / 42))))
    return np.asarray(distance * np.sinc(turn / (2 * np.pi)))


_SMALL_TURN2 = 1e-3
"""Square of half a turn, rad^2, below which a series to its sixth power is exact to rounding."""


def unit_path(legs: Legs, aR: float, aL: float) -> tuple[Array, Array]:
    """Return the stops' positions (P, 2), in units of rL, and headings (P,), rad, in the frame of the first stop.

    ``beta = sum_k m_k (cos(th_k + dth_k/2), sin(th_k + dth_k/2))``, ``m_k = (-(aR/aL) dphi_R + dphi_L)/2`` (eq. 28),
    with m_k multiplied by ``sin(dth_k/2)/(dth_k/2)``: exact for constant wheel speeds within a sample (the chord of an
    arc), where eq. 28 is its first order. Prefix sums give every stop, and so every pair of stops, at once.

    Parameters
    ----------
    legs
        Wheel travel.
    aR, aL
        ``rR / b`` and ``-rL / b``.
    """
    xy, th = dead_reckoned(legs.dphi_R, legs.dphi_L, aR, aL)
    ends = list(legs.ends)
    return xy[ends], th[ends]


def dead_reckoned(dphi_R: Array, dphi_L: Array, aR: float, aL: float) -> tuple[Array, Array]:
    """Return positions (S + 1, 2), in units of rL, and headings (S + 1,), rad, before and after each of S samples.

    In the frame of the first; see :func:`unit_path`.

    Parameters
    ----------
    dphi_R, dphi_L : (S,), rad
        Angle travelled in each sample.
    aR, aL
        ``rR / b`` and ``-rL / b``.
    """
    dth = aR * dphi_R + aL * dphi_L
    th, xy = np.zeros(len(dth) + 1), np.zeros((2, len(dth) + 1))
    np.cumsum(dth, out=th[1:])
    m = chord_lengths(0.5 * (dphi_L - (aR / aL) * dphi_R), dth)
    middle = th[:-1] + dth / 2
    np.cumsum(m * np.cos(middle), out=xy[0, 1:])
    np.cumsum(m * np.sin(middle), out=xy[1, 1:])
    return xy.T, th


_ALL_PAIRS = 100
"""Stops up to which all pairs are taken: nearly 5,000."""
_GAPS = 16
"""Of more stops this many distances within the drive, from neighbours to its whole length."""


@lru_cache(maxsize=4)
def stop_pairs(stops: int) -> tuple[Ids, Ids]:
    """Return the pairs of stops i < j that moves are taken between, (N,) each: all, or of many stops some.

    Of many stops the pairs are those a few stops, a few dozen and so on apart: their number grows with the stops, not
    with their square.
    """
    i, j = np.triu_indices(stops, 1)
    if stops > _ALL_PAIRS:
        some = np.isin(j - i, np.geomspace(1, stops - 1, _GAPS).round())
        i, j = i[some], j[some]
    for part in (i, j):
        part.flags.writeable = False  # it is kept
    return i, j


def pair_displacements(xy: Array, heading: Array) -> Array:
    """Return where stop j lies in the frame of stop i for pairs i < j (see :func:`stop_pairs`), (N, 2).

    Parameters
    ----------
    xy : (P, 2)
        Positions of the stops.
    heading : (P,), rad
        Their headings.
    """
    i, j = stop_pairs(len(xy))
    dx, dy = (xy[j] - xy[i]).T
    c, s = np.cos(heading[i]), np.sin(heading[i])
    return np.stack([c * dx + s * dy, -s * dx + c * dy], axis=1)
