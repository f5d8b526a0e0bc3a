"""Evidence of a change within one stretch of sessions: likelihood ratios that no choice of the day can inflate."""

from typing import NamedTuple

import numpy as np

from boxcal.target.arrays import Array, Mask

SIZES = (3.0, 10.0, 40.0)
"""Changes looked for, in standard deviations of one session (of a drift: a year), mixed in equal parts."""
_SMALL = 1e-9
_NONE = 1e-300


class Ratios(NamedTuple):
    """Log likelihood ratios (K, n, J) of a step and of a drift, of K looks, n onsets and J quantities."""

    step: Array
    drift: Array


def log_ratios(years: Array, values: Array, variances: Array, prior_dof: float, *, slope: Mask, looks: slice) -> Ratios:
    """Return log likelihood ratios of a change that sets in before session c, as seen after session k.

    Under both hypotheses ``values ~ N(X beta + delta g, s^2 variances)`` with X a constant (and a line where
    ``slope``), a flat prior of beta and ``prior_dof`` degrees of freedom behind s^2 = 1; delta is 0, or
    N(0, s^2 size^2) with the sizes of ``SIZES``. beta, s and delta are integrated out in closed form (a t
    distribution), so the ratio for each onset is a martingale of mean 1 in k while nothing changes, and 1 before its
    onset.

    Parameters
    ----------
    years : (n,)
        When.
    values, variances : (n, J)
        Quantities found, and their variances, scatter between sessions included; infinite where a session says nothing.
    slope : (J,)
        Whether a quantity drifts already.
    looks
        Which k are asked for.
    """
    n = len(years)
    known = np.isfinite(variances)
    w = np.where(known, 1 / np.maximum(np.where(known, variances, 1.0), _NONE), 0.0)
    first = np.argmax(known, axis=0)
    t = (years - years[0])[:, None]
    y = np.where(known, values - np.take_along_axis(values, first[None], axis=0), 0.0)  # so that squares keep digits
    sums = [_prefix_sums(w * term) for term in (1.0, t, t * t, y, t * y, y * y)]
    ends = np.arange(n)[looks]
    whole = [s[ends + 1][:, None] for s in sums]
    A, At, Att, B, Bt = (s[ends + 1][:, None] - s[None, :n] for s in sums[:5])
    count = np.cumsum(known, axis=0)[ends][:, None]
    # The regressors that are always there: their normal matrix, by its elements.
    S0, S1, S2 = np.maximum(whole[0], _NONE), whole[1] * slope, np.where(slope, whole[2], 1.0)
    det = S0 * S2 - S1 * S1
    fit = count > 1 + slope
    fit &= det > _SMALL * S0 * S2
    det = np.where(fit, det, 1.0)
    y0, y1 = whole[3], whole[4] * slope
    b0, b1 = (S2 * y0 - S1 * y1) / det, (S0 * y1 - S1 * y0) / det
    rss = np.maximum(whole[5] - y0 * b0 - y1 * b1, 0.0)
    size = np.array(
        [float(np.median(variances[known[:, j], j])) if known[:, j].any() else 1.0 for j in range(w.shape[1])]
    )

    def mixed(gg: Array, g0: Array, g1: Array, gy: Array) -> Array:
        g1 = g1 * slope
        p0, p1 = (S2 * g0 - S1 * g1) / det, (S0 * g1 - S1 * g0) / det
        free = gg - g0 * p0 - g1 * p1
        is_free = fit & (free > _SMALL * (gg + _NONE))
        free = np.where(is_free, free, 0.0)
        along = np.where(is_free, gy - g0 * b0 - g1 * b1, 0.0)
        ratios = [_t_ratio(free, along, rss, size * s**2, (count - 1 - slope, prior_dof)) for s in SIZES]
        return np.asarray(np.logaddexp.reduce(ratios, axis=0) - np.log(len(SIZES)))

    before = np.concatenate([t[:1], t[:-1]])[None]
    step = mixed(A, A, At, B)
    drift = mixed(Att - 2 * before * At + before**2 * A, At - before * A, Att - before * At, Bt - before * B)
    later = (np.arange(n)[None, :] > ends[:, None])[..., None]  # onsets that lie ahead of the look
    return Ratios(np.where(later, 0.0, step), np.where(later, 0.0, drift))


def _prefix_sums(terms: Array) -> Array:
    return np.concatenate([np.zeros((1, terms.shape[1])), np.cumsum(terms, axis=0)])


def _t_ratio(free: Array, along: Array, rss: Array, v: Array, dof: tuple[Array, float]) -> Array:
    """Return the log marginal ratio of one regressor with prior variance v s^2, s^2 and the rest integrated out."""
    rest, prior = dof
    nu = prior + np.maximum(rest, 0)
    total = prior + rss + _NONE
    left = np.maximum(total - along**2 * v / (1 + v * free), 1e-12 * total)
    return np.asarray(-0.5 * np.log1p(v * free) - 0.5 * nu * np.log(left / total))
