"""Wheel travel of all legs, sample by sample."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.geometry.diff_drive import Legs
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelPath:
    """Wheel travel of all legs, one behind the other.

    Attributes
    ----------
    dphi : (S, 2), rad
        Angle travelled in each sample, right and left.
    starts : (N,)
        First sample of each leg.
    leg : (S,)
        The leg that each sample belongs to.
    moving : ((Q,), (Q',))
        Samples in which the right and the left wheel turned.
    phi_start : (S, 2), rad
        Readings at the start of each sample.
    t_start_ns : (S,), ns
        When each sample began; empty where that is not known.
    """

    dphi: Array
    starts: Ids
    leg: Ids
    moving: tuple[Ids, Ids]
    phi_start: Array
    t_start_ns: Ids

    @property
    def legs(self) -> int:
        """Number of legs."""
        return len(self.starts)


def wheel_path(drives: list[Legs]) -> WheelPath:
    """Return the wheel travel of several drives as one."""
    dphi = np.concatenate([np.zeros((0, 2)), *(np.stack([d.dphi_R, d.dphi_L], axis=1) for d in drives)])
    counts = np.concatenate([np.zeros(0, dtype=np.int64), *(np.diff(d.ends) for d in drives)]).astype(np.int64)
    return WheelPath(
        dphi=dphi,
        starts=np.cumsum(counts) - counts,
        leg=np.repeat(np.arange(len(counts), dtype=np.int64), counts),
        moving=(np.flatnonzero(dphi[:, 0]), np.flatnonzero(dphi[:, 1])),
        phi_start=np.concatenate([np.zeros((0, 2)), *(d.phi_start for d in drives)]),
        t_start_ns=np.concatenate([np.zeros(0, dtype=np.int64), *(d.t_start_ns for d in drives)]),
    )
