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
        Of what the tags' black looks larger from picture to picture.
    target
        Of the target as built, by component.
    """

    noise_scale: float
    slip: float
    lean: float = 0.0
    height: float = 0.0
    growth: float = 0.0
    target: dict[str, float] = field(default_factory=dict)

    @property
    def local_sigma(self) -> Array:
        """Standard deviations of a stop's local unknowns, (4,)."""
        return np.array([self.lean, self.lean, self.height, self.growth])

    def prior_sigma(self, problem: Problem) -> Array:
        """Return the standard deviations of the shared unknowns' priors, (n,)."""
        sigma = problem.prior.copy()
        for k, name in enumerate(problem.component):
            if name in self.target:
                sigma[k] = problem.unit[k] * self.target[name]
        return sigma

    def freezes(self, state: State) -> bool:
        """Tell whether a state has effects whose variance is zero."""
        values = np.concatenate([state.lean, state.growth[:, None]], axis=1)
        return bool(np.any(values[:, self.local_sigma == 0]))

    def rigid_where_zero(self, state: State) -> State:
        """Return the state without the effects whose variance is zero."""
        on = self.local_sigma > 0
        return replace(state, lean=state.lean * on[:3], growth=state.growth * on[3])


def largest_change(before: VarianceComponents, after: VarianceComponents) -> float:
    """Return the largest change of any component but slip, as the logarithm of a ratio."""
    pairs = [(before.noise_scale, after.noise_scale), *zip(before.local_sigma, after.local_sigma, strict=True)]
    pairs += [(before.target[name], sigma) for name, sigma in after.target.items()]
    return max(float(abs(np.log(b / a))) for a, b in pairs if a > 0 and b > 0)
