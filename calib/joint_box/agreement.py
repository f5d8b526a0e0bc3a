"""Robots whose box was another one than that of the others: each block against the sum of the others."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from boxcal.calib.joint_box.block import Block, Total, at, inverse
from boxcal.calib.joint_box.posterior import Posterior, posterior
from boxcal.calib.joint_box.shape_prior import ShapePrior
from boxcal.target.arrays import Array, Mask

FALSE_ALARM = 0.01
"""Chance that a fleet whose robots all saw one box has any robot left out."""
_LEAST_INFORMATION = 1e-6
"""Directions of which a block says less than this fraction of the prior are not tested."""
_ALIKE = 0.5
"""Robots whose statistic comes this near the largest are left out with it, where many are off."""
_LEAST_FOR_SPREAD = 5
"""With fewer robots nothing says what spread of them is usual."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreement:
    """Test of every robot against all others.

    Attributes
    ----------
    counts : (R,) bool
        Whether a robot counts.
    statistic : (R,)
        Chi-square of its block against the estimate of the others that count.
    freedom : (R,)
        Its degrees of freedom.
    p_value : (R,)
        Chance of a statistic as large for a robot that saw the same box, the usual spread of robots allowed for.
    posterior
        Of those that count.
    """

    counts: Mask
    statistic: Array
    freedom: Array
    p_value: Array
    posterior: Posterior

    @property
    def majority(self) -> bool:
        """Whether more robots agree than do not; else nobody knows whose box is the one."""
        return 2 * int(self.counts.sum()) > len(self.counts)


def agreement(
    blocks: Sequence[Block],
    prior: ShapePrior,
    components: dict[str, float],
    *,
    false_alarm: float = FALSE_ALARM,
    estimate_components: bool = True,
) -> Agreement:
    """Return which robots saw the same box, and its shape.

    The one that is off most is left out as long as it differs from all others by more than chance, the false-alarm rate
    held over the whole fleet; in the end those left out are tested once more against the rest.

    Parameters
    ----------
    blocks
        Of all robots.
    prior, components, estimate_components
        As for :func:`~boxcal.calib.joint_box.posterior.posterior`.
    false_alarm
        For the whole fleet.
    """
    counts = np.ones(len(blocks), dtype=np.bool_)
    limit = false_alarm / len(blocks)

    def tested() -> Agreement:
        chosen = [block for block, counted in zip(blocks, counts, strict=True) if counted]
        found = posterior(chosen, prior, components, estimate_components=estimate_components)
        return _tested(blocks, counts.copy(), found, prior)

    now = tested()
    while counts.sum() > 1:
        excess = np.where(counts, now.statistic / np.maximum(now.freedom, 1), 0.0)
        worst = int(np.lexsort((-excess, np.where(counts, now.p_value, 2.0)))[0])  # least p; of equal ones most excess
        off = counts & (excess >= _ALIKE * excess[worst]) & (now.p_value < limit)
        if off.sum() > 1 and 2 * (counts & ~off).sum() > len(counts):
            counts[off] = False
        else:
            counts[worst] = False
        then = tested()
        if then.p_value[worst] >= limit:
            counts = now.counts & (counts | (then.p_value >= limit))
            break
        now = then
    back = ~counts & (now.p_value >= limit)
    if np.any(back):
        counts |= back
    return tested()


def _tested(blocks: Sequence[Block], counts: Mask, found: Posterior, prior: ShapePrior) -> Agreement:
    usual = np.sqrt(np.diag(inverse(prior.equations(found.shape, prior.usual | found.components)[0])))
    results = [_against_others(b, found, usual, counted=bool(c)) for b, c in zip(blocks, counts, strict=True)]
    statistic, freedom = (np.array(column) for column in zip(*results, strict=True))
    spread = _spread(statistic[counts], freedom[counts])
    p_value = special.chdtrc(np.maximum(freedom, 1), statistic / spread)
    return Agreement(
        counts=counts,
        statistic=statistic,
        freedom=freedom,
        p_value=p_value,
        posterior=replace(found, spread=spread),
    )


def _spread(statistic: Array, freedom: Array) -> float:
    """Return the variance of blocks over what their noise makes it, by the median robot; at least 1."""
    if len(statistic) < _LEAST_FOR_SPREAD:
        return 1.0
    freedom = np.maximum(freedom, 1)
    return max(1.0, float(np.median(statistic / special.chdtri(freedom, 0.5))))


def _against_others(block: Block, found: Posterior, usual: Array, *, counted: bool) -> tuple[float, int]:
    """Return chi-square and its degrees of freedom of a block against the estimate of the others."""
    own = at(block, found.shape)
    others = found.data.less(own) if counted else found.data
    shift, cov = _others_say(others, found)
    unit = np.outer(usual, usual)
    values, vectors = np.linalg.eigh(own.information * unit)
    known = values > _LEAST_INFORMATION
    if not np.any(known):
        return 0.0, 0
    U = vectors[:, known] / np.sqrt(values[known])
    residual = U.T @ ((own.score - own.information @ shift) * usual)
    across = own.information * usual[:, None]
    variance = np.eye(int(known.sum())) + U.T @ across @ cov @ across.T @ U
    return float(residual @ np.linalg.solve(variance, residual)), int(known.sum())


def _others_say(others: Total, found: Posterior) -> tuple[Array, Array]:
    """Return by how much (m,) the others' shape differs from all robots', and its covariance (m, m)."""
    cov = inverse(others.information + found.prior)
    return cov @ (others.score - found.prior @ found.shape), cov
