"""The path that the wheels describe between stops, in closed form."""

from dataclasses import dataclass

import numpy as np

from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Legs:
    """Wheel travel of a drive, sample by sample, and where the stops lie in it.

    Attributes
    ----------
    dphi_R, dphi_L : (S,), rad
        Angle travelled in each sample; the samples of all legs one behind the other.
    ends : (P,)
        How many samples lie before each stop; ``ends[0] = 0``, ``ends[-1] = S``.
    """

    dphi_R: Array
    dphi_L: Array
    ends: tuple[int, ...]

    @property
    def phi_R(self) -> Array:
        """Right wheel angle at each stop since the first, (P,), rad."""
        return np.concatenate([[0.0], np.cumsum(self.dphi_R)])[list(self.ends)]

    @property
    def phi_L(self) -> Array:
        """Left wheel angle at each stop since the first, (P,), rad."""
        return np.concatenate([[0.0], np.cumsum(self.dphi_L)])[list(self.ends)]


def legs_between(drive: Correspondences, kept: tuple[int, ...] | None = None) -> Legs:
    """Return the wheel travel between stops; stops not in ``kept`` are driven through."""
    kept = tuple(range(len(drive.stops))) if kept is None else kept
    parts_R, parts_L, ends = [], [], [0]
    for i in range(kept[0], kept[-1]):
        phi_R, phi_L = drive.leg(i)
        parts_R.append(np.diff(phi_R))
        parts_L.append(np.diff(phi_L))
        if i + 1 in kept:
            ends.append(sum(len(p) for p in parts_R))
    none = np.zeros(0)
    return Legs(dphi_R=np.concatenate([none, *parts_R]), dphi_L=np.concatenate([none, *parts_L]), ends=tuple(ends))


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
    dth = aR * legs.dphi_R + aL * legs.dphi_L
    th = np.concatenate([[0.0], np.cumsum(dth)])
    m = 0.5 * (legs.dphi_L - (aR / aL) * legs.dphi_R) * np.sinc(dth / (2 * np.pi))
    middle = th[:-1] + dth / 2
    xy = np.concatenate(
        [np.zeros((1, 2)), np.cumsum(m[:, None] * np.stack([np.cos(middle), np.sin(middle)], 1), axis=0)]
    )
    ends = list(legs.ends)
    return xy[ends], th[ends]


def pair_displacements(xy: Array, heading: Array) -> Array:
    """Return where stop j lies in the frame of stop i for all pairs i < j, (N, 2).

    Parameters
    ----------
    xy : (P, 2)
        Positions of the stops.
    heading : (P,), rad
        Their headings.
    """
    i, j = np.triu_indices(len(xy), 1)
    dx, dy = (xy[j] - xy[i]).T
    c, s = np.cos(heading[i]), np.sin(heading[i])
    return np.stack([c * dx + s * dy, -s * dx + c * dy], axis=1)
