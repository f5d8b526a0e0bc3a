"""Ranks explanations by score tests at one solution: no new solution, one linearization of all."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.diagnosis.cause import Cause
from boxcal.calib.likelihood.explanation_equations import new_columns
from boxcal.calib.likelihood.fit import Fit, Tested
from boxcal.calib.likelihood.log_sum import log_sum
from boxcal.calib.likelihood.score_test import ScoreTest, score_tests
from boxcal.calib.likelihood.slip_profile import fixed_profile
from boxcal.target.arrays import Array

_LESS_LEAN = (1.0, 0.3)
"""Fractions of the lean found at which causes in the images are tested.

A camera that was knocked makes robots seem to lean; with the cause in the model they may lean less.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ranked:
    """The best explanation of a family.

    Attributes
    ----------
    cause
        Which.
    log_bayes
        Logarithm of the family's Bayes factor: the mean over all that it tries.
    log_family
        How much less that is than the best one's own.
    test
        The score test at the solution as it is.
    """

    cause: Cause
    log_bayes: float
    log_family: float
    test: ScoreTest


def rank(fit: Fit, causes: Sequence[Cause]) -> list[Ranked]:
    """Return the best explanation of each family, the most probable first."""
    wheels = [cause for cause in causes if not cause.in_pictures]
    pictures = [cause for cause in causes if cause.in_pictures]
    of_pictures = zip(pictures, _of_pictures(fit, pictures), strict=True)
    return _ranked([*_of_wheels(fit, wheels), *((cause, gain, test) for cause, (gain, test) in of_pictures)])


def rank_wheels(fit: Tested, causes: Sequence[Cause]) -> list[Ranked]:
    """Return the best explanation of each family in the wheels, the most probable first."""
    return _ranked(_of_wheels(fit, causes))


def _of_wheels(fit: Tested, causes: Sequence[Cause]) -> list[tuple[Cause, float, ScoreTest]]:
    return [(cause, test.log_evidence, test) for cause, test in zip(causes, score_tests(fit, causes), strict=True)]


def _ranked(found: Sequence[tuple[Cause, float, ScoreTest]]) -> list[Ranked]:
    """Return the best of each family of causes, with logarithms of their Bayes factors, and their tests."""
    out = []
    for family in dict.fromkeys(cause.family for cause, _, _ in found):
        members = [member for member in found if member[0].family == family]
        cause, gain, test = max(members, key=lambda member: member[1])
        mean = float(log_sum(np.array([member[1] for member in members])) - np.log(len(members)))
        out.append(Ranked(cause=cause, log_bayes=mean, log_family=gain - mean, test=test))
    return sorted(out, key=lambda r: -r.log_bayes)


def _of_pictures(fit: Fit, causes: Sequence[Cause]) -> list[tuple[float, ScoreTest]]:
    """Return the logarithms of the Bayes factors, lean averaged over less of it, slip as it is; and the tests."""
    if not causes:
        return []
    fractions = _LESS_LEAN if fit.components.lean > 0 else (1.0,)
    gains: list[Array] = []
    tests: list[tuple[ScoreTest, ...]] = []
    first = 0.0
    columns = new_columns(fit, causes)
    for fraction in fractions:
        components = replace(fit.components, lean=fraction * fit.components.lean)
        profile = fixed_profile(fit.problem, fit.at, components, fit.weights)
        first = profile.log_evidence if fraction == 1.0 else first
        tests.append(score_tests(replace(fit, components=components, profile=profile), causes, columns))
        gains.append(np.array([test.log_evidence for test in tests[-1]]) + profile.log_evidence - first)
    averaged = log_sum(np.array(gains), axis=0) - np.log(len(fractions))
    return [(float(gain), test) for gain, test in zip(averaged, tests[0], strict=True)]
