"""The range in which quantities will be found that a further stop promises: it hangs on a slip that is hardly known."""

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri

_LEVELS = (0.05, 0.5, 0.95)
_OTHERWISE = 0.12
"""Relative change of what is found for other reasons: a stop is not met to the centimetre, legs may count for less."""
_LEAST_FREEDOM = 3.0
_ASSUMED = (0.25, 0.75, 1.6)
"""Range where slip was assumed: that is a cautious value, which few wheels surpass."""
_CERTAIN = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """Factors on quantities that were computed with the slip as it is known now.

    Attributes
    ----------
    low, high
        Found between these nine times in ten.
    middle
        Found above and below this equally often.
    """

    low: float
    middle: float
    high: float


def promise_of(slip_doubt: float | None, stops: int) -> Promise:
    """Return in what range quantities will be found after further stops.

    The slip's variance is known as from some degrees of freedom; each leg adds two, one a wheel. What they will say,
    over what is known, is F-distributed. Quantities are averaged over the slip, whose doubt makes them larger at first.

    Parameters
    ----------
    slip_doubt
        Standard deviation of the slip over its value; None if it was assumed.
    stops
        How many more stops.
    """
    if slip_doubt is None:
        low, middle, high = _ASSUMED
        return Promise(low=low, middle=middle, high=high)
    if slip_doubt < _CERTAIN:
        return Promise(low=1 / (1 + _OTHERWISE), middle=1.0, high=1 + _OTHERWISE)
    now = max(_degrees_of_freedom(slip_doubt), _LEAST_FREEDOM)
    new = 2.0 * stops
    then = now + new
    of_slip = np.sqrt((now + new * fdtri(new, now, np.array(_LEVELS))) / then)
    of_doubt = np.sqrt(then / (then - 2) / (now / (now - 2)))
    low, middle, high = of_slip * of_doubt
    return Promise(low=float(low) / (1 + _OTHERWISE), middle=float(middle), high=float(high) * (1 + _OTHERWISE))


def _degrees_of_freedom(slip_doubt: float) -> float:
    """Return the degrees of freedom at which the root of an inverse chi square is as uncertain, within 5 %."""
    return 2.1 + 0.5 / slip_doubt**2
