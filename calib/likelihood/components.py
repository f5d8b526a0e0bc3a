"""Variance components: how large each kind of random effect is, estimated from the data."""

from dataclasses import dataclass, field, replace

import numpy as np

from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VarianceComponents:
    """Standard deviations of all random effects.

    Attributes
    ----------
    noise_scale
        Multiplies the corners' own standard deviations.
    slip : m/sqrt(m)
        Of each wheel.
    lean : rad
        Of roll and pitch from stop to stop.
    height : m
        Of the body's height over the common floor from stop to stop.
    growth : px
        Of what the tags' black looks larger from image to image.
    target
        Of the target as built, by component.
    corner_floor : px
        Error of every corner besides what its covariance states, before the noise scale.
    """

    noise_scale: float
    slip: float
    lean: float = 0.0
    height: float = 0.0
    growth: float = 0.0
    target: dict[str, float] = field(default_factory=dict)
    corner_floor: float = 0.0

    @property
    def local_sigma(self) -> Array:
        """Standard deviations of a stop's local unknowns, (4,)."""
        return np.array([self.lean, self.lean, self.height, self.growth])

    def prior_sigma(self, problem: Problem) -> Array:
        """Return the standard deviations of the shared unknowns' priors, (n,)."""
        sigma = problem.prior.copy()
        for name, rows in problem.of_component.items():
            if name in self.target:
                sigma[rows] = problem.unit[rows] * self.target[name]
        return sigma

    def freezes(self, state: State) -> bool:
        """Return whether a state has effects whose variance is zero."""
        values = np.column_stack([state.lean, state.growth])
        return bool(np.any(values[:, self.local_sigma == 0]))

    def rigid_where_zero(self, state: State) -> State:
        """Return the state without the effects whose variance is zero."""
        on = self.local_sigma > 0
        return replace(state, lean=state.lean * on[:3], growth=state.growth * on[3])


def extrapolated(
    first: VarianceComponents, second: VarianceComponents, third: VarianceComponents
) -> VarianceComponents:
    """Return where three steps of a fixed point lead, each component by itself (Aitken), in logarithms; slip stays."""
    steps = [
        np.log([c.noise_scale, *np.maximum(c.local_sigma[1:], _NOUGHT), *c.target.values()])
        for c in (first, second, third)
    ]
    before, after = steps[1] - steps[0], steps[2] - steps[1]
    ratio = np.divide(after, before, out=np.zeros_like(after), where=np.abs(before) > 1e-9)
    ratio = np.where((ratio > _LEAST_RATIO) & (ratio < _MOST_RATIO), ratio, 0.0)
    factor = np.exp(np.clip(after * ratio / (1 - ratio), -_FARTHEST, _FARTHEST))
    return replace(
        third,
        noise_scale=float(third.noise_scale * factor[0]),
        lean=float(third.lean * factor[1]),
        height=float(third.height * factor[2]),
        growth=float(third.growth * factor[3]),
        target={name: float(s * f) for (name, s), f in zip(third.target.items(), factor[4:], strict=True)},
    )


_NOUGHT = 1e-30
_LEAST_RATIO, _MOST_RATIO, _FARTHEST = 0.2, 0.95, 1.0
"""Ratios of two steps that are taken to go on, and the largest step, in logarithms."""


def largest_change(before: VarianceComponents, after: VarianceComponents) -> float:
    """Return the largest change of any component but slip, as the logarithm of a ratio.

    Raises
    ------
    LinAlgError
        If a component is no number: the equations that it is of have no solution.
    """
    pairs = [(before.noise_scale, after.noise_scale), *zip(before.local_sigma, after.local_sigma, strict=True)]
    pairs += [(before.target[name], sigma) for name, sigma in after.target.items()]
    if not np.all(np.isfinite(pairs)):
        raise np.linalg.LinAlgError("variances that are no numbers")
    return max(float(abs(np.log(b / a))) for a, b in pairs if a > 0 and b > 0)
