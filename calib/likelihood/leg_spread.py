"""Legs of one robot that slip unlike: on a doormat, over a sill, at a start too fast.

A leg's error is normal, and its variance may be spread from leg to leg (a scale mixture of normals; Andrews and Mallows
1974, DOI 10.1111/j.2517-6161.1974.tb00989.x), lognormally. What the other legs say of that spread decides how
surprising one leg's error is, so that a leg is not taken for a fault because the floor differs there, nor a fault for a
rough floor. Each of the other legs may be faulty itself (contaminated distribution, Tukey 1960).
"""

import numpy as np
from scipy import special

from boxcal.calib.likelihood.log_sum import log_sum
from boxcal.target.arrays import Array, Mask

ENOUGH = 6
"""Fewer legs than this say nothing of the spread, and none is left out: 6 unknowns are fitted to 3 numbers a leg."""
SPREADS = (0.0, 0.8, 1.6)
"""Standard deviations of the logarithm of a leg's variance: none, a factor of two, and one of five."""
_LOG_PRIOR = np.log([0.7, 0.18, 0.12])
_FAULTY = 0.02
"""Probability of a leg's fault beforehand."""
_PROBABLY = 0.5
"""A leg that is more probably faulty than not is as surprising as where all are alike: of few legs none proves
that there is no spread, which let one stay that was off by twenty standard deviations."""
_FAULTS = (30.0, 3e5)
"""Variances of faults, in those of the noise; all their logarithms are alike."""
_CLEARLY = 2.0
"""How much larger the logarithm of the likelihood with a spread must be for legs to be weighed by it."""
_SURPRISING = 0.01
"""A leg's error is looked at again if normal noise has less than this chance of one as large."""
_LOG_SCALE = np.linspace(-3, 3, 19)
_DIMENSIONS = 3
_NODES, _NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(11)
_LOG_NODE_WEIGHTS = np.log(_NODE_WEIGHTS / _NODE_WEIGHTS.sum())
_LOG_VARIANCE = np.array(SPREADS)[:, None] * _NODES
"""Logarithms of a leg's variance over the usual one, at each node of the mixture, (spreads, nodes)."""


def surprise(normal: Array, square: Array, freedom: Array, known: Mask) -> Array:
    """Return the chance of errors as large as each leg's (N,), given what the other legs say of their spread.

    Parameters
    ----------
    normal : (N,)
        That chance where the legs' variances are alike.
    square : (N,)
        Squared Mahalanobis distances to what other data predict.
    freedom : (N,)
        In how many directions they could be tested.
    known : (N,)
        Which legs say something of the spread.
    """
    known = known & (freedom == _DIMENSIONS)
    odd = np.flatnonzero((normal < _SURPRISING) & (freedom > 0))
    if np.count_nonzero(known) <= ENOUGH or not odd.size:
        return normal
    each = np.where(known[:, None, None], _contaminated(square), 0.0)
    others = each.sum(axis=0) - each[odd] + _LOG_PRIOR[:, None]
    weight = np.exp(others - others.max(axis=(1, 2), keepdims=True))
    weight /= weight.sum(axis=(1, 2), keepdims=True)
    x = square[odd, None, None, None] / np.exp(_LOG_SCALE[:, None] + _LOG_VARIANCE[1:, None, :])
    chance = special.chdtrc(freedom[odd, None, None, None], x) @ np.exp(_LOG_NODE_WEIGHTS)
    p = normal.copy()
    slips_more = weight[:, 0].sum(axis=1) * normal[odd] + np.sum(weight[:, 1:] * chance, axis=(1, 2))
    p[odd] = np.where(_fault_probability(square[odd], weight) > _PROBABLY, normal[odd], slips_more)
    return p


def _fault_probability(square: Array, weight: Array) -> Array:
    """Return the probability that each leg (N,) is faulty, with weights of spreads and scales by the others."""
    own = np.exp(log_sum(_log_densities(square), axis=3))
    sound = (1 - _FAULTY) * np.sum(weight * own, axis=(1, 2))
    return np.asarray(1 - sound / np.sum(weight * np.exp(_contaminated(square)), axis=(1, 2)))


def spread_of(square: Array) -> float:
    """Return how much the legs' variances spread (standard deviation of the logarithm), from squared distances.

    None unless a spread explains them clearly better, each at the scale that suits it best.

    Parameters
    ----------
    square : (N,)
        Squared Mahalanobis distances, of legs that count, to what other data predict, in 3 dimensions.
    """
    if len(square) < ENOUGH:
        return 0.0
    log_likelihood = np.max(np.sum(log_sum(_log_densities(square), axis=3), axis=0), axis=1)
    best = int(np.argmax(log_likelihood))
    return SPREADS[best] if log_likelihood[best] - log_likelihood[0] > _CLEARLY else 0.0


def spread_weights(expected_square: Array, legs: Array, spread: float) -> Array:
    """Return the legs' weights (N,): the expected inverse of their variance over the usual one, 0 where left out.

    Parameters
    ----------
    expected_square : (N,)
        Expected square of a leg's error in usual standard deviations.
    legs : (N,)
        0 where a leg is left out.
    spread
        Of the legs' variances, one of ``SPREADS``.
    """
    log_variance = _LOG_VARIANCE[SPREADS.index(spread)]
    probable = _log_densities(expected_square)[:, SPREADS.index(spread), len(_LOG_SCALE) // 2]
    probable = np.exp(probable - probable.max(axis=1, keepdims=True))
    return np.where(legs > 0, probable @ np.exp(-log_variance) / probable.sum(axis=1), 0.0)


def _contaminated(square: Array) -> Array:
    """Return the logarithm of each leg's density (N, spreads, scales), a fault of any size included."""
    low, high = _FAULTS
    x = np.maximum(square, 1e-9)
    probability = special.gammainc(1.5, x / (2 * low)) - special.gammainc(1.5, x / (2 * high))
    log_fault = special.gammaln(1.5) - 1.5 * np.log(np.pi * x) + np.log(np.maximum(probability, 1e-300))
    log_fault += np.log(_FAULTY / np.log(high / low))
    own = log_sum(_log_densities(square), axis=3)
    return np.asarray(np.logaddexp(np.log1p(-_FAULTY) + own, log_fault[:, None, None]))


def _log_densities(square: Array) -> Array:
    """Return the logarithm of each leg's density at each node of the mixture, (N, spreads, scales, nodes)."""
    log_variance = _LOG_SCALE[:, None] + _LOG_VARIANCE[:, None, :]
    x = square[:, None, None, None] / np.exp(log_variance)
    return np.asarray(_LOG_NODE_WEIGHTS - 0.5 * x - 0.5 * _DIMENSIONS * (log_variance + np.log(2 * np.pi)))
