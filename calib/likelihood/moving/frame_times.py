"""Times of frames on the move, each estimated from the wheels' path alone: no jitter draws the frames together.

What frames are late by besides offset and rate is then a linear model with known covariance, and scatter, a jump of the
clock and frames of another time are compared by their likelihoods.
"""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_residuals import leg_equations
from boxcal.calib.likelihood.moving.clock import LATE, RATE
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.solve import sigmas
from boxcal.calib.likelihood.moving.system import system
from boxcal.calib.likelihood.normal_equations import Normal
from boxcal.calib.likelihood.state import READINGS
from boxcal.calib.likelihood.stop_elimination import solve_chain
from boxcal.target.arrays import Array, Ids

_FREE_S = 1.0
"""Standard deviation beforehand of each frame's own lateness, s: the data determine what it is."""
_HELD = 1e-7
"""Offset (s) and rate (s/s) are held to this: what frames are late by is their own."""
_JITTERS_S = np.concatenate([[1e-5], np.geomspace(3e-5, 0.3, 33)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameTimes:
    """Lateness of each frame besides its clock's offset and rate.

    Attributes
    ----------
    places : (F,)
        Of the frames in the row of stops and frames.
    late_s, cov : (F,), s and (F, F), s^2
        Stamp less time, and its covariance, each frame free to have been taken at any time.
    since_s : (F,), s
        Stamps since the middle of the drive's frames.
    drive : (F,)
        The drive of each.
    """

    places: Ids
    late_s: Array
    cov: Array
    since_s: Array
    drive: Ids

    @property
    def lines(self) -> Array:
        """Lateness by offset and rate of each drive's clock, (F, 2 D)."""
        own = (self.drive[:, None] == np.unique(self.drive)).astype(np.float64)
        return np.concatenate([own, own * self.since_s[:, None]], axis=1)


def frame_times(fit: Fit, found: Settled) -> FrameTimes:
    """Return when the frames were taken, by the linearization that stops and frames were settled at."""
    joint = found.joint
    woven, problem, rows = joint.woven, joint.problem, joint.woven.moving
    level = (found.levels.slip[[found.best]], np.zeros(1))
    s = system(
        problem, woven, joint.at, fit.components, joint.weights, sigmas(fit, joint, found.noise), level[0], level[1]
    )
    legs = leg_equations(problem, joint.at.legs, s.leg_information)
    rates = woven.rates[rows] / (problem.step / np.sqrt(12))
    names = np.array(problem.names)
    held = np.array([name.startswith((LATE, RATE)) for name in names])
    solution = solve_chain(_with_own_times(s.normal, legs, rows, -rates, held), s.eliminated)
    n = len(names)
    return FrameTimes(
        places=rows,
        late_s=solution.d_shared[0, n:],
        cov=solution.cov[0, n:, n:],
        since_s=woven.since_s[rows],
        drive=woven.drive[rows],
    )


def _with_own_times(normal: Normal, legs: Normal, rows: Ids, rates: Array, held: Array) -> Normal:
    """Return equations with each frame's own lateness behind the shared unknowns, in a batch of one.

    Parameters
    ----------
    normal, legs
        All equations, and those of the legs in them.
    rows : (F,)
        Places of the frames.
    rates : (F, 2), 1/s
        How the true readings at a frame change with its lateness, in units of a reading's own error.
    held : (n,)
        Which shared unknowns are held.
    """
    n, P, F = normal.A.shape[-1], normal.D.shape[-3], len(rows)
    v = np.zeros((F, normal.D.shape[-1]))
    v[:, READINGS] = rates
    D, E = legs.D[0], legs.E[0]
    A = np.zeros((1, n + F, n + F))
    A[0, :n, :n] = normal.A[0] + np.diag(held / _HELD**2)
    across = np.einsum("fnk,fk->nf", legs.B[0][rows], v)
    A[0, :n, n:], A[0, n:, :n] = across, across.T
    own = np.arange(n, n + F)
    A[0, own, own] = np.einsum("fi,fij,fj->f", v, D[rows], v) + _FREE_S**-2
    B = np.zeros((1, P, n + F, normal.D.shape[-1]))
    B[0, :, :n] = normal.B[0]
    B[0, rows, own] = np.einsum("fij,fj->fi", D[rows], v)
    for k, (p, f) in enumerate(zip(rows.tolist(), own.tolist(), strict=True)):
        if p + 1 < P:
            B[0, p + 1, f] = v[k] @ E[p]
        if p > 0:
            B[0, p - 1, f] = E[p - 1] @ v[k]
        if k + 1 < F and rows[k + 1] == p + 1:
            A[0, f, f + 1] = A[0, f + 1, f] = v[k] @ E[p] @ v[k + 1]
    right = np.einsum("fk,fk->f", legs.c[0][rows], v)
    return replace(normal, A=A, B=B, a=np.concatenate([normal.a, right[None]], axis=1))


def gains(times: FrameTimes, kept: Array, causes: Array) -> tuple[Array, Array]:
    """Return how much more probable each of some causes (F, M) makes the times, and its size, (M,) each.

    That is twice the difference of the logarithms of the likelihoods, each at its own most probable jitter, shrunk for
    the few frames that determine it (Bartlett 1937); below zero where a cause cannot be recognised.

    Parameters
    ----------
    times
        Of the frames.
    kept : (F, p)
        What is part of the model anyway.
    causes : (F, M)
        What each cause would add to the lateness.
    """
    values, vectors = np.linalg.eigh(times.cov)
    y, X, Z = (vectors.T @ part for part in (times.late_s, kept, causes))
    w = 1 / (np.maximum(values, 0.0) + np.square(_JITTERS_S)[:, None])  # (J, F)
    WX = w[:, :, None] * X
    inverse = np.linalg.pinv(np.einsum("fp,jfq->jpq", X, WX))
    b = np.einsum("jpq,jfq,f->jp", inverse, WX, y)
    left = y - b @ X.T  # (J, F)
    from_x = np.einsum("jpq,jfq,fm->jpm", inverse, WX, Z)
    power = np.einsum("jf,fm->jm", w, Z**2)
    information = power - np.einsum("jfp,fm,jpm->jm", WX, Z, from_x)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.where(information > _LEAST_LEFT * power, np.einsum("jf,fm->jm", w * left, Z) / information, 0.0)
    base = np.sum(np.log(w), axis=1) - np.sum(w * left**2, axis=1)
    more = base[:, None] + size**2 * information
    best = np.argmax(more, axis=0)
    at = np.arange(Z.shape[1])
    freedom = max(len(y) - X.shape[1] - 1, 0) / len(y)
    gain = freedom * (more[best, at] - base.max())
    return np.where(size[best, at] != 0, gain, -np.inf), size[best, at]


_LEAST_LEFT = 1e-6
"""Fraction of a cause that offset, rate and what else is known must leave for it to be recognised."""
