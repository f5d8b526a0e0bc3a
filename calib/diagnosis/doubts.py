"""Explanations that are nearly needed: too uncertain to be solved for, too likely for sigmas that know nothing of them.

A cause that the drive can hardly distinguish from none may move a parameter by many of its sigmas (a scrub on the spot
correlates by -.98 with the wheel separation). So solutions with and without it are averaged (Bayesian model averaging,
Hoeting et al. 1999, DOI 10.1214/ss/1009212519): the estimate stays, its covariance holds what the cause would change,
weighed by how probable the cause is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.cause import Cause, Solved, can_be
from boxcal.calib.diagnosis.ranking import Ranked
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.log_sum import log_sum
from boxcal.calib.likelihood.problem import Problem
from boxcal.target.arrays import Array

RARE = 3.0
"""Logarithm of the odds against a cause beforehand: one robot in twenty has it."""
LEAST = 0.03
"""A cause less probable than this changes no sigma."""
NAMED = 0.5
"""A cause at least as probable as this is named."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Doubt:
    """One cause that may be at work.

    Attributes
    ----------
    cause
        Which.
    log_bayes
        Logarithm of its Bayes factor over its family.
    probability
        Probability that it is the cause at work, of all that may be and none.
    values, cov : (k,), (k, k)
        What its unknowns would be found as.
    shift, shift_cov : (n,), (n, n)
        What the other shared unknowns and their covariance would change by.
    """

    cause: Cause
    log_bayes: float
    probability: float
    values: Array
    cov: Array
    shift: Array
    shift_cov: Array

    @property
    def widening(self) -> Array:
        """Addition of the averaging to the covariance of the shared unknowns, (n, n)."""
        return np.asarray(self.probability * (self.shift_cov + np.outer(self.shift, self.shift)))

    def finding(self, problem: Problem) -> Finding | None:
        """Return what is said of it; None where it is too improbable for words, or its size is not one it can have."""
        solved = Solved(values=self.values, cov=self.cov, p_value=float(np.exp(-self.log_bayes)))
        if self.probability < NAMED or not can_be(self.cause, solved):
            return None
        found = self.cause.finding(solved, problem)
        return Finding(
            cause=found.cause,
            text=f"perhaps {found.text} (probability {self.probability:.0%} among the causes that were tried: the "
            "standard deviations allow for it)",
            advice=f"More stops would show whether it is that. {found.advice}",
            stops=found.stops,
            size=found.size,
            sigma=found.sigma,
            unit=found.unit,
            p_value=found.p_value,
            probability=self.probability,
        )


def doubts(ranked: Sequence[tuple[Ranked, float]]) -> tuple[Doubt, ...]:
    """Return the causes that may be at work, the most probable first.

    Parameters
    ----------
    ranked
        The best explanation of each family, and the logarithm of its Bayes factor as it is known best.
    """
    odds = np.array([log_bayes for _, log_bayes in ranked]) - RARE
    probability = np.exp(odds - log_sum(np.append(odds, 0.0)))
    out = [_doubt(r, b, float(p)) for (r, b), p in zip(ranked, probability, strict=True) if p > LEAST]
    return tuple(sorted(out, key=lambda doubt: -doubt.probability))


def _doubt(ranked: Ranked, log_bayes: float, probability: float) -> Doubt:
    test = ranked.test
    return Doubt(
        cause=ranked.cause,
        log_bayes=log_bayes,
        probability=probability,
        values=test.estimate,
        cov=test.cov,
        shift=test.shift,
        shift_cov=test.shift_cov,
    )
