"""Wheels out of round, or mounted off their centre: the radius varies once a turn."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.cause import OfWheels, Reference, Solved, percent
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State

SIDES = ("right", "left")
TYPICAL = 0.005
"""Standard deviation of the amplitude beforehand, relative."""


@dataclass(frozen=True, slots=True)
class Eccentric(OfWheels):
    """Radii are ``r (1 + c cos phi + s sin phi)``, phi the wheel's reading.

    Attributes
    ----------
    wheels
        Which: 0 is the right one, 1 the left.
    at
        Reference.
    """

    wheels: tuple[int, ...]
    at: Reference

    @property
    def family(self) -> str:
        """One family: one wheel or both."""
        return "eccentric"

    @property
    def cause(self) -> str:
        """The family and the side."""
        return f"eccentric-{SIDES[self.wheels[0]] if len(self.wheels) == 1 else 'both'}"

    @property
    def names(self) -> tuple[str, ...]:
        """Cosine and sine amplitude of each wheel, relative."""
        return tuple(f"{self.cause}-{SIDES[w]}-{part}" for w in self.wheels for part in ("cos", "sin"))

    @property
    def prior(self) -> tuple[float, ...]:
        """Alike for all, so that every phase is as likely."""
        return (TYPICAL,) * (2 * len(self.wheels))

    def columns(self, problem: Problem, state: State) -> Columns:  # noqa: ARG002 (held at the reference)
        """Return the travel by all amplitudes: the integral of the radius over each sample's turn."""
        radii, start = self.at.radii, problem.path.phi_start
        end = start + problem.path.dphi
        travel = np.zeros((len(start), 2, 2 * len(self.wheels)))
        for k, w in enumerate(self.wheels):
            travel[:, w, 2 * k] = radii[w] * (np.sin(end[:, w]) - np.sin(start[:, w]))
            travel[:, w, 2 * k + 1] = -radii[w] * (np.cos(end[:, w]) - np.cos(start[:, w]))
        return Columns(travel=travel)

    def finding(self, solved: Solved, problem: Problem) -> Finding:  # noqa: ARG002 (same for all drives)
        """Return the amplitudes and where the radii are largest; the size is that of the worse wheel."""
        words, sizes = [], []
        for k, w in enumerate(self.wheels):
            rows = slice(2 * k, 2 * k + 2)
            size, sigma = solved.length(rows)
            phase = float(np.degrees(np.arctan2(solved.values[rows][1], solved.values[rows][0])))
            words.append(
                f"the {SIDES[w]} wheel is out of round by {percent(size, sigma)} of its radius (largest at "
                f"{phase:.0f} deg of its reading)"
            )
            sizes.append((100 * size, 100 * sigma))
        size, sigma = max(sizes)
        return Finding(
            cause=self.cause,
            text=" and ".join(words),
            advice="Check the wheels' tyres and seats if you need better odometry over short distances.",
            adopted=True,
            size=size,
            sigma=sigma,
            unit="%",
            p_value=solved.p_value,
        )
