"""Clock offset of the camera as an unknown of the likelihood."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array

LATE = "camera_late"
PRIOR_S = 0.1
"""Standard deviation of the offset beforehand, s."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraLate:
    """Offset of the camera's stamps against the wheels': all frames on the move were taken earlier by it.

    Attributes
    ----------
    rates : (P, 2), rad/s
        How fast the wheels turn at each stop and frame.
    """

    rates: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Its one unknown: stamp less time of exposure, beyond what the times already allow for, s."""
        return (LATE,)

    @property
    def prior(self) -> tuple[float, ...]:
        """Standard deviation beforehand, s."""
        return (PRIOR_S,)

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return what rolls less before each frame, and more behind it, if frames were taken earlier."""
        travel = np.zeros((len(problem.path.dphi), 2, 1))
        speed = self.rates * state.wheels[:2]
        first = problem.path.starts
        last = np.append(first[1:], len(travel)) - 1
        np.add.at(travel[:, :, 0], last, -speed[problem.leg_stop + 1])
        np.add.at(travel[:, :, 0], first, speed[problem.leg_stop])
        return Columns(travel=travel)
