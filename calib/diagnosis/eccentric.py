"""A wheel out of round, or mounted off its centre: its radius varies once a turn."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.cause import Solved, percent
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State

SIDES = ("right", "left")
TYPICAL = 0.01
"""Standard deviation of the amplitude beforehand, relative."""


@dataclass(frozen=True, slots=True)
class Eccentric:
    """One wheel's radius is ``r (1 + c cos phi + s sin phi)``, phi its reading: wheel 0 is the right one."""

    wheel: int

    @property
    def family(self) -> str:
        """One family for each wheel."""
        return f"eccentric-{SIDES[self.wheel]}"

    @property
    def names(self) -> tuple[str, ...]:
        """Cosine and sine amplitude, relative."""
        return (f"{self.family}-cos", f"{self.family}-sin")

    @property
    def prior(self) -> tuple[float, ...]:
        """Alike for both, so that every phase is as likely."""
        return (TYPICAL, TYPICAL)

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return the travel by both amplitudes: the integral of the radius over each sample's turn."""
        start = problem.path.phi_start[:, self.wheel]
        end = start + problem.path.dphi[:, self.wheel]
        travel = np.zeros((len(start), 2, 2))
        r = state.wheels[self.wheel]
        travel[:, self.wheel, 0] = r * (np.sin(end) - np.sin(start))
        travel[:, self.wheel, 1] = -r * (np.cos(end) - np.cos(start))
        return Columns(travel=travel)

    def finding(self, solved: Solved, problem: Problem) -> Finding:  # noqa: ARG002 (same for all drives)
        """Return the amplitude and where the radius is largest."""
        size, sigma = solved.length()
        phase = float(np.degrees(np.arctan2(solved.values[1], solved.values[0])))
        return Finding(
            cause=self.family,
            text=f"the {SIDES[self.wheel]} wheel is out of round by {percent(size, sigma)} of its radius (largest at "
            f"{phase:.0f} deg of its reading)",
            advice=f"Check the {SIDES[self.wheel]} wheel's tyre and seat if you need better odometry over short ways.",
            adopted=True,
            size=100 * size,
            sigma=100 * sigma,
            unit="%",
            p_value=solved.p_value,
        )
