"""Score (Rao) tests of explanations at the present solution: one linearization, no new solution.

With the score g of an explanation's unknowns (zero at the solution) and their information I, all other unknowns
eliminated, ``g I^-1 g`` is chi-square where the explanation is not needed, and ``(I + P^-1)^-1 g`` is what it would
be found as (P: its prior). Slip is known to a few degrees of freedom only, so the chance is a mean over its levels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.levenberg_marquardt import linearize
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.slip_profile import profile_of
from boxcal.calib.likelihood.state import State
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
        How many of its unknowns the data can tell.
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


def score_tests(fit: Fit, explanations: Sequence[Explanation]) -> tuple[ScoreTest, ...]:
    """Return the tests of some explanations, each by itself, about one solution.

    Parameters
    ----------
    fit
        The solution.
    explanations
        Any number; they are linearized together.
    """
    if not explanations:
        return ()
    problem, state = extended(fit.problem, fit.state, explanations)
    at = linearize(problem, state, fit.weights)
    profile = profile_of(problem, at, fit.components, fit.profile.slip, fit.weights)
    S, d = profile.solution.information, profile.solution.d_shared
    n = len(fit.problem.names)
    s = np.einsum("kij,kj->ki", S, d)
    base = np.linalg.pinv(S[:, :n, :n], rcond=1e-14, hermitian=True)
    gain = S[:, n:, :n] @ base
    score = s[:, n:] - np.einsum("kij,kj->ki", gain, s[:, :n])
    information = S[:, n:, n:] - gain @ S[:, :n, n:]
    information -= np.diag(1 / np.square(problem.prior[n:]))
    out, first = [], 0
    for explanation in explanations:
        rows = slice(first, first + len(explanation.names))
        first = rows.stop
        out.append(_test(explanation, score[:, rows], information[:, rows, rows], gain[:, rows], fit))
    return tuple(out)


def _test(explanation: Explanation, g: Array, information: Array, gain: Array, fit: Fit) -> ScoreTest:
    prior = np.asarray(explanation.prior, dtype=np.float64)
    scaled, z = information * np.outer(prior, prior), g * prior  # in units of the prior
    values, vectors = np.linalg.eigh((scaled + np.swapaxes(scaled, 1, 2)) / 2)
    told = values > _TOLD
    along = np.einsum("kij,ki->kj", vectors, z)
    statistic = np.sum(np.where(told, along**2 / np.where(told, values, 1.0), 0.0), axis=1)
    freedom = told.sum(axis=1)
    weight, best = fit.profile.weight, fit.profile.best
    p = np.where(freedom > 0, special.chdtrc(np.maximum(freedom, 1), statistic), 1.0)
    known = np.where(told, values, 0.0)
    log_bayes = 0.5 * np.sum(np.where(told, along**2, 0.0) / (1 + known) - np.log1p(known), axis=1)
    cov = np.linalg.inv(scaled[best] + np.eye(len(prior))) * np.outer(prior, prior)
    estimate = cov @ g[best]
    return ScoreTest(
        explanation=explanation,
        statistic=float(statistic[best]),
        freedom=int(freedom[best]),
        p_value=float(weight @ p),
        estimate=estimate,
        sigma=np.sqrt(np.maximum(np.diag(cov), 0.0)),
        cov=cov,
        log_evidence=float(special.logsumexp(fit.profile.log_weight + log_bayes)),
        shift=-gain[best].T @ estimate,
        shift_cov=gain[best].T @ cov @ gain[best],
    )


_TOLD = 1e-6
"""Information in units of the prior below which the data say nothing of a direction."""


def extended(problem: Problem, state: State, explanations: Sequence[Explanation]) -> tuple[Problem, State]:
    """Return problem and state with more explanations, their unknowns at zero and last among the shared ones."""
    names = tuple(name for e in explanations for name in e.names)
    if len({*problem.names, *names}) < len(problem.names) + len(names):
        raise ValueError(f"explanations with unknowns {names}: a name stands twice")
    n, k = len(problem.names), len(names)
    information = np.zeros((n + k, n + k))
    information[:n, :n] = problem.information
    wider = replace(
        problem,
        names=problem.names + names,
        prior=np.concatenate([problem.prior, *(np.asarray(e.prior, dtype=np.float64) for e in explanations)]),
        component=problem.component + ("",) * k,
        unit=np.append(problem.unit, np.ones(k)),
        information=information,
        explanations=problem.explanations + tuple(explanations),
    )
    return wider, replace(state, explained=np.concatenate([state.explained, np.zeros(k)]))
