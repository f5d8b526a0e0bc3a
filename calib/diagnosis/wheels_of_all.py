"""Causes in the wheels as all cameras of a robot show them: the wheels are one, and so are what is doubted of them.

A camera that sees every second stop sees every second leg. By itself it shows of a cause in the wheels less than all
cameras together, and the more exact solution of all would be the more wrong for it. So the causes that cameras show by
themselves, and all others of the catalogue, are tested at the solution of all.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.diagnosis.catalogue import of_wheels
from boxcal.calib.diagnosis.cause import Cause, Solved, can_be
from boxcal.calib.diagnosis.choose import LEAST_LEGS, MOST, NEEDED, needless
from boxcal.calib.diagnosis.doubts import Doubt, doubts
from boxcal.calib.diagnosis.explained_estimate import ExplainedEstimate, probable_causes
from boxcal.calib.diagnosis.ranking import Ranked, rank_wheels
from boxcal.calib.geometry.parameters import COUNT, MOUNTING, ORDER, TRANSLATION
from boxcal.calib.likelihood.cameras.estimates import Cameras, apart, columns_of, solve_cameras
from boxcal.calib.likelihood.cameras.solve import RobotFit
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


def solve_explained(
    alone: Sequence[ExplainedEstimate], drives: Sequence[Sequence[Correspondences]], slip: float | None = None
) -> Cameras:
    """Return the estimates of a robot's cameras from all of them together, with the causes in the wheels that all show.

    Parameters
    ----------
    alone
        Each camera's own estimate.
    drives, slip
        As of :func:`boxcal.calib.likelihood.cameras.estimates.solve_cameras`.
    """
    causes = {cause.names: (cause, np.inf) for camera in alone for cause in camera.wheels}
    together = _solved(alone, drives, slip, causes)
    for _ in range(MOST):
        fit = together.fit
        if fit is None:
            break
        kept = {names: c for names, c in causes.items() if not needless(_size(fit, *c))}
        if len(kept) < len(causes):
            causes, together = kept, _solved(alone, drives, slip, kept)
            continue
        best = next(iter(_ranked(fit, causes)), None)
        if best is None or best.log_bayes < NEEDED:
            break
        more = {**causes, best.cause.names: (best.cause, best.log_bayes)}
        trial = _solved(alone, drives, slip, more)
        if trial.fit is None or not _shows(trial.fit, best.cause, best.log_bayes):
            break
        causes, together = more, trial
    if together.fit is None:
        return apart([camera.found for camera in alone], together.apart)
    rest = doubts([(ranked, ranked.log_bayes) for ranked in _ranked(together.fit, causes)])
    return _widened(together, together.fit, list(causes.values()), rest)


_Causes = dict[tuple[str, ...], tuple[Cause, float]]
"""Causes by their unknowns, with the logarithm of what speaks for each."""


def _solved(
    alone: Sequence[ExplainedEstimate],
    drives: Sequence[Sequence[Correspondences]],
    slip: float | None,
    causes: _Causes,
) -> Cameras:
    found, fits = [camera.but_wheels for camera in alone], [camera.fit for camera in alone]
    return solve_cameras(found, fits, drives, slip, tuple(cause for cause, _ in causes.values()))


def _ranked(fit: RobotFit, have: _Causes) -> list[Ranked]:
    """Return the best explanation of each family in the wheels that the solution has none of; none of few legs."""
    if np.count_nonzero(fit.problem.leg_known) < LEAST_LEGS:
        return []
    families = {cause.family for cause, _ in have.values()}
    return rank_wheels(fit, [cause for cause in of_wheels(fit) if cause.family not in families])


def _size(fit: RobotFit, cause: Cause, gain: float) -> Solved:
    first = fit.problem.names.index(cause.names[0])
    rows = slice(first, first + len(cause.names))
    start = first - int(fit.problem.explained.start)
    values = fit.found.state.body.explained[start : start + len(cause.names)]
    return Solved(values=values, cov=fit.cov[rows, rows], p_value=float(np.exp(-gain)))


def _shows(fit: RobotFit, cause: Cause, gain: float) -> bool:
    solved = _size(fit, cause, gain)
    return fit.converged and not needless(solved) and can_be(cause, solved)


def _widened(together: Cameras, fit: RobotFit, adopted: Sequence[tuple[Cause, float]], of: Sequence[Doubt]) -> Cameras:
    """Return the estimates as unsure as what may be at work in the wheels makes them, and with what was found there."""
    names = list(fit.problem.names)
    R = np.eye(len(names))
    for part, camera in zip(fit.robot.parts, fit.found.state.cameras, strict=True):
        at = part.columns[TRANSLATION]
        R[np.ix_(at, at)] = camera.T_body_cam[:3, :3]
    seen = np.zeros((len(names), len(names)))
    for doubt in of:
        seen += R @ doubt.widening @ R.T
    unseen = np.zeros_like(seen)
    for cause, probability in probable_causes([cause for cause, _ in adopted], of):
        for name, sigma in cause.unseen.items():
            at = np.unique([part.columns[ORDER.index(name)] for part in fit.robot.parts])
            unseen[np.ix_(at, at)] += probability * sigma**2  # of all cameras alike
    said = [cause.finding(_size(fit, cause, gain), fit.problem) for cause, gain in adopted]
    said += [finding for doubt in of if (finding := doubt.finding(fit.problem)) is not None]
    mounted = np.concatenate([part.columns[MOUNTING] for part in fit.robot.parts])
    return replace(
        together,
        estimates=tuple(
            _estimate(own, columns_of(fit, c), seen, unseen, said) for c, own in enumerate(together.estimates)
        ),
        mountings=together.mountings + (seen + unseen)[np.ix_(mounted, mounted)],
    )


def _estimate(own: Estimate, columns: list[int], seen: Array, unseen: Array, said: Sequence[Finding]) -> Estimate:
    odometry = own.cov_all + seen[np.ix_(columns, columns)]
    cov_all = odometry + unseen[np.ix_(columns, columns)]
    return replace(
        own,
        cov=cov_all[:COUNT, :COUNT],
        cov_all=cov_all,
        odometry_cov=odometry[:COUNT, :COUNT] if np.any(unseen) else own.odometry_cov,
        findings=(*said, *own.findings),
    )
