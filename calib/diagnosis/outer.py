"""Wheels whose radius depends on being the outer or the inner one of a bend: the load shifts to one side."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.cause import OfWheels, Reference, Solved, one_column, percent
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State


@dataclass(frozen=True, slots=True)
class Outer(OfWheels):
    """The outer wheel's radius grows by half a fraction and the inner one's shrinks by as much."""

    at: Reference
    family: str = "outer"
    names: tuple[str, ...] = ("outer",)
    prior: tuple[float, ...] = (0.005,)

    def columns(self, problem: Problem, state: State) -> Columns:  # noqa: ARG002 (held at the reference)
        """Return half the travel of outer wheels and less half that of inner ones."""
        u = self.at.travel(problem)
        sides = np.sign(np.abs(u[:, :1]) - np.abs(u[:, 1:])) * (0.5, -0.5)
        return Columns(travel=one_column(u * sides))

    def finding(self, solved: Solved, problem: Problem) -> Finding:  # noqa: ARG002
        """Return by how much the radii differ."""
        value, sigma = float(solved.values[0]), float(solved.sigma[0])
        return Finding(
            cause="outer",
            text=f"in bends the outer wheel's radius is {percent(abs(value), sigma)} "
            f"{'larger' if value > 0 else 'smaller'} than the inner one's, beside their own difference",
            advice="Drive bends slower, or pump up the tyres.",
            adopted=True,
            size=100 * value,
            sigma=100 * sigma,
            unit="%",
            p_value=solved.p_value,
        )
