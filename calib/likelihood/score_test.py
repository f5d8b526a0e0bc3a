"""Score (Rao) tests of explanations at the present solution: one linearization, no new solution.

With the score g of an explanation's unknowns (zero at the solution) and their information I, all other unknowns
eliminated, ``g I^-1 g`` is chi-square where the explanation is not needed, and ``(I + P^-1)^-1 g`` is what it would
be found as (P: its prior). Slip is known to a few degrees of freedom only, so the chance is a mean over its levels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.explanation_equations import NewColumns, explanation_equations, new_columns
from boxcal.calib.likelihood.fit import Tested
from boxcal.calib.likelihood.information_inverse import invert
from boxcal.calib.likelihood.log_sum import log_sum
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScoreTest:
    """Score test of one explanation at the present solution.

    Attributes
    ----------
    explanation
        Which.
    statistic
        ``g I^-1 g`` at the most probable slip.
    freedom
        How many of its unknowns the data can determine.
    p_value
        Chance of a statistic as large without it, slip's uncertainty included.
    estimate, sigma, cov : (k,), (k,), (k, k)
        What its unknowns would be found as, in one step, their standard deviations and covariance.
    log_evidence
        Logarithm of the Bayes factor for it, with its prior, all other unknowns and slip averaged.
    shift : (n,)
        What the other shared unknowns would change by if it were solved for.
    shift_cov : (n, n)
        What their covariance would grow by.
    """

    explanation: Explanation
    statistic: float
    freedom: int
    p_value: float
    estimate: Array
    sigma: Array
    cov: Array
    log_evidence: float
    shift: Array
    shift_cov: Array


def score_tests(
    fit: Tested, explanations: Sequence[Explanation], columns: NewColumns | None = None
) -> tuple[ScoreTest, ...]:
    """Return the tests of some explanations, each by itself, about one solution.

    Parameters
    ----------
    fit
        The solution.
    explanations
        Any number.
    columns
        What their unknowns would do, if it is there already: variance components do not change it.
    """
    if not explanations:
        return ()
    columns = columns or new_columns(fit, explanations)
    found = explanation_equations(fit, fit.components, fit.profile.slip, columns)
    gain = found.with_shared @ invert(found.information)[0]
    score = found.right_new - np.einsum("kij,kj->ki", gain, found.right)
    sizes = np.array([len(explanation.prior) for explanation in explanations])
    firsts = np.cumsum(sizes) - sizes
    out: dict[int, ScoreTest] = {}
    for size in np.unique(sizes):
        some = np.flatnonzero(sizes == size)
        rows = firsts[some, None] + np.arange(size)  # (E, q)
        own = np.moveaxis(gain[:, rows], 0, 1)  # (E, K, q, n)
        information = found.blocks(rows) - own @ np.moveaxis(np.swapaxes(found.with_shared[:, rows], -1, -2), 0, 1)
        parts = np.moveaxis(score[:, rows], 0, 1), information, own
        out |= zip(some.tolist(), _tests([explanations[e] for e in some.tolist()], *parts, fit), strict=True)
    return tuple(out[e] for e in range(len(explanations)))


def _tests(
    explanations: Sequence[Explanation], g: Array, information: Array, gain: Array, fit: Tested
) -> list[ScoreTest]:
    """Return the tests of E explanations of q unknowns each, from (E, K, q), (E, K, q, q) and (E, K, q, n)."""
    prior = np.array([explanation.prior for explanation in explanations], dtype=np.float64)  # (E, q)
    square = prior[:, :, None] * prior[:, None]
    scaled, z = information * square[:, None], g * prior[:, None]  # in units of the prior
    values, vectors = np.linalg.eigh((scaled + np.swapaxes(scaled, -1, -2)) / 2)
    determined = values > _DETERMINED
    known = np.where(determined, values, 0.0)
    along2 = np.where(determined, np.einsum("ekij,eki->ekj", vectors, z) ** 2, 0.0)
    statistic = np.sum(along2 / np.where(determined, values, 1.0), axis=-1)
    freedom = determined.sum(axis=-1)
    weight, best = fit.profile.weight, fit.profile.best
    p_value = np.where(freedom > 0, special.chdtrc(np.maximum(freedom, 1), statistic), 1.0) @ weight
    log_bayes = 0.5 * np.sum(along2 / (1 + known) - np.log1p(known), axis=-1)
    log_evidence = log_sum(fit.profile.log_weight + log_bayes)
    cov = np.linalg.inv(scaled[:, best] + np.eye(prior.shape[1])) * square
    estimate = (cov @ g[:, best, :, None])[..., 0]
    sigma = np.sqrt(np.maximum(np.diagonal(cov, axis1=1, axis2=2), 0.0))
    to_shared = -np.swapaxes(gain[:, best], 1, 2)  # (E, n, q)
    shift = (to_shared @ estimate[..., None])[..., 0]
    shift_cov = to_shared @ cov @ np.swapaxes(to_shared, 1, 2)
    return [
        ScoreTest(
            explanation=explanation,
            statistic=float(statistic[e, best]),
            freedom=int(freedom[e, best]),
            p_value=float(p_value[e]),
            estimate=estimate[e],
            sigma=sigma[e],
            cov=cov[e],
            log_evidence=float(log_evidence[e]),
            shift=shift[e],
            shift_cov=shift_cov[e],
        )
        for e, explanation in enumerate(explanations)
    ]


_DETERMINED = 1e-6
"""Information in units of the prior below which the data say nothing of a direction."""
