"""Sigmas that do not trust the noise of frames on the move: the answer without one leg's frames, or its wheels.

Stops are too coarse to check frames that carry ten times more information. So the frames of each leg, and the wheels of
each leg, are left out in turn, and the answer is solved again about the same state. Where the noise is as the model has
it, a change has the difference of the two covariances (see :mod:`boxcal.calib.likelihood.moving.agreement`); the ratio
of the squared changes to their expectations, summed over legs, shows by how much the frames disagree among themselves.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from boxcal.calib.geometry.parameters import COUNT, TRANSLATION
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_residuals import with_legs
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.solve import sigmas
from boxcal.calib.likelihood.moving.system import System, system
from boxcal.calib.likelihood.moving.weave import Woven
from boxcal.calib.likelihood.normal_equations import Normal
from boxcal.calib.likelihood.picture_blocks import picture_blocks
from boxcal.calib.likelihood.stop_elimination import Solution, solve_chain
from boxcal.target.arrays import Array, Ids

CHANCE = 1e-3
"""Chance that frames as the model has them enlarge any standard deviation."""
_MOST_PARTS = 30
"""Neighbouring legs are left out together where there are more of them."""
_BATCH = 16
"""Systems that are solved at once: memory grows with it."""
_LEAST_CHANGE = 1e-4
"""Parts that are expected to change a parameter's variance by less than this fraction of it carry no information about
it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeaveOut:
    """Changes of the answer without parts of the moving data, against what noise explains.

    Attributes
    ----------
    names
        Of the n shared unknowns.
    R_body_cam : (3, 3)
        Orientation of the camera: translations are compared along the body's axes.
    ratio : (n,)
        Squared changes over their expectations, summed over all parts.
    limit : (n,)
        Of the ratio, beyond which it is not by chance.
    changes : (C, n)
        Without the frames of each part that has some, then without the wheels of each: translations along the body's
        axes.
    """

    names: tuple[str, ...]
    R_body_cam: Array

    ratio: Array
    limit: Array
    changes: Array

    @property
    def inflation(self) -> Array:
        """Factors on the standard deviations, (n,): 1 where nothing speaks against them."""
        return np.where(self.ratio > self.limit, np.sqrt(self.ratio), 1.0)

    @property
    def said(self) -> str:
        """The parameter, a reported one if any, whose standard deviation is enlarged most, and how many times."""
        inflation = self.inflation
        k = int(np.argmax(inflation[:COUNT] if np.any(inflation[:COUNT] > 1) else inflation))
        return f"{self.names[k]} by {inflation[k]:.1f} times what noise explains"

    def enlarged(self, cov: Array) -> Array:
        """Return a covariance (n, n) of the shared unknowns with its standard deviations enlarged."""
        M = np.eye(len(self.ratio))
        M[TRANSLATION, TRANSLATION] = self.R_body_cam
        F = M.T @ (self.inflation[:, None] * M)
        return np.asarray(F @ cov @ F.T)


def leave_out(fit: Fit, found: Settled) -> LeaveOut:
    """Return how the answer changes without each leg's frames, and without each leg's wheels.

    Parameters
    ----------
    fit
        Solution of the stops.
    found
        Of stops and frames.
    """
    joint, levels = found.joint, found.levels
    level = (levels.slip[[found.best]], levels.jitter_s[[found.best]])
    sigma = sigmas(fit, joint, found.noise)
    whole = system(joint.problem, joint.woven, joint.at, fit.components, joint.weights, sigma, level[0], level[1])
    all_of_it = solve_chain(whole.normal, whole.eliminated)
    R = joint.state.T_body_cam[:3, :3]
    changes, expected = [], []
    for solution in (*_without_frames(fit, found, whole), *_without_wheels(found, whole)):
        changes.append(_reported(solution.d_shared - all_of_it.d_shared, R))
        expected.append(_reported_variances(solution.cov - all_of_it.cov, R))
    variance = _reported_variances(all_of_it.cov, R)[0]
    change = np.concatenate(changes)
    ratio, limit = _compared(change**2, np.concatenate(expected), variance)
    return LeaveOut(names=joint.problem.names, R_body_cam=R, ratio=ratio, limit=limit, changes=change)


def _compared(square: Array, expected: Array, variance: Array) -> tuple[Array, Array]:
    """Return ratios and limits for squared changes and their expectations, (C, n) each, and all parts' variances."""
    counts = expected > _LEAST_CHANGE * variance
    square, expected = np.where(counts, square, 0.0), np.where(counts, expected, 0.0)
    total = expected.sum(axis=0)
    some = total > 0
    total = np.where(some, total, 1.0)
    freedom = np.where(some, total**2 / np.where(some, np.sum(expected**2, axis=0), 1.0), 1.0)
    limit = np.array([float(chdtri(nu, CHANCE / len(variance))) / nu for nu in freedom.tolist()])
    return np.where(some, square.sum(axis=0) / total, 1.0), limit


def _reported(change: Array, R: Array) -> Array:
    """Return changes (K, n) of the shared unknowns, translations along the body's axes."""
    out = change.copy()
    out[:, TRANSLATION] = out[:, TRANSLATION] @ R.T
    return out


def _reported_variances(cov: Array, R: Array) -> Array:
    """Return the variances, (K, n), of covariances (K, n, n), translations along the body's axes."""
    out = np.diagonal(cov, axis1=1, axis2=2).copy()
    place = cov[:, TRANSLATION, TRANSLATION]
    out[:, TRANSLATION] = np.einsum("ij,kjl,il->ki", R, place, R)
    return out


def leg_of_places(woven: Woven) -> Ids:
    """Return the part that each place in the row belongs to, (P,): the legs between stops, or a few of them.

    Without stops, neighbouring frames.
    """
    if len(woven.moving) == len(woven.frame):
        count = len(woven.frame)
        return np.arange(count) * min(_MOST_PARTS, count // 2) // count
    leg = np.cumsum(woven.frame < 0) - 1
    return np.asarray(leg // max(-(-int(leg[-1]) // _MOST_PARTS), 1))


def _without_frames(fit: Fit, found: Settled, whole: System) -> list[Solution]:
    """Return the solutions without the images of the frames of each part."""
    joint, n = found.joint, len(found.joint.problem.names)
    weight = joint.weights.corners / fit.components.noise_scale**2
    values, sigma = np.column_stack([joint.state.lean, joint.state.growth]), whole.local_sigma
    N, a = picture_blocks(joint.at.corners, weight, sigma)
    if joint.at.slipped is not None:
        by = np.concatenate([np.ones((len(sigma), n + 3)), sigma], axis=1)[: len(N)] / fit.components.noise_scale
        N = N - joint.at.slipped.loss[: len(N)] * by[:, :, None] * by[:, None, :]
    unit = np.divide(values, sigma, out=np.zeros_like(values), where=sigma > 0)
    own = n + 3
    gain = N[:, :own, own:] @ np.linalg.inv(N[:, own:, own:] + np.eye(sigma.shape[1]))
    a = a[:, :own] - (gain @ (a[:, own:] - unit)[:, :, None])[:, :, 0]
    N = N[:, :own, :own] - gain @ N[:, own:, :own]
    place, rows = leg_of_places(joint.woven), joint.woven.moving
    groups = [rows[place[rows] == part] for part in np.unique(place[rows])]
    return [
        solve_chain(_less(whole.normal, N, a, groups[k : k + _BATCH]), whole.eliminated)
        for k in range(0, len(groups), _BATCH)
    ]


def _less(normal: Normal, N: Array, a: Array, groups: list[Ids]) -> Normal:
    """Return equations without some images, a batch of one system a group of them."""
    n, K = normal.A.shape[-1], len(groups)
    A, B, D, right, c = (np.repeat(part, K, axis=0) for part in _batch_of_one(normal))
    for k, rows in enumerate(groups):
        A[k] -= N[rows, :n, :n].sum(axis=0)
        right[k] -= a[rows, :n].sum(axis=0)
        B[k, rows, :, :3] -= N[rows, :n, n:]
        D[k, rows, :3, :3] -= N[rows, n:, n:]
        c[k, rows, :3] -= a[rows, n:]
    return Normal(A=A, B=B, D=D, E=np.repeat(normal.E, K, axis=0), a=right, c=c)


def _batch_of_one(normal: Normal) -> tuple[Array, Array, Array, Array, Array]:
    return normal.A, normal.B, normal.D, normal.a, normal.c


def _without_wheels(found: Settled, whole: System) -> list[Solution]:
    """Return the solutions without the wheels of each part."""
    joint = found.joint
    part = leg_of_places(joint.woven)[joint.problem.leg_stop]
    used = np.flatnonzero(np.bincount(part, weights=joint.weights.legs) > 0)
    out = []
    for k in range(0, len(used), _BATCH):
        kept = part != used[k : k + _BATCH, None]
        information = whole.leg_information * kept[:, :, None, None]
        equations = with_legs(joint.problem, whole.without_legs, joint.at.legs, information)
        out.append(solve_chain(equations, whole.eliminated))
    return out
