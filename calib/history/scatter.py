"""Scatter between sessions: a variance component of its own, from the fleet, and each robot's own fraction of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import betaln

from boxcal.calib.history.channels import CHANNELS, Series
from boxcal.target.arrays import Array

_CHI2_MEDIAN = 0.4549364
"""Median of chi-square with one degree of freedom."""
_FEW = 12
"""Differences between consecutive sessions from which on their median is a start; below it their mean is."""
_SAME = 1e-3
_PRIOR_DOF = np.array([4.0, 6.0, 8.0, 12.0, 20.0, 40.0, 80.0, 1000.0])
"""Degrees of freedom tried for how alike the robots' scatters are."""
_FOR_A_SLOPE = 4
"""Sessions of a stretch from which on a drift is allowed for in channels that wear."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """Consecutive sessions of one robot between changes, in one channel: times (n,) yr, values (n,), variances (n,)."""

    robot: int
    years: Array
    values: Array
    variances: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """Scatter between sessions over a fleet.

    Attributes
    ----------
    component, sigma : (J,)
        Variance between sessions beyond what the calibrations claim, by channel (NaN where no robot has two sessions),
        and its standard deviation.
    dof : (J,)
        Degrees of freedom that it rests on.
    prior_dof
        How alike the robots are: their variances, as multiples of the fleet's, scatter like chi-square over its
        degrees of freedom with that number. Less where all of it rests on few sessions.
    """

    component: Array
    sigma: Array
    dof: Array
    prior_dof: float


def first_guess(fleet: Sequence[Series]) -> Array:
    """Return the component by channel, (J,), from the median of differences of consecutive sessions.

    A change of a robot spoils one difference of many, so this needs no knowledge of changes.
    """
    out = np.full(len(CHANNELS), np.nan)
    for j in range(len(CHANNELS)):
        squares, claimed = [], []
        for s in fleet:
            known = np.isfinite(s.variances[:, j])
            squares.append(np.diff(s.values[known, j]) ** 2)
            claimed.append(s.variances[known, j][1:] + s.variances[known, j][:-1])
        d2, own = np.concatenate(squares), np.concatenate(claimed)
        if len(d2) == 0:
            continue
        if len(d2) < _FEW:
            out[j] = max(0.0, float(np.mean(d2 - own)) / 2)
            continue
        low, high = 0.0, float(np.max(d2))
        for _ in range(60):  # the median of d2 / (2 T + own) falls with T
            middle = (low + high) / 2
            above = float(np.median(d2 / (2 * middle + own + 1e-300))) > _CHI2_MEDIAN
            low, high = (middle, high) if above else (low, middle)
        out[j] = high if high > 1e-9 * float(np.median(own)) else 0.0
    return out


def between_sessions(stretches: Sequence[Sequence[Stretch]]) -> Scatter:
    """Return the scatter between sessions by restricted maximum likelihood, pooled over the fleet.

    In every stretch ``values ~ N(line or constant, component + variances)``: its constant (and the slope, where the
    channel wears and there are four sessions) is eliminated.

    Parameters
    ----------
    stretches
        For each channel those of all robots.
    """
    component, sigma, dof = (np.full(len(stretches), np.nan) for _ in range(3))
    ratios: list[tuple[Array, Array]] = []
    for j, own in enumerate(stretches):
        used = [s for s in own if len(s.values) > 1]
        if not used:
            dof[j] = 0
            continue
        component[j], sigma[j], dof[j] = _reml(used, wears=CHANNELS[j].wears)
        if CHANNELS[j].watched:
            ratios.append(_chi2_by_robot(used, component[j], wears=CHANNELS[j].wears))
    watched = np.array([c.watched for c in CHANNELS])
    pooled = float(np.nanmin(np.where(watched, dof, np.nan))) if np.any(dof[watched] > 0) else 0.0
    alike = _prior_dof(ratios)
    return Scatter(
        component=component,
        sigma=sigma,
        dof=dof,
        prior_dof=1 / (1 / alike + 1 / max(pooled, 1.0)) if pooled else 0.0,
    )


def own_factor(stretches: Sequence[Stretch], component: float, prior_dof: float, *, wears: bool) -> float:
    """Return a robot's variance in one channel as a multiple of the fleet's, shrunk towards 1 by the prior.

    The mean of chi-square over its degrees of freedom, with the fleet's prior counted as ``prior_dof`` more (Smyth
    2004, doi:10.2202/1544-6115.1027): a robot of two sessions is much like the fleet, one of fifty is itself.
    """
    used = [s for s in stretches if len(s.values) > 1]
    if not used or not np.isfinite(component):
        return 1.0
    chi2, dof = _chi2_by_robot(used, component, wears=wears)
    return float((prior_dof + np.sum(chi2)) / (prior_dof + np.sum(dof))) if prior_dof + np.sum(dof) > 0 else 1.0


def _parts(s: Stretch, component: float, *, wears: bool) -> tuple[float, float, int, float, float]:
    """Return chi-square, log determinants, degrees of freedom and both parts of the information on the component."""
    w = 1 / (s.variances + component + 1e-300)
    slope = wears and len(s.values) >= _FOR_A_SLOPE and float(np.ptp(s.years)) > 0
    X = np.column_stack([np.ones(len(w)), s.years - s.years.mean()]) if slope else np.ones((len(w), 1))
    normal = X.T @ (w[:, None] * X)
    inverse = np.linalg.inv(normal)
    residual = s.values - X @ (inverse @ (X.T @ (w * s.values)))
    P = np.diag(w) - (w[:, None] * X) @ inverse @ (X.T * w)
    chi2 = float(residual @ (w * residual))
    return (
        chi2,
        float(-np.sum(np.log(w)) + np.linalg.slogdet(normal)[1]),
        len(w) - X.shape[1],
        float(np.sum(P * P)),
        float(np.trace(P)),
    )


def _pooled_loss(used: Sequence[Stretch], *, wears: bool) -> Callable[[float], float]:
    """Return minus the restricted log likelihood of a component: for all stretches what ``_parts`` is for one."""
    sizes = [len(s.values) for s in used]
    of = np.repeat(np.arange(len(used)), sizes)
    t = np.concatenate([s.years - s.years.mean() for s in used])
    y = np.concatenate([s.values - s.values.mean() for s in used])
    var = np.concatenate([s.variances for s in used])
    sloped = np.array([wears and len(s.values) >= _FOR_A_SLOPE and float(np.ptp(s.years)) > 0 for s in used])

    def loss(component: float) -> float:
        w = 1 / (var + component + 1e-300)
        S0, S1, S2, y0, y1 = (np.bincount(of, w * v, len(used)) for v in (1.0, t, t * t, y, t * y))
        S1, y1, S2 = S1 * sloped, y1 * sloped, np.where(sloped, S2, 1.0)
        det = S0 * S2 - S1 * S1
        explained = (S2 * y0 * y0 - 2 * S1 * y0 * y1 + S0 * y1 * y1) / det
        return float(np.sum(w * y * y) - np.sum(explained) - np.sum(np.log(w)) + np.sum(np.log(det))) / 2

    return loss


def _reml(used: Sequence[Stretch], *, wears: bool) -> tuple[float, float, float]:
    unit = float(np.median(np.concatenate([s.variances for s in used])))
    spread = float(np.max([np.var(s.values) for s in used]))
    unit = max(unit, 1e-9 * spread, 1e-300)

    loss = _pooled_loss(used, wears=wears)
    top = float(np.log(spread / unit + 1e-300)) + 3
    found = minimize_scalar(
        lambda x: loss(unit * np.exp(x)), bounds=(-9.0, max(top, 3.0)), method="bounded", options={"xatol": 0.02}
    )
    component = float(unit * np.exp(found.x)) if loss(1e-9 * unit) - found.fun > _SAME else 0.0
    parts = [_parts(s, component, wears=wears) for s in used]
    information = sum(p[3] for p in parts) / 2
    return component, float(information**-0.5) if information > 0 else np.inf, float(sum(p[2] for p in parts))


def _chi2_by_robot(used: Sequence[Stretch], component: float, *, wears: bool) -> tuple[Array, Array]:
    robots = sorted({s.robot for s in used})
    chi2, dof = np.zeros(len(robots)), np.zeros(len(robots))
    for s in used:
        parts = _parts(s, component, wears=wears)
        k = robots.index(s.robot)
        chi2[k] += parts[0]
        dof[k] += parts[2]
    return chi2[dof > 0], dof[dof > 0]


def _prior_dof(ratios: Sequence[tuple[Array, Array]]) -> float:
    """Return the degrees of freedom under which the robots' chi-squares are likeliest: F(dof, prior) each."""
    chi2 = np.concatenate([c for c, _ in ratios]) if ratios else np.empty(0)
    dof = np.concatenate([d for _, d in ratios]) if ratios else np.empty(0)
    if len(chi2) < 3:
        return float(_PRIOR_DOF[-1])
    f, d0 = chi2 / dof, _PRIOR_DOF[:, None]
    density = (
        (d0 / 2 * np.log(d0) + dof / 2 * np.log(dof) + (dof / 2 - 1) * np.log(np.maximum(f, 1e-12)))
        - (dof + d0) / 2 * np.log(d0 + dof * f)
        - betaln(dof / 2, d0 / 2)
    )
    return float(_PRIOR_DOF[int(np.argmax(np.sum(density, axis=1)))])
