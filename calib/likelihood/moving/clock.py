"""Camera's clock against the wheels': an offset and a rate for each drive, as unknowns of the likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids

LATE, RATE = "camera_late", "camera_clock_rate"
PRIOR_S = 0.1
"""Standard deviation of the offset beforehand, s."""
PRIOR_RATE = 2e-4
"""Standard deviation of the rate beforehand, s/s: crystals differ by 100 ppm, stamps that count frames by 1000."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clocks:
    """Stamps of a camera's frames against the wheels' clock in D drives (or those of D cameras in one).

    Attributes
    ----------
    late_s : (D,), s
        Stamp of a frame less the time at which it was taken, in the middle of the drive's frames.
    rate : (D,), s/s
        How much later frames are stamped for each second that passes.
    """

    late_s: Array
    rate: Array

    def late(self, drive: int | Ids, since_s: Array) -> Array:
        """Return the offsets, (F,), s, of frames stamped some time (F,), s, after the middle of a drive's frames."""
        return np.asarray(self.late_s[drive] + self.rate[drive] * since_s)

    def plus(self, late_s: Array, rate: Array) -> "Clocks":
        """Return the clocks with corrections (D,) of both."""
        return Clocks(late_s=self.late_s + late_s, rate=self.rate + rate)


def one_time(drives: int) -> Clocks:
    """Return clocks that agree with the wheels'."""
    return Clocks(late_s=np.zeros(drives), rate=np.zeros(drives))


def since_middle_s(drive: Correspondences, frames: Ids) -> Array:
    """Return how long after the middle of a drive's frames some of them, (F,), are stamped, (F,), s."""
    t_ns = np.array([frame.t_ns for frame in drive.moving], dtype=np.int64)
    return np.asarray((t_ns[frames] - (t_ns[0] + t_ns[-1]) // 2) / 1e9) if len(t_ns) else np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraClock:
    """Offset and rate of the camera's stamps against the wheels' in each drive.

    Attributes
    ----------
    rates : (P, 2), rad/s
        How fast the wheels turn at each stop and frame.
    since_s : (P,), s
        Stamps since the middle of the drive's frames.
    drive : (P,)
        The drive of each.
    drives
        How many there are.
    """

    rates: Array
    since_s: Array
    drive: Ids
    drives: int

    @property
    def names(self) -> tuple[str, ...]:
        """All offsets, s, then all rates: beyond what the frames' times already allow for."""
        return tuple(f"{name}{suffix}" for name in (LATE, RATE) for suffix in suffixes(self.drives))

    @property
    def prior(self) -> tuple[float, ...]:
        """Standard deviations beforehand, s and s/s."""
        return (PRIOR_S,) * self.drives + (PRIOR_RATE,) * self.drives

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return what rolls less before each frame, and more behind it, if frames were taken earlier."""
        D = self.drives
        speed = np.zeros((len(self.drive), 2, 2 * D))
        rows = np.arange(len(self.drive))
        at = self.rates * state.wheels[:2]
        speed[rows, :, self.drive] = at
        speed[rows, :, D + self.drive] = at * self.since_s[:, None]
        travel = np.zeros((len(problem.path.dphi), 2, 2 * D))
        first = problem.path.starts
        last = np.append(first[1:], len(travel)) - 1
        np.add.at(travel, last, -speed[problem.leg_stop + 1])
        np.add.at(travel, first, speed[problem.leg_stop])
        return Columns(travel=travel)


def suffixes(drives: int) -> Sequence[str]:
    """Return what follows the names of what each drive has of its own."""
    return [""] if drives == 1 else [f"_{d + 1}" for d in range(drives)]
