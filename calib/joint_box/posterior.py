"""Shape of the box from the blocks of many robots and one prior."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.joint_box.block import Block, Total, at, inverse, tree_sum
from boxcal.calib.joint_box.shape_prior import ShapePrior
from boxcal.calib.likelihood.variance_components import target_components
from boxcal.target.arrays import Array

_STEPS = 30
_CLOSE = 1e-3
"""Relative change of a component at which its fixed point ends."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """A shape's distribution: Gaussian, of robots that count and of the prior, which counts once.

    Attributes
    ----------
    shape : (m,)
        Its mean.
    data
        Information and score of the robots that count, there.
    prior : (m, m)
        Information of the prior.
    components
        The prior's variance components.
    spread
        Variance of the robots' blocks over what their own noise makes it, at least 1.
    """

    shape: Array
    data: Total
    prior: Array
    components: dict[str, float]
    spread: float = 1.0

    @property
    def cov(self) -> Array:
        """Covariance of the shape, (m, m), the spread of the robots in it."""
        return spread_cov(self.data.information, self.prior, self.spread)

    def without(self, block: Block) -> tuple[Array, Array]:
        """Return mean (m,) and covariance (m, m) without one robot: the estimate from all others."""
        data = self.data.less(at(block, self.shape))
        weight, score = data.information + self.prior, data.score + self._prior_score
        return self.shape + inverse(weight) @ score, spread_cov(data.information, self.prior, self.spread)

    @property
    def _prior_score(self) -> Array:
        return -self.prior @ self.shape


def spread_cov(information: Array, prior: Array, spread: float) -> Array:
    """Return a shape's covariance where the robots' variance is larger than their information says by a factor."""
    whole = inverse(information + prior)
    cov = whole @ (spread * information + prior) @ whole
    return np.asarray((cov + cov.T) / 2)


def posterior(
    blocks: Sequence[Block], prior: ShapePrior, components: dict[str, float], *, estimate_components: bool = True
) -> Posterior:
    """Return the shape estimated from some robots and the prior.

    Parameters
    ----------
    blocks
        Of the robots that count, each at any shape near by.
    prior
        What is known before.
    components
        The prior's variance components to start from.
    estimate_components
        Whether they come from the data (restricted maximum likelihood), as in an estimate of one robot.
    """
    zero = np.zeros(len(prior.names))
    about = blocks[0].about if blocks else zero
    nothing = Total(information=np.zeros((len(zero), len(zero))), score=zero)
    data = tree_sum([at(block, about) for block in blocks]) if blocks else nothing
    for _ in range(_STEPS):
        weight, score = prior.equations(about, components)
        cov = inverse(data.information + weight)
        shape = about + cov @ (data.score + score)
        if not (estimate_components and components):
            break
        new = target_components(prior.component, prior.unit, components, shape, np.diag(cov))
        change = max(abs(np.log(new[name] / components[name])) for name in components)
        components = new
        if change < _CLOSE:
            break
    weight, score = prior.equations(about, components)
    shape = about + inverse(data.information + weight) @ (data.score + score)
    there = Total(information=data.information, score=data.score - data.information @ (shape - about))
    return Posterior(shape=shape, data=there, prior=weight, components=components)
