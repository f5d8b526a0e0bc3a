"""Levels of slip and jitter that are probable, found on a grid that closes in on them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from boxcal.calib.likelihood.moving.system import Levels, Scan, solutions
from boxcal.target.arrays import Array, Ids

_IMPROBABLE = 1e-4
_NEGLIGIBLE = 1e-6
"""Levels less probable than this fraction of the most probable are not solved."""
_EDGE = 0.05
"""A level at the end of a grid that is so probable, over the most probable one, has others beyond it."""
_BETWEEN = 400
"""Places between two levels at which their probability is read."""
_FAR = 40.0
"""Levels further below the most probable one, in the logarithm, say nothing of its surroundings."""
_FEWEST = 3
"""With fewer levels that do, those next to them are taken, too."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axis:
    """Levels of one kind of noise, equally spaced in the logarithm of what noise there is with some that is always.

    Attributes
    ----------
    quiet
        Noise that is always there besides: levels far below it are alike.
    least
        Smallest level.
    coarse : (C,)
        Levels to begin with, ascending.
    fine
        How many levels there are nearer by.
    first
        Lowest and highest level that are probable by what is known beforehand: of those to begin with the ones between
        them are looked at first, and one on either side.
    """

    quiet: float
    least: float
    coarse: Array
    fine: int
    first: tuple[float, float] | None = None

    @property
    def nearby(self) -> Array:
        """Levels to begin with that are looked at first, ascending."""
        if self.first is None:
            return self.coarse
        low, high = np.searchsorted(self.coarse, self.first)
        return self.coarse[max(int(low) - 1, 0) : int(high) + 1]

    def closer(self, levels: Array, weight: Array) -> Array:
        """Return levels over those that are probable, by weights (C,) of levels (C,), and their neighbours."""
        if len(levels) == 1:
            return levels
        likely = np.flatnonzero(weight > _IMPROBABLE * weight.max())
        low, high = max(int(likely[0]) - 1, 0), min(int(likely[-1]) + 1, len(levels) - 1)
        u = np.log(levels[[low, high]] ** 2 + self.quiet**2)
        square = np.exp(np.linspace(u[0], u[1], self.fine)) - self.quiet**2
        return np.sqrt(np.maximum(square, self.least**2))

    def covers(self, levels: Array, weight: Array, edge: float = _EDGE) -> bool:
        """Return whether levels reach to where they are improbable, by ``edge`` at most, or as far as levels go."""
        far = np.array([levels[0] > 1.01 * self.coarse[0], levels[-1] < 0.99 * self.coarse[-1]])
        return not bool(np.any(far & (weight[[0, -1]] > edge * weight.max())))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Probable:
    """Noise that is probable about one state.

    Attributes
    ----------
    levels
        Solutions at the levels that are probable at all.
    weight : (K,)
        Their probabilities, which sum to 1.
    slip, jitter_s, log_likelihood : (M,)
        All pairs of levels of slip and of jitter, and their likelihoods.
    """

    levels: Levels
    weight: Array
    slip: Array
    jitter_s: Array
    log_likelihood: Array

    def by_axis(self, slip: Array, jitter_s: Array) -> tuple[Array, Array]:
        """Return the probabilities, not normalised, of levels (C,) of slip, and of those (J,) of jitter, all pairs."""
        table = np.exp(self.log_likelihood - self.log_likelihood.max()).reshape(len(slip), len(jitter_s))
        return table.sum(axis=1), table.sum(axis=0)


def over_levels(scanned: Callable[[Array, Array], Scan], slip: Axis, jitter: Axis, near: Probable | None) -> Probable:
    """Return the levels of slip and jitter that are probable.

    Parameters
    ----------
    scanned
        Returns the likelihood at levels of slip and jitter, (K,) each.
    slip, jitter
        Which levels there are.
    near
        What was probable nearby: its levels are looked at first, and all if those do not reach far enough.
    """
    if near is not None:
        at = np.unique(near.slip), np.unique(near.jitter_s)
        found = _probable(scanned, *at)
        by_slip, by_jitter = found.by_axis(*at)
        if slip.covers(at[0], by_slip) and jitter.covers(at[1], by_jitter):
            return found
    for slips in (slip.nearby, slip.coarse):
        by_slip, by_jitter = _probable(scanned, slips, jitter.coarse).by_axis(slips, jitter.coarse)
        if slip.covers(slips, by_slip, _IMPROBABLE):
            break
    return _probable(scanned, slip.closer(slips, by_slip), jitter.closer(jitter.coarse, by_jitter))


def _probable(scanned: Callable[[Array, Array], Scan], slip: Array, jitter_s: Array) -> Probable:
    """Return what is probable of all pairs of levels; what rounding is seen to hide once it is solved is not."""
    S, J = (part.ravel() for part in np.meshgrid(slip, jitter_s, indexing="ij"))
    scan = scanned(S, J)
    log_likelihood = scan.log_likelihood.copy()
    while np.any(np.isfinite(log_likelihood)):
        kept = log_likelihood > log_likelihood.max() + np.log(_NEGLIGIBLE)
        levels = solutions(scan, kept)
        hidden = ~np.isfinite(levels.log_likelihood)
        if not hidden.any():
            weight = np.exp(levels.log_likelihood - levels.log_likelihood.max())
            return Probable(
                levels=levels, weight=weight / weight.sum(), slip=S, jitter_s=J, log_likelihood=log_likelihood
            )
        log_likelihood[np.flatnonzero(kept)[hidden]] = -np.inf
    raise np.linalg.LinAlgError("rounding hides the likelihood at all levels of noise")


def mean_and_sigma(slip: Array, log_likelihood: Array) -> tuple[float, float]:
    """Return slip's mean and standard deviation, from the likelihood at levels of slip and jitter.

    The likelihood's logarithm is read between the levels, too, by parabolas: a drive of many legs determines slip to a
    tenth of what levels are apart, and then one level has all the probability.

    Parameters
    ----------
    slip, log_likelihood : (K,)
        All pairs of levels of slip and of jitter; slip's levels are equally spaced as :class:`Axis` has them.
    """
    levels, of = np.unique(slip, return_inverse=True)
    if len(levels) == 1:
        return float(levels[0]), 0.0
    by_slip = np.array([logsumexp(log_likelihood[of == k]) for k in range(len(levels))])
    near = np.flatnonzero(by_slip > by_slip.max() - _FAR)
    if len(near) < _FEWEST:
        near = np.arange(max(near[0] - 1, 0), min(near[-1] + 2, len(levels)))
        near = near[np.isfinite(by_slip[near])]
    if len(near) == 1:
        return float(levels[near[0]]), 0.0
    at = np.linspace(near[0], near[-1], _BETWEEN * int(near[-1] - near[0]) + 1)
    log_density = _between(near, by_slip[near], at)
    value = np.exp(np.interp(at, near, np.log(levels[near])))
    w = np.exp(log_density - log_density.max())
    w[[0, -1]] /= 2
    w /= w.sum()
    mean = float(w @ value)
    return mean, float(np.sqrt(w @ (value - mean) ** 2))


def _between(places: Ids, values: Array, at: Array) -> Array:
    """Return values (N,) of ascending places (N,) read between them, by the two parabolas of three that reach there."""
    if len(places) < _FEWEST:
        return np.asarray(np.interp(at, places, values))
    first = np.clip(np.searchsorted(places, at, side="right") - 1, 0, len(places) - 2)
    weight = (at - places[first]) / (places[first + 1] - places[first])

    def parabola(start: Ids) -> Array:
        x, y = (of[np.clip(start, 0, len(places) - 3)[:, None] + np.arange(3)].T for of in (places, values))
        slope = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
        bend = (slope[1] - slope[0]) / (x[2] - x[0])
        return np.asarray(y[0] + (at - x[0]) * (slope[0] + (at - x[1]) * bend))

    return (1 - weight) * parabola(first - 1) + weight * parabola(first)
