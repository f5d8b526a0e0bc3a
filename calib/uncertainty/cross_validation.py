"""Stops held out in turn: predicted from wheels and calibration, then compared with what the camera saw."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import estimate, unsolvable
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_residuals import FIRST_STOP, leg_covariance
from boxcal.calib.likelihood.levenberg_marquardt import Weights, linearize, picture_equations
from boxcal.calib.likelihood.normal_equations import eliminate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.likelihood.state import POSE
from boxcal.calib.uncertainty.part_of_drives import fit_part
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS
from boxcal.target.arrays import Array

_STEPS = 30
_CLOSE = 1e-10
"""m and rad: a step that changes the pose by less is the last."""


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
    found: Estimate | None = None,
) -> Validation:
    """Hold every stop but the first of each drive out in turn, calibrate without it, and predict it.

    Each calibration is one round from the estimate of all stops, with what that left out.

    Parameters
    ----------
    drives, start, options
        As for :func:`boxcal.calib.likelihood.estimate`.
    found
        That estimate, if it is known already.

    Raises
    ------
    CalibError
        If a drive less one stop does not determine the calibration.
    """
    options = options or EstimateOptions()
    whole = found or estimate(drives, start, options)
    options = replace(options, lens=whole.camera.kind)
    used = [drive.stops for drive in whole.drives]
    if sum(len(stops) for stops in used) <= MIN_STOPS:
        raise CalibError(f"{MIN_STOPS} usable stops, one more is needed to hold one out", remedy="add stops")
    out = []
    for d, stops in enumerate(used):
        for before, j in pairwise(stops):
            kept = tuple(tuple(k for k in s if (e, k) != (d, j)) for e, s in enumerate(used))
            try:
                fit = fit_part(drives, kept, whole, options)
            except np.linalg.LinAlgError as error:
                raise unsolvable(sum(len(s) for s in kept)) from error
            out.append(_predict(fit, drives, d, before, j))
    return Validation(stops=tuple(out))


def _predict(fit: Fit, drives: Sequence[Correspondences], d: int, before: int, j: int) -> HeldOut:
    problem = fit.problem
    row = int(np.flatnonzero((problem.drive == d) & (problem.stop == before))[0])
    pair = build_problem(drives, [(before, j) if e == d else () for e in range(len(drives))], fit.options, problem.step)
    pair = with_floor(pair, problem.floor_px)
    first = fit.state
    state = replace(
        first,
        poses=np.repeat(first.poses[row : row + 1], 2, axis=0),
        lean=np.concatenate([first.lean[row : row + 1], np.zeros((1, 3))]),
        growth=np.zeros(2),
        encoder_errors=np.concatenate([first.encoder_errors[row : row + 1], np.zeros((1, 2))]),
    )
    corners = int(pair.corner_starts[-1])
    only_new = (np.arange(corners) >= pair.corner_starts[1]).astype(np.float64)
    use = Weights(corners=only_new, legs=np.ones(1))
    # First where the wheels lead, then where the camera sees it.
    theta = state.poses[0, 2]
    lead = linearize(pair, state, use).legs.residual[0]
    c, s = np.cos(theta), np.sin(theta)
    state.poses[1] += (c * lead[0] - s * lead[1], s * lead[0] + c * lead[1], lead[2])
    for _ in range(_STEPS):
        at = linearize(pair, state, use)
        seen, local = eliminate(picture_equations(pair, at, fit.components)[0])
        D, B = seen.D[1, POSE, POSE], seen.B[1, :, POSE]
        change = np.linalg.solve(D, seen.c[1, POSE])
        if np.max(np.abs(change)) < _CLOSE:
            break
        d_local = (local.c[1] - local.by_chain[1, :, POSE] @ change) * fit.components.local_sigma
        poses, lean, growth = state.poses.copy(), state.lean.copy(), state.growth.copy()
        poses[1] += change
        lean[1] += d_local[:3]
        growth[1] += d_local[3]
        state = replace(state, poses=poses, lean=lean, growth=growth)
    J = at.legs.jacobian[0]
    pose, readings = J[:, 8:11], J[:, 11:13]  # of the stop that was held out
    by_shared = -pose @ np.linalg.solve(D, B.T)
    by_shared[:, WHEELS] += J[:, :3]
    solution = fit.profile.solution.at(fit.profile.best)
    joint = solution.joint_covariances()[row]
    n = len(fit.cov)
    joint[:n, :n] = fit.cov
    G = np.concatenate([by_shared, J[:, FIRST_STOP]], axis=1)
    cov = (
        G @ joint @ G.T
        + pose @ np.linalg.solve(D, pose.T)
        + readings @ readings.T
        + leg_covariance(pair, at.legs.model, np.array(fit.components.slip))[0]
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
