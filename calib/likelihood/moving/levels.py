"""Noise levels of frames on the move, by restricted maximum likelihood."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.levenberg_marquardt import Weights
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import Joint, maximised, solved, stepped
from boxcal.calib.likelihood.moving.system import Levels
from boxcal.calib.likelihood.outliers import flag_corners
from boxcal.calib.likelihood.slip_profile import LARGEST_SLIP, quiet_slip
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_JITTER_S = np.concatenate([[1e-6], np.geomspace(1e-4, 3e-2, 6)])
_SLIPS, _FINE_SLIPS, _FINE_JITTERS = 11, 7, 5
_LEAST_OF_QUIET = 0.05
"""Slip is taken as at least this share of what equals the quantisation."""
_LEAST_OF_STOPS = 0.05
"""And as this share of what stops show: frames are near to each other, and less would hide them in rounding."""
_AT_REST = 1.0
"""Promised decrease of the sum of squares from which on the solver did not get there."""
_LEAST_SWAY, _MOST_SWAY = 0.03, 100.0
_LEAST_SCALE = 1.0
"""A picture of a moving camera is never taken to be sharper than its covariances say."""
_IMPROBABLE = 1e-4
_ROUNDS = 2
_ALIKE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Settled:
    """Stops and frames at their maximum with the noise that they show.

    Attributes
    ----------
    joint
        At the maximum for the most probable noise.
    noise
        That noise.
    levels, weight
        Solutions about it at the levels of slip and jitter that are probable, and their weights (K,), which sum to 1.
    """

    joint: Joint
    noise: FrameNoise
    levels: Levels
    weight: Array

    @property
    def cov(self) -> Array:
        """Covariance of the shared unknowns, (n, n), the levels' uncertainty in it."""
        s, w = self.levels.solution, self.weight
        off = s.d_shared - w @ s.d_shared
        return np.asarray(np.tensordot(w, s.cov, 1) + np.einsum("k,ki,kj->ij", w, off, off))

    @property
    def best(self) -> int:
        """The most probable level's number."""
        return int(np.argmax(self.weight))


def settled(fit: Fit, drive: Correspondences, joint: Joint, noise: FrameNoise) -> Settled | None:
    """Return stops and frames at their maximum, with noise levels that the data tell; None if the solver fails.

    Parameters
    ----------
    fit, drive
        Solution of the stops, and their drive.
    joint, noise
        Where to begin.
    """
    reached = maximised(fit, drive, joint, noise)
    if reached is None:
        return None
    joint = reached
    noise, levels, weight = _updated(fit, joint, noise, None)
    for _ in range(_ROUNDS):
        before = noise
        joint = stepped(joint, levels, weight, _corner_weights(fit, joint, noise))
        noise, levels, weight = _updated(fit, joint, noise, levels)
        if _near(before, noise):
            break
    joint = stepped(joint, levels, weight)
    left = solved(fit, joint, noise, np.array([noise.slip]), np.array([noise.jitter_s])).solution.decrease
    if not (joint.at.valid and left[0] < _AT_REST):
        return None
    return Settled(joint=joint, noise=noise, levels=levels, weight=weight)


def _near(before: FrameNoise, after: FrameNoise) -> bool:
    pairs = ((before.slip, after.slip), (before.scale, after.scale), (before.jitter_s + 1e-5, after.jitter_s + 1e-5))
    return all(abs(np.log(b / a)) < _ALIKE for a, b in pairs)


def _updated(fit: Fit, joint: Joint, noise: FrameNoise, near: Levels | None) -> tuple[FrameNoise, Levels, Array]:
    """Return the noise about a state, the solutions at probable levels of slip and jitter, and their weights.

    ``near`` are levels that were probable nearby; without them all are looked at.
    """
    noise = replace(noise, scale=_scale(fit, joint))
    at_noise = solved(fit, joint, noise, np.array([noise.slip]), np.array([noise.jitter_s]))
    noise = replace(noise, sway=_sway(joint, at_noise, noise))
    quiet = quiet_slip(joint.problem, joint.at)
    least = max(_LEAST_OF_QUIET * quiet, _LEAST_OF_STOPS * fit.components.slip)
    if fit.options.slip is not None:
        u = np.log(np.array([fit.options.slip]) ** 2 + quiet**2)
    elif near is not None:
        u = np.log(np.unique(near.slip) ** 2 + quiet**2)
    else:
        u = np.linspace(2 * np.log(quiet), np.log(LARGEST_SLIP**2 + quiet**2), _SLIPS)
    jitter = _JITTER_S if near is None else np.unique(near.jitter_s)
    for fine in (True, False):
        slip = np.sqrt(np.maximum(np.exp(u) - quiet**2, least**2))
        S, J = np.meshgrid(slip, jitter, indexing="ij")
        levels = solved(fit, joint, noise, S.ravel(), J.ravel())
        if not np.any(np.isfinite(levels.log_likelihood)):
            raise np.linalg.LinAlgError("rounding hides the likelihood at all levels of noise")
        weight = np.exp(levels.log_likelihood - levels.log_likelihood.max())
        weight /= weight.sum()
        if near is not None:
            break
        if fine:
            u = _closer(u, weight.reshape(S.shape).sum(axis=1), _FINE_SLIPS)
            jitter = np.exp(_closer(np.log(jitter), weight.reshape(S.shape).sum(axis=0), _FINE_JITTERS))
    slip_2, jitter_2 = weight @ levels.slip**2, weight @ levels.jitter_s**2
    return replace(noise, slip=float(np.sqrt(slip_2)), jitter_s=float(np.sqrt(jitter_2))), levels, weight


def _closer(at: Array, weight: Array, count: int) -> Array:
    """Return equally spaced levels over those that are probable, and their neighbours."""
    likely = np.flatnonzero(weight > _IMPROBABLE * weight.max())
    low, high = max(int(likely[0]) - 1, 0), min(int(likely[-1]) + 1, len(at) - 1)
    return np.linspace(at[low], at[high], count) if high > low else at


def _scale(fit: Fit, joint: Joint) -> float:
    """Return how much more the frames' corners err than those at stops, by their covariances."""
    rows = joint.moving_corners
    rows = rows[joint.weights.corners[rows] > 0]
    freedom = max(2 * len(rows) - 3 * len(joint.woven.moving), 1)
    square = float(np.sum(joint.at.residual_px[rows] ** 2)) / freedom
    return max(float(np.sqrt(square)) / fit.components.noise_scale, _LEAST_SCALE)


def _sway(joint: Joint, levels: Levels, noise: FrameNoise) -> float:
    """Return the sway after one step of its fixed point; see :mod:`boxcal.calib.likelihood.variance_components`."""
    one, rows = levels.solution.at(0), joint.woven.moving
    values = joint.state.lean / levels.local_sigma[:, :3] + one.d_local[:, :3]
    left = 1 - one.local_variances(one.joint_covariances())[rows, :3]
    square = float(np.sum(values[rows] ** 2))
    return float(np.clip(noise.sway * np.sqrt((square + 1e-4) / (max(left.sum(), 0) + 1e-4)), _LEAST_SWAY, _MOST_SWAY))


def _corner_weights(fit: Fit, joint: Joint, noise: FrameNoise) -> Weights:
    """Return the weights with frames' corners at their noise, and those left out that it does not explain."""
    rows = joint.moving_corners
    residual = joint.at.residual_px.copy()
    residual[rows] /= noise.scale
    good, _ = flag_corners(joint.problem, residual, fit.components.noise_scale, fit.options.false_alarm)
    corners = joint.weights.corners.copy()
    corners[rows] = good[rows] * noise.scale**-2
    return replace(joint.weights, corners=corners)
