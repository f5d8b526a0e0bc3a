"""Stops held out in turn: predicted from wheels and calibration, then compared with what the camera saw."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood.estimator import fit_cameras, step_of
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.initial_guess import camera_start
from boxcal.calib.likelihood.levenberg_marquardt import Weights, linearise
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.likelihood.residuals import leg_covariance
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_STEPS = 30


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOut:
    """One stop that the calibration did not see.

    Attributes
    ----------
    drive, stop
        Numbers from 0.
    from_stop
        The stop before it, from which it is predicted by the wheels.
    error : (3,), m and rad
        Predicted less seen: along and across the heading at ``from_stop``, and heading.
    sigma : (3,), m and rad
        Predicted standard deviations: calibration, wheels and camera together.
    chi_square
        Squared error over its predicted covariance; 3 on average where the prediction holds.
    corner_rms_px : px
        Root mean square reprojection error of its corners with the calibration made without it, the pose free.
    """

    drive: int
    stop: int
    from_stop: int
    error: Array
    sigma: Array
    chi_square: float
    corner_rms_px: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Validation:
    """All stops that were held out.

    Attributes
    ----------
    stops
        One entry each.
    """

    stops: tuple[HeldOut, ...]

    @property
    def position_rms(self) -> float:
        """Root mean square position error, m."""
        return float(np.sqrt(np.mean([np.sum(s.error[:2] ** 2) for s in self.stops])))

    @property
    def heading_rms(self) -> float:
        """Root mean square heading error, rad."""
        return float(np.sqrt(np.mean([s.error[2] ** 2 for s in self.stops])))

    @property
    def normalised(self) -> float:
        """Root mean square error in predicted standard deviations: 1 where the predictions hold."""
        return float(np.sqrt(np.mean([s.chi_square for s in self.stops]) / 3))


def validate(
    drives: Sequence[Correspondences],
    start: Sequence[FourSteps] | FourSteps | None = None,
    options: EstimateOptions | None = None,
) -> Validation:
    """Hold every stop but the first of each drive out in turn, calibrate without it, and predict it.

    Parameters
    ----------
    drives, start, options
        As for :func:`boxcal.calib.likelihood.estimate`.

    Raises
    ------
    CalibError
        If a drive less one stop does not determine the calibration.
    """
    options = options or EstimateOptions()
    cameras = camera_start(drives, start)
    step = step_of(drives, options)
    out = []
    for d, stops in enumerate(cameras.kept):
        for before, j in pairwise(stops):
            kept = tuple(tuple(k for k in s if (e, k) != (d, j)) for e, s in enumerate(cameras.kept))
            fit = fit_cameras(drives, cameras.only(kept), options, step)
            out.append(_predict(fit, drives, d, before, j))
    return Validation(stops=tuple(out))


def _predict(fit: Fit, drives: Sequence[Correspondences], d: int, before: int, j: int) -> HeldOut:
    problem, weights = fit.problem, fit.profile.weight
    row = int(np.flatnonzero((problem.drive == d) & (problem.stop == before))[0])
    pair = build_problem(drives, [(before, j) if e == d else () for e in range(len(drives))], fit.options, problem.step)
    first = fit.state
    state = replace(
        first,
        poses=np.repeat(first.poses[row : row + 1], 2, axis=0),
        readings=np.concatenate([first.readings[row : row + 1], np.zeros((1, 2))]),
    )
    corners = int(pair.corner_starts[-1])
    only_new = (np.arange(corners) >= pair.corner_starts[1]).astype(np.float64)
    use = Weights(corners=only_new, legs=np.ones(1))
    # First where the wheels lead, then where the camera sees it.
    theta = state.poses[0, 2]
    at = linearise(pair, state, use)
    lead = at.legs.residual[0]
    c, s = np.cos(theta), np.sin(theta)
    poses = state.poses.copy()
    poses[1] += (c * lead[0] - s * lead[1], s * lead[0] + c * lead[1], lead[2])
    for _ in range(_STEPS):
        at = linearise(pair, replace(state, poses=poses), use)
        change = np.linalg.solve(at.corner_normal.D[1, :3, :3], at.corner_normal.c[1, :3])
        poses = poses.copy()
        poses[1] += change
        if np.max(np.abs(change)) < 1e-10:
            break
    at = linearise(pair, replace(state, poses=poses), use)
    D, B = at.corner_normal.D[1, :3, :3], at.corner_normal.B[1, :, :3]
    J = at.legs.jacobian[0]
    by_shared = -J[:, 8:11] @ np.linalg.solve(D, B.T)
    by_shared[:, 5:8] += J[:, :3]
    solution = fit.profile.solution
    own, _ = solution.stop_blocks()
    best = int(np.argmax(weights))
    cross = -solution.Y[best, row] @ solution.cov[best]
    joint = np.block([[fit.cov, cross.T], [cross, own[best, row]]])
    G = np.concatenate([by_shared, J[:, 3:8]], axis=1)
    cov = (
        G @ joint @ G.T
        + fit.levels.pixel_factor**2 * J[:, 8:11] @ np.linalg.solve(D, J[:, 8:11].T)
        + J[:, 11:13] @ J[:, 11:13].T
        + leg_covariance(pair, at.legs.model, np.array(fit.levels.slip))[0]
    )
    error = at.legs.residual[0]
    off = np.linalg.solve(pair.whiten, at.residual_px[:, :, None])[only_new > 0, :, 0]
    return HeldOut(
        drive=d,
        stop=j,
        from_stop=before,
        error=error,
        sigma=np.sqrt(np.diag(cov)),
        chi_square=float(error @ np.linalg.solve(cov, error)),
        corner_rms_px=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
    )
