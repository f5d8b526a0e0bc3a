"""Backlash between encoder and wheel: after each reversal the encoder turns before the wheel does."""

from dataclasses import dataclass
from math import radians

import numpy as np

from boxcal.calib.diagnosis.cause import OfWheels, Reference, Solved
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True)
class Backlash(OfWheels):
    """Each wheel stands still while its encoder turns by an angle after a reversal."""

    at: Reference
    family: str = "backlash"
    names: tuple[str, ...] = ("backlash-right", "backlash-left")
    prior: tuple[float, ...] = (radians(1.0), radians(1.0))

    def columns(self, problem: Problem, state: State) -> Columns:  # noqa: ARG002 (held at the reference)
        """Return the travel lost at reversals, all in the first sample after each."""
        travel = np.zeros((len(problem.path.dphi), 2, 2))
        drive = problem.drive[problem.leg_stop][problem.path.leg]
        for k in (0, 1):
            travel[:, k, k] = -self.at.radii[k] * _reversals(problem.path.dphi[:, k], drive)
        return Columns(travel=travel)

    def possible(self, solved: Solved) -> bool:
        """Whether wheels lag behind their encoders: a backlash is not negative, and clearly there."""
        return bool(np.sum(solved.values) > 2 * np.sqrt(np.sum(solved.cov)))

    def finding(self, solved: Solved, problem: Problem) -> Finding:  # noqa: ARG002
        """Return the backlash of both wheels and their mean."""
        right, left = np.degrees(solved.values)
        sigma = np.degrees(solved.sigma)
        mean = np.array([0.5, 0.5])
        return Finding(
            cause="backlash",
            text=f"between encoders and wheels there is a backlash of {right:.2f} +- {sigma[0]:.2f} deg (right) and "
            f"{left:.2f} +- {sigma[1]:.2f} deg (left)",
            advice="Tighten the wheels on their shafts, or read the encoders at the wheels.",
            adopted=True,
            size=float((right + left) / 2),
            sigma=float(np.degrees(np.sqrt(mean @ solved.cov @ mean))),
            unit="deg",
            p_value=solved.p_value,
        )


def _reversals(dphi: Array, drive: Ids) -> Array:
    """Return the new direction (+-1) at samples in which a wheel first reverses, else 0: (S,)."""
    out = np.zeros(len(dphi))
    for d in np.unique(drive):
        moving = np.flatnonzero((dphi != 0) & (drive == d))
        direction = np.sign(dphi[moving])
        back = np.flatnonzero(direction[1:] != direction[:-1]) + 1
        out[moving[back]] = direction[back]
    return out
