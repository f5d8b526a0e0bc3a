"""Drift of a robot since its last change, with its sigma, and when it calls for the next calibration."""

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from boxcal.calib.uncertainty.random_effects import random_effects
from boxcal.target.arrays import Array

_WAY = 10.0
"""Distance driven straight ahead, m, that an error of odometry is stated for."""
HORIZON = 5.0
"""Years beyond which nobody believes a trend."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """Drift of one quantity.

    Attributes
    ----------
    rate, sigma
        Per year, and its standard deviation (infinite with fewer than two sessions).
    shrunk, shrunk_sigma
        The same, with what the other robots of the fleet say of it.
    level, level_sigma
        The quantity at the last session, on the line.
    sessions
        How many it rests on.
    """

    rate: float
    sigma: float
    shrunk: float
    shrunk_sigma: float
    level: float
    level_sigma: float
    sessions: int


def own_trend(years: Array, values: Array, variances: Array) -> Trend:
    """Return the drift of one quantity of one robot by weighted least squares.

    Parameters
    ----------
    years, values, variances : (n,)
        Sessions since the last change; variances with the scatter between sessions, infinite where one says nothing.
    """
    w = np.where(np.isfinite(variances), 1 / np.maximum(variances, 1e-300), 0.0)
    known = w > 0
    count, total = int(np.sum(known)), float(np.sum(w))
    if count == 0:
        return Trend(rate=np.nan, sigma=inf, shrunk=np.nan, shrunk_sigma=inf, level=np.nan, level_sigma=inf, sessions=0)
    end = float(years[known][-1])
    t0, y0 = float(np.sum(w * years)) / total, float(np.sum(w * values)) / total
    lever = float(np.sum(w * (years - t0) ** 2))
    if count < 2 or lever <= 0:
        rate, sigma, level, variance = np.nan, inf, y0, 1 / total
    else:
        rate = float(np.sum(w * (years - t0) * (values - y0))) / lever
        sigma = lever**-0.5
        level, variance = y0 + rate * (end - t0), 1 / total + (end - t0) ** 2 / lever
    return Trend(
        rate=rate,
        sigma=sigma,
        shrunk=rate,
        shrunk_sigma=sigma,
        level=level,
        level_sigma=sqrt(variance),
        sessions=count,
    )


def shrunk(trends: list[Trend]) -> list[Trend]:
    """Return the trends of one quantity of all robots under the fleet's spread of rates as prior (empirical Bayes)."""
    rates, sigmas = np.array([t.rate for t in trends]), np.array([t.sigma for t in trends])
    fleet = random_effects(rates, sigmas)
    if fleet.count < 3:
        return trends
    out = []
    for t in trends:
        prior = fleet.between**2 + fleet.mean_sigma**2
        own = t.sigma**-2 if np.isfinite(t.sigma) else 0.0
        rate = (fleet.mean / prior + (t.rate * own if own else 0.0)) / (1 / prior + own)
        out.append(
            Trend(
                rate=t.rate,
                sigma=t.sigma,
                shrunk=rate,
                shrunk_sigma=(1 / prior + own) ** -0.5,
                level=t.level,
                level_sigma=t.level_sigma,
                sessions=t.sessions,
            )
        )
    return out


def years_until(
    radii: Trend, difference: Trend, standing: tuple[float, float], separation: float, limit: float
) -> float:
    """Return the years until odometry of the last calibration errs by a limit: 0 if it does already.

    The error after 10 m straight ahead, along by the mean radius and aside by the difference of both (heading
    ``10 m * difference / separation``, half of it in the mean over the path), root mean square, under the drift and all
    that is not known of it.

    Parameters
    ----------
    radii, difference
        Relative, a year: of both radii, and of the left over the right.
    standing
        Variances of one calibration, scatter between sessions included, of the same two.
    separation : m
        Of the wheels.
    limit : m
        Position error after 10 m that is still good.
    """
    aside = _WAY**2 / (2 * separation)
    grows = sum(
        factor**2 * (t.shrunk**2 + t.shrunk_sigma**2)
        for factor, t in ((_WAY, radii), (aside, difference))
        if np.isfinite(t.shrunk) and np.isfinite(t.shrunk_sigma)
    )
    now = _WAY**2 * standing[0] + aside**2 * standing[1]
    if not np.isfinite(now) or now >= limit**2:
        return 0.0
    return min(HORIZON, sqrt((limit**2 - now) / grows)) if grows > 0 else HORIZON
