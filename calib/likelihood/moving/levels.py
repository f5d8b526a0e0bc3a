"""Noise levels of frames on the move, by restricted maximum likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.levenberg_marquardt import Linearization
from boxcal.calib.likelihood.moving.grid import Axis, Probable, over_levels
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import ROUGH, Joint, maximised, scan, solved, stepped
from boxcal.calib.likelihood.moving.system import Levels
from boxcal.calib.likelihood.outliers import flag_corners
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.slip_profile import LARGEST_SLIP, SlipProfile, quiet_slip
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_QUIET_JITTER_S, _MOST_JITTER_S, _JITTERS, _FINE_JITTERS = 1e-4, 3e-2, 7, 5
"""Errors in time far below the first are alike; the second is the largest that is looked for."""
_LEAST_JITTER_S = 1e-6
_SLIPS, _FINE_SLIPS = 11, 7
_LEAST_OF_QUIET = 0.05
"""Slip is taken as at least this fraction of what equals the quantisation."""
_LEAST_OF_STOPS = 0.05
"""And as this fraction of what stops show: frames are near to each other, and less would hide them in rounding."""
_OF_STOPS = 1e-4
"""Levels of slip less probable than this fraction of the most probable, by the stops, are not looked at first."""
_AT_REST = 0.1
"""Squared change of the shared unknowns, in their standard deviations, from which on the solver did not get there."""
_LIKELY = 0.01
"""Levels less probable than this fraction of the most probable are left out of that check."""
_LEAST_SWAY, _MOST_SWAY = 0.03, 100.0
_LEAST_SCALE = 1.0
"""An image of a moving camera is never taken to be sharper than its covariances say."""
_ROUNDS = 2
_ALIKE = 0.05
_SWAYS = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Settled:
    """Stops and frames at their maximum with the noise that they show.

    Attributes
    ----------
    joint
        At the maximum for the most probable noise.
    noise
        That noise.
    probable
        Levels of slip and jitter that are probable, and solutions about it at those.
    """

    joint: Joint
    noise: FrameNoise
    probable: Probable

    @property
    def levels(self) -> Levels:
        """Solutions at probable levels."""
        return self.probable.levels

    @property
    def weight(self) -> Array:
        """Probabilities of the levels, (K,)."""
        return self.probable.weight

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


def settled(fit: Fit, drives: Sequence[Correspondences], joint: Joint, noise: FrameNoise) -> Settled | None:
    """Return stops and frames at their maximum, with noise levels estimated from the data; None if the solver fails.

    Parameters
    ----------
    fit, drives
        Solution of the stops, and their drives.
    joint, noise
        Where to begin.
    """
    reached = maximised(fit, drives, joint, noise, ROUGH)
    if reached is None:
        return None
    joint, noise = _steadied(fit, reached, noise)
    noise, found = _updated(fit, joint, noise, None)
    for _ in range(_ROUNDS):
        before = noise
        joint = stepped(_renoised(fit, joint, noise), found.levels, found.weight)
        noise = _steadier(fit, joint, replace(noise, scale=_scale(fit, joint)))[0]
        noise, found = _updated(fit, joint, noise, found)
        if _near(before, noise):
            break
    joint = stepped(joint, found.levels, found.weight)
    if not (joint.at.valid and _left(fit, joint, noise, found) < _AT_REST):
        return None
    return Settled(joint=joint, noise=noise, probable=found)


def _steadied(fit: Fit, joint: Joint, noise: FrameNoise) -> tuple[Joint, FrameNoise]:
    """Return stops and frames, and their noise, with the sway and the scale that the frames show."""
    noise = replace(noise, scale=_scale(fit, joint))
    for _ in range(_SWAYS):
        before = noise.sway
        noise, at_noise = _steadier(fit, joint, noise)
        if abs(np.log(noise.sway / before)) < _ALIKE:
            break
    return stepped(joint, at_noise, np.ones(1)), noise


def _steadier(fit: Fit, joint: Joint, noise: FrameNoise) -> tuple[FrameNoise, Levels]:
    """Return the noise with the sway after one step of its fixed point, and the solution before that step."""
    at_noise = solved(fit, joint, noise, np.array([noise.slip]), np.array([noise.jitter_s]))
    return replace(noise, sway=_sway(joint, at_noise, noise)), at_noise


def _near(before: FrameNoise, after: FrameNoise) -> bool:
    pairs = ((before.slip, after.slip), (before.scale, after.scale), (before.jitter_s + 1e-5, after.jitter_s + 1e-5))
    return all(abs(np.log(b / a)) < _ALIKE for a, b in pairs)


def _updated(fit: Fit, joint: Joint, noise: FrameNoise, near: Probable | None) -> tuple[FrameNoise, Probable]:
    """Return the noise with slip and jitter about a state, and the levels of these that are probable.

    ``near`` is what was probable nearby; without it all levels are looked at.
    """
    slips = slip_axis(joint.problem, joint.at, fit.profile, fit.options.slip)
    found = over_levels(partial(scan, fit, joint, noise), slips, jitter_axis(), near)
    slip_2, jitter_2 = found.weight @ found.levels.slip**2, found.weight @ found.levels.jitter_s**2
    return replace(noise, slip=float(np.sqrt(slip_2)), jitter_s=float(np.sqrt(jitter_2))), found


def slip_axis(problem: Problem, at: Linearization, of_stops: SlipProfile, given: float | None) -> Axis:
    """Return the levels of slip that are looked at: all, or the one that was given; ``of_stops`` is what stops show."""
    quiet = quiet_slip(problem, at)
    least = max(_LEAST_OF_QUIET * quiet, _LEAST_OF_STOPS * of_stops.typical)
    if given is not None:
        return Axis(quiet=quiet, least=least, coarse=np.array([max(given, least)]), fine=_FINE_SLIPS)
    u = np.linspace(2 * np.log(quiet), np.log(LARGEST_SLIP**2 + quiet**2), _SLIPS)
    coarse = np.sqrt(np.maximum(np.exp(u) - quiet**2, least**2))
    probable = of_stops.slip[of_stops.weight > _OF_STOPS * of_stops.weight.max()]
    return Axis(quiet=quiet, least=least, coarse=coarse, fine=_FINE_SLIPS, first=(probable[0], probable[-1]))


def jitter_axis() -> Axis:
    """Return the levels of jitter that are looked at."""
    quiet = _QUIET_JITTER_S
    u = np.linspace(2 * np.log(quiet), np.log(_MOST_JITTER_S**2 + quiet**2), _JITTERS)
    coarse = np.sqrt(np.maximum(np.exp(u) - quiet**2, _LEAST_JITTER_S**2))
    return Axis(quiet=quiet, least=_LEAST_JITTER_S, coarse=coarse, fine=_FINE_JITTERS)


def _left(fit: Fit, joint: Joint, noise: FrameNoise, found: Probable) -> float:
    """Return how far the shared unknowns would still go, a squared distance in their standard deviations."""
    levels, weight = found.levels, found.weight
    likely = weight > _LIKELY * weight.max()
    again = solved(fit, joint, noise, levels.slip[likely], levels.jitter_s[likely])
    step = (weight[likely] / weight[likely].sum()) @ again.solution.d_shared
    information = again.solution.information[int(np.argmax(weight[likely]))]
    return float(step @ information @ step)


def _scale(fit: Fit, joint: Joint) -> float:
    """Return how much more the frames' corners err than those at stops, by their covariances."""
    rows = joint.moving_corners
    rows = rows[joint.weights.corners[rows] > 0]
    freedom = max(2 * len(rows) - 3 * len(joint.woven.moving) - joint.at.taken_by_slip, 1)
    square = float(np.sum(joint.at.residual_px[rows] ** 2)) / freedom
    return max(float(np.sqrt(square)) / fit.components.noise_scale, _LEAST_SCALE)


def _sway(joint: Joint, levels: Levels, noise: FrameNoise) -> float:
    """Return the sway after one step of its fixed point; see :mod:`boxcal.calib.likelihood.variance_components`."""
    one, rows = levels.solution.at(0), joint.woven.moving
    values = joint.state.lean / levels.local_sigma[:, :3] + one.d_local[:, :3]
    left = 1 - one.local_variances(one.joint_covariances())[rows, :3]
    square = float(np.sum(values[rows] ** 2))
    return float(np.clip(noise.sway * np.sqrt((square + 1e-4) / (max(left.sum(), 0) + 1e-4)), _LEAST_SWAY, _MOST_SWAY))


def _renoised(fit: Fit, joint: Joint, noise: FrameNoise) -> Joint:
    """Return stops and frames that other noise holds for from the next step on, corners left out that exceed it."""
    rows = joint.moving_corners
    residual = joint.at.residual_px.copy()
    residual[rows] /= noise.scale
    good, _ = flag_corners(joint.problem, residual, fit.components.noise_scale, fit.options.false_alarm)
    corners = joint.weights.corners.copy()
    corners[rows] = good[rows] * noise.scale**-2
    within = noise.slip / fit.components.noise_scale
    return replace(joint, weights=replace(joint.weights, corners=corners), within=within)
