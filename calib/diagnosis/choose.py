"""Choice of the explanations that a drive needs: ranked by score tests, solved, kept on evidence.

Tests at one solution rank the whole catalogue. The best are solved for; where the evidence, all variances found anew,
is better by enough, the best of them stays, and the rest is ranked again; an explanation that others make needless
goes. A drive that needs none costs no further solution.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from boxcal.calib.diagnosis.camera_knocked import CameraKnocked
from boxcal.calib.diagnosis.catalogue import candidates
from boxcal.calib.diagnosis.cause import Cause, Solved, can_be
from boxcal.calib.diagnosis.doubts import Doubt, doubts
from boxcal.calib.diagnosis.evidence import log_evidence
from boxcal.calib.diagnosis.focus import FocusChanged
from boxcal.calib.diagnosis.ranking import Ranked, rank
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.rounds import refit
from boxcal.calib.likelihood.slip_profile import slip_profile
from boxcal.target.arrays import Array

NEEDED = 5.0
"""Logarithm of the Bayes factor that an explanation needs, over its family.

At most ``families * exp(-NEEDED)`` of faultless drives have one that good (Markov's bound);
``benchmarks/explanations.py`` counts how many do.
"""
MOST = 4
"""Explanations of one drive at most."""
AT_A_STOP = (CameraKnocked, FocusChanged)
"""What may come about again before another stop."""
_PROMISING = 0.0
"""An explanation is solved for where its score test gives a Bayes factor whose logarithm is larger than this.

At a solution without it variances have grown to take it in, so that its score test says less than its solution does (of
camera knocks by a tenth of a degree: 0 to 1 where the solution says 2 to 4); what is not adopted is a doubt with that.
"""
_TRIED = 3
LEAST_LEGS = 6
"""With fewer legs nothing is explained: a few unknowns would explain anything."""
_NEEDLESS = 0.01
"""An explanation goes again where the others leave it this chance of being nothing, or more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explained:
    """A solution with what it needed to be explained.

    Attributes
    ----------
    fit
        The solution.
    adopted
        The explanations in it, and the logarithm of each one's Bayes factor.
    doubts
        Explanations that are not in it but may be true.
    """

    fit: Fit
    adopted: tuple[tuple[Cause, float], ...] = ()
    doubts: tuple[Doubt, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Adopted explanations, then the likely ones of the others, in words.

        What came about several times may have come about more often: it is solved for, but not allowed for.
        """
        adopted = [cause.finding(_solved(self.fit, cause, gain), self.fit.problem) for cause, gain in self.adopted]
        families = [finding.cause for finding in adopted]
        adopted = [replace(f, adopted=f.adopted and families.count(f.cause) == 1) for f in adopted]
        perhaps = [doubt.finding(self.fit.problem) for doubt in self.doubts]
        return (*adopted, *(finding for finding in perhaps if finding is not None))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """The explanation that is needed most with its Bayes factor and the legs' weights it was found with; the rest."""

    cause: Cause | None = None
    gain: float = 0.0
    legs: Array | None = None
    doubts: tuple[Doubt, ...] = ()


def explain(fit: Fit, needed: float = NEEDED) -> Explained:
    """Return the solution with the explanations that it needs.

    Parameters
    ----------
    fit
        A solution without explanations.
    needed
        Logarithm of the Bayes factor that an explanation needs.
    """
    if np.count_nonzero(fit.problem.leg_known) < LEAST_LEGS:
        return Explained(fit=fit)
    found = Explained(fit=fit)
    vanished: tuple[str, ...] = ()
    for _ in range(MOST):
        more = _next(found, vanished, needed)
        if more.cause is None or more.legs is None:
            return replace(found, doubts=more.doubts)
        start = replace(fit, weights=replace(fit.weights, legs=more.legs))
        adopted = (*found.adopted, (more.cause, more.gain))
        here = _refit(start, [c for c, _ in adopted])
        if here is None or not _shows(here, more.cause, more.gain):  # once faulty legs are left out again
            vanished = (*vanished, more.cause.family)
            continue
        kept = tuple(a for a in adopted if a[0] is more.cause or not needless(_solved(here, *a)))
        fewer = _refit(start, [c for c, _ in kept]) if len(kept) < len(adopted) else None
        found = Explained(fit=here, adopted=adopted)
        if fewer is not None and _shows(fewer, more.cause, more.gain):
            found = Explained(fit=fewer, adopted=kept)
    return replace(found, doubts=_next(found, vanished, np.inf).doubts)


def _next(found: Explained, vanished: Sequence[str], needed: float) -> _Search:
    """Return the explanation that is needed most; where none is, those that are nearly needed.

    Families that vanished are not solved for again, but may be doubts: what is left of them the sigmas must allow for.
    """
    fit = found.fit
    every = [cause for cause in candidates(fit) if not any(_same(cause, had) for had, _ in found.adopted)]
    here = rank(fit, every)
    tried: list[tuple[Ranked, Fit]] = [(best, fit) for best in here]
    if np.any(fit.problem.leg_known & (fit.weights.legs == 0)):
        whole = _with_all_legs(fit)
        tried += [(best, whole) for best in rank(whole, [cause for cause in every if not cause.in_pictures])]
    tried = sorted((t for t in tried if t[0].cause.family not in vanished), key=lambda t: -t[0].log_bayes)
    before, best, most = log_evidence(fit), _Search(), needed
    known = {id(ranked): ranked.log_bayes for ranked in here}
    for ranked, start in tried[:_TRIED]:
        if ranked.log_bayes < _PROMISING:
            break
        cause = ranked.cause
        held = replace(start, options=replace(fit.options, find_faults=False))
        trial = _refit(held, [cause])
        # Legs that count again raise the evidence by themselves: the cause is compared with them and without it, too.
        without = before if start is fit else max(before, log_evidence(start))
        gain = 0.0 if trial is None else log_evidence(trial) - without - ranked.log_family
        if trial is None or not _shows(trial, cause, gain):  # what is gained is legs that count again, not the cause
            gain = min(gain, 0.0)
        if start is fit:
            known[id(ranked)] = gain
        if gain > most:
            best, most = _Search(cause=cause, gain=gain, legs=start.weights.legs), gain
    if best.cause is not None:
        return best
    return _Search(doubts=doubts([(ranked, known[id(ranked)]) for ranked in here]))


def _same(cause: Cause, had: Cause) -> bool:
    """Tell whether a cause is of the family of another and may not be at work beside it: not at another stop."""
    if cause.family != had.family:
        return False
    at, before = (cause.stop, had.stop) if isinstance(cause, AT_A_STOP) and isinstance(had, AT_A_STOP) else (0, 0)
    return at == before


def _refit(fit: Fit, causes: Sequence[Cause]) -> Fit | None:
    """Return the solution with more explanations; None where its equations cannot be solved, as of senseless data."""
    try:
        return refit(fit, causes)
    except np.linalg.LinAlgError:
        return None


def _with_all_legs(fit: Fit) -> Fit:
    """Return the solution with all legs counted, not solved again: a common cause makes some look like outliers."""
    weights = replace(fit.weights, legs=fit.problem.leg_known.astype(np.float64))
    profile = slip_profile(fit.problem, fit.at, fit.components, weights)
    return replace(fit, weights=weights, profile=profile)


def _solved(fit: Fit, cause: Cause, gain: float) -> Solved:
    first = fit.problem.names.index(cause.names[0])
    rows = slice(first, first + len(cause.names))
    start = first - fit.problem.explained.start
    values = fit.state.explained[start : start + len(cause.names)]
    return Solved(values=values, cov=fit.cov[rows, rows], p_value=float(np.exp(-max(gain, 0.0))))


def _shows(fit: Fit, cause: Cause, gain: float) -> bool:
    """Return whether a cause that was solved for has a size that is clearly there, and that it can have.

    A solution whose noise levels do not settle proves nothing: with few legs a cause that takes up one of them can
    leave so little that the slip of all falls to nothing, and the evidence grows without bound.
    """
    if not fit.converged:
        return False
    solved = _solved(fit, cause, gain)
    return not needless(solved) and can_be(cause, solved)


def needless(solved: Solved) -> bool:
    """Return whether the size of a cause that was solved for may be nothing, by chance."""
    square = float(solved.values @ np.linalg.solve(solved.cov, solved.values))
    return bool(chdtrc(len(solved.values), square) > _NEEDLESS)
