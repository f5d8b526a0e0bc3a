"""Wheels that scrub in turns: the robot turns less than they roll, unlike to both sides, or slides sideways.

What is lost alike in all turns cannot be told from a larger distance between the wheels: both scale every turn. Nor can
a slide outward in every turn be told from a camera further ahead: both move the centre of turning. So the test looks at
what differs (one side against the other, on the spot against in bends, a drift to one side), and where that is found,
a loss alike in all turns and a shift of the centre are allowed for: the odometry stays as good as it is, the distance
between the wheels and the camera's place ahead, as a ruler would find them, become as unsure as they are.
"""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.cause import OfWheels, Reference, Solved, percent
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.leg_model import leg_model
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array

TYPICAL = 0.01
"""Fraction of a turn that wheels scrub away, standard deviation beforehand."""
PARTS = ("side", "spot", "drift")
_ON_SPOT = 0.1
"""A turn is on the spot where the robot moves less than this fraction of what its rims do."""


@dataclass(frozen=True, slots=True)
class Scrub(OfWheels):
    """Turns lose a fraction: to the left more than to the right, on the spot more; the robot drifts to the left.

    Attributes
    ----------
    at
        Reference.
    parts
        Which of the three losses: all at once need more evidence than one alone.
    """

    at: Reference
    parts: tuple[str, ...] = PARTS

    @property
    def family(self) -> str:
        """One family: some of the losses or all."""
        return "scrub"

    @property
    def names(self) -> tuple[str, ...]:
        """Left less right and on the spot (fractions), drift (m/rad), those of them that it has."""
        return tuple(f"scrub-{part}-of-{len(self.parts)}" for part in self.parts)

    @property
    def prior(self) -> tuple[float, ...]:
        """Prior sigmas of the explanations: 1 % for fractions, 2 mm a radian for drift."""
        return tuple(2e-3 if part == "drift" else TYPICAL for part in self.parts)

    @property
    def unseen(self) -> dict[str, float]:
        """Prior sigmas of the wheel separation and of the camera's place ahead."""
        return {"b": TYPICAL * self.at.b, "tx": TYPICAL * self.at.b / 2}

    def columns(self, problem: Problem, state: State) -> Columns:  # noqa: ARG002 (held at the reference)
        """Return the travel that undoes each loss, and the legs' displacement by the drift."""
        u, b = self.at.travel(problem), self.at.b
        dth = (u[:, 0] - u[:, 1]) / b
        spot = np.abs(u.mean(axis=1)) < _ON_SPOT * np.abs(u[:, 0] - u[:, 1])
        fractions = [0.5 * np.sign(dth), spot.astype(np.float64), np.zeros_like(dth)]
        travel = np.stack([_lost(fraction * dth, b) for fraction in fractions], axis=2)
        legs = np.zeros((len(problem.leg_stop), 3, len(fractions)))
        none = np.zeros((len(problem.leg_stop), 2))
        aside = leg_model(problem.path, np.array([*self.at.radii, b]), none, none).by_sideways
        if aside.shape[1]:
            legs[:, :, 2] = np.add.reduceat(aside * np.abs(dth), problem.path.starts, axis=1).T
        have = [PARTS.index(part) for part in self.parts]
        return Columns(travel=travel[:, :, have], legs=legs[:, :, have])

    def finding(self, solved: Solved, problem: Problem) -> Finding:  # noqa: ARG002
        """Return the three losses; the size is the largest in its sigmas."""
        have = dict(zip(self.parts, zip(solved.values, solved.sigma, strict=True), strict=True))
        (side, s_side), (spot, s_spot), (drift, s_drift) = (have.get(part, (0.0, 1.0)) for part in PARTS)
        words = []
        if abs(side) > 2 * s_side:
            more = "left" if side > 0 else "right"
            words.append(f"to the {more} {percent(abs(side), s_side)} more of each turn is lost than to the other side")
        if abs(spot) > 2 * s_spot:
            words.append(
                f"on the spot {percent(abs(spot), s_spot)} {'more' if spot > 0 else 'less'} of each turn is lost than "
                "in bends"
            )
        if abs(drift) > 2 * s_drift:
            to = "left" if drift > 0 else "right"
            words.append(f"the robot slides {1e3 * abs(drift):.2f} +- {1e3 * s_drift:.2f} mm to the {to} a radian")
        text = "; ".join(words) or "turns lose unequal fractions"
        size, sigma = max((side, s_side), (spot, s_spot), key=lambda loss: abs(loss[0]) / loss[1])
        return Finding(
            cause="scrub",
            text=f"the wheels scrub in turns: {text}; what all turns lose alike cannot be separated from the "
            f"wheel separation, whose sigma allows for {TYPICAL:.0%}",
            advice="Turn slower, on a smoother floor; wider tyres scrub more.",
            adopted=True,
            size=100 * float(size),
            sigma=100 * float(sigma),
            unit="%",
            p_value=solved.p_value,
        )


def _lost(dth: Array, b: float) -> Array:
    """Return the travel, (S, 2), that takes turns (S,) away."""
    return np.stack([-b / 2 * dth, b / 2 * dth], axis=1)
