"""Random-effects model: which part of a spread of values is real, and which is their own uncertainty."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from boxcal.target.arrays import Array

_RANGE = (-14.0, 10.0)
"""Of the logarithm of the component over the typical variance, within which it is looked for."""
_SAME = 1e-3
"""Gain in log likelihood below which no component is as likely."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomEffects:
    """Values of many, of which each is known to its own sigma.

    Attributes
    ----------
    mean, mean_sigma
        Their mean, weighted, and its standard deviation.
    between, between_sigma
        Standard deviation of the true values among each other (0: none is seen), and how well that is known.
    within
        Typical standard deviation of one value by itself.
    count
        Values that are known.
    """

    mean: float
    mean_sigma: float
    between: float
    between_sigma: float
    within: float
    count: int


def random_effects(values: Array, sigmas: Array) -> RandomEffects:
    """Return mean and variance between values (N,) with sigmas (N,) by restricted maximum likelihood.

    ``values[i] ~ N(mean, between^2 + sigmas[i]^2)`` (DerSimonian and Laird's model; Viechtbauer 2005,
    doi:10.3102/10769986030003261, for the estimator and its standard error). What is not finite is left aside.
    """
    known = np.isfinite(values) & np.isfinite(sigmas)
    y, var = values[known], sigmas[known] ** 2
    n = len(y)
    if n < 2:
        mean, sigma = (float(y[0]), float(np.sqrt(var[0]))) if n else (np.nan, np.nan)
        return RandomEffects(mean=mean, mean_sigma=sigma, between=np.nan, between_sigma=np.nan, within=sigma, count=n)
    unit = float(np.median(var)) + float(np.var(y)) * 1e-9 + 1e-300
    middle = float(np.median(y))

    def loss(component: float) -> float:
        w = 1 / (var + component + 1e-12 * unit)
        mean = float(np.sum(w * (y - middle)) / np.sum(w))
        return float(-np.sum(np.log(w)) + np.log(np.sum(w)) + np.sum(w * (y - middle - mean) ** 2)) / 2

    top = max(_RANGE[1], float(np.log(np.var(y) / unit + 1e-300)) + 3)
    found = minimize_scalar(lambda x: loss(unit * np.exp(x)), bounds=(_RANGE[0], top), method="bounded")
    component = float(unit * np.exp(found.x)) if loss(0.0) - found.fun > _SAME else 0.0
    w = 1 / (var + component + 1e-12 * unit)
    total = float(np.sum(w))
    information = float(np.sum(w**2) - 2 * np.sum(w**3) / total + (np.sum(w**2) / total) ** 2) / 2
    sigma_component = float(1 / np.sqrt(information)) if information > 0 else np.inf
    between = float(np.sqrt(component))
    return RandomEffects(
        mean=middle + float(np.sum(w * (y - middle)) / total),
        mean_sigma=total**-0.5,
        between=between,
        between_sigma=sigma_component / (2 * between) if between > 0 else float(np.sqrt(sigma_component)),
        within=float(np.sqrt(np.median(var))),
        count=n,
    )
