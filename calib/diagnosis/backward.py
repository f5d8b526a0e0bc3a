"""Wheels whose radius is another one rolling backward than rolling forward: tyres that creep, or weight that shifts."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.cause import OfWheels, Reference, Solved, one_column, percent
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State


@dataclass(frozen=True, slots=True)
class Backward(OfWheels):
    """Both radii grow by a fraction while a wheel rolls backward."""

    at: Reference
    family: str = "backward"
    names: tuple[str, ...] = ("backward",)
    prior: tuple[float, ...] = (0.005,)

    def columns(self, problem: Problem, state: State) -> Columns:  # noqa: ARG002 (held at the reference)
        """Return the travel of all backward samples."""
        u = self.at.travel(problem)
        return Columns(travel=one_column(np.where(problem.path.dphi < 0, u, 0.0)))

    def finding(self, solved: Solved, problem: Problem) -> Finding:  # noqa: ARG002
        """Return by how much the radii differ."""
        value, sigma = float(solved.values[0]), float(solved.sigma[0])
        return Finding(
            cause="backward",
            text=f"rolling backward the wheels' radii are {percent(abs(value), sigma)} "
            f"{'larger' if value > 0 else 'smaller'} than rolling forward; the radii given are those forward",
            advice="Soft tyres and a load that shifts do this; drive forward where odometry matters.",
            adopted=True,
            size=100 * value,
            sigma=100 * sigma,
            unit="%",
            p_value=solved.p_value,
        )
