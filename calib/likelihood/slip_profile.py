"""The wheels' slip from the data, with its own uncertainty.

Slip is a variance component, estimated by restricted likelihood: what the parameters and the poses have adapted to the
noise is taken off. A drive of 5 stops leaves only about 6 degrees of freedom for it, so a single value would claim
too much: the restricted likelihood is evaluated over all levels that the data allow, with a prior flat in the logarithm
of the legs' variance (the quantisation's part included; Jeffreys' prior for a variance) and a little weight on very
little slip. What is reported is the mean over them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights, picture_equations
from boxcal.calib.likelihood.normal_equations import (
    Eliminated,
    Normal,
    Solution,
    eliminate,
    eliminate_chain,
    solve_chain,
)
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.residuals import LegResiduals, leg_covariance, leg_equations
from boxcal.target.arrays import Array

LARGEST_SLIP = 0.3
"""Slip beyond this (m/sqrt(m)) is not considered: a wheel that slips by a third of a metre in one."""
SMALLEST_SLIP = 1e-8
"""What counts as no slip at all where the encoder has no step (m/sqrt(m)); exact data end here."""
LITTLE_SLIP = 2.5e-4
"""What a careful drive on a hard floor slips (m/sqrt(m)); counts where a coarse encoder cannot tell."""
_SPREAD = np.linspace(-1.0, 1.0, 5)
_SPREAD_WEIGHT = np.exp(-2 * _SPREAD**2) / np.sum(np.exp(-2 * _SPREAD**2))
"""Little slip is only known to a factor of 1.65: logarithms of slip about its middle, and their probabilities."""
_FINE = 1e-4
"""Where the quantisation equals less slip than this (m/sqrt(m)), little slip is taken as a small share of that."""
_NO_SLIP = 3.0
"""Prior weight of little slip, in units of one in the logarithm of the variance.

A compromise from simulations with 5 stops: less makes the sigmas of wheels that never slip too large (by 5 % at 1),
more makes those of a slip too small to be told from the cameras' noise (0.1 mm/sqrt(m)) too small in rare runs.
"""
_NONE = 0.02
"""A given slip of nought is taken as this share of what equals the quantisation, so that nothing is exact."""
_POINTS = 13
_ZOOMS = 4
_DENSE = 1.1
"""Levels are close enough at a distance of this many standard deviations: a sum over them is an integral to 1e-7."""
_IMPROBABLE = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SlipProfile:
    """The restricted likelihood over levels of slip.

    Attributes
    ----------
    slip : (K,), m/sqrt(m)
        Levels, ascending.
    log_weight : (K,)
        Logarithm of their probability.
    log_evidence
        Logarithm of the restricted likelihood's mean over the levels, up to a constant of the data and the noise
        scale: compares solutions of the same data.
    solution
        Solutions of the normal equations at those levels, about the same state.
    """

    slip: Array
    log_weight: Array
    log_evidence: float
    solution: Solution

    @property
    def weight(self) -> Array:
        """Probability of each level, (K,); sums to 1."""
        return np.asarray(np.exp(self.log_weight))

    @property
    def best(self) -> int:
        """The most probable level's number."""
        return int(np.argmax(self.log_weight))

    @property
    def mean(self) -> float:
        """Mean level, m/sqrt(m)."""
        return float(self.weight @ self.slip)

    @property
    def typical(self) -> float:
        """Root of the mean variance, m/sqrt(m)."""
        return float(np.sqrt(self.weight @ self.slip**2))

    @property
    def sigma(self) -> float:
        """Standard deviation of the level, m/sqrt(m)."""
        return float(np.sqrt(self.weight @ (self.slip - self.mean) ** 2))

    def averaged(self) -> tuple[Array, Array, Array, Array]:
        """Return the steps of shared (n,), chain (P, 5) and local unknowns (P, q), and the covariance (n, n).

        They are means over the levels; the covariance holds what the solutions at different levels differ by.
        """
        w, s = self.weight, self.solution
        d_shared = w @ s.d_shared
        off = s.d_shared - d_shared
        cov = np.tensordot(w, s.cov, 1) + np.einsum("k,ki,kj->ij", w, off, off)
        d_stops = np.tensordot(w, s.d_stops, 1)
        return d_shared, d_stops, s.local_step(d_shared, d_stops), cov


def quiet_slip(problem: Problem, at: Linearization) -> float:
    """Return the slip that disturbs a leg as much as the quantisation of the readings at its ends does, m/sqrt(m)."""
    rolled = at.legs.model.rolled
    if not rolled.size or not np.any(rolled > 0):
        return 10 * SMALLEST_SLIP
    distance = float(np.median(rolled[rolled > 0]))
    step = problem.step * float(np.mean(np.abs(at.state.wheels[:2])))
    return max(float(np.sqrt(step**2 / 6 / distance)), 10 * SMALLEST_SLIP)


def least_slip(problem: Problem, at: Linearization) -> Array:
    """Return what stands for little slip, ascending, m/sqrt(m): where the encoders are fine it changes nothing."""
    quiet = quiet_slip(problem, at)
    middle = max(min(quiet**2 / (quiet + _FINE), LITTLE_SLIP), SMALLEST_SLIP)
    return np.asarray(middle * np.exp(_SPREAD))


def slip_profile(
    problem: Problem,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    near: SlipProfile | None = None,
) -> SlipProfile:
    """Return the restricted likelihood over the slip that the data allow.

    Starts with all levels, or with those that were probable nearby, and closes in on those that are probable.

    Parameters
    ----------
    problem, at, components, weights
        The likelihood about a state.
    near
        The profile about a state nearby with the same legs.

    Raises
    ------
    LinAlgError
        If the likelihood is no number at any level: the data are senseless.
    """
    quiet, little = quiet_slip(problem, at), least_slip(problem, at)
    low, high = 2 * np.log(quiet), np.log(LARGEST_SLIP**2 + quiet**2)
    every = np.linspace(low, high, _POINTS + 4)
    system = _system(problem, at, components, weights)
    if near is not None and len(near.slip) > len(little):
        levels = near.slip[len(little) :]
        u = np.log(levels[[0, -1]] ** 2 + quiet**2)
        found = _profile_over(system, np.linspace(max(u[0], low), min(u[1], high), _POINTS), quiet, little)
        if found.holds_all(low, high):
            return found.profile
    found = _profile_over(system, every, quiet, little)
    for _ in range(_ZOOMS):
        if found.step < _DENSE * found.spread:
            break
        found = _profile_over(system, found.closer(low, high), quiet, little)
    return found.profile


class _Scan(NamedTuple):
    """The profile at equally spaced logarithms u of the legs' variance, and the probabilities of these."""

    profile: SlipProfile
    u: Array
    probable: Array

    @property
    def step(self) -> float:
        return float(self.u[1] - self.u[0])

    @property
    def spread(self) -> float:
        return float(np.sqrt(self.probable @ (self.u - self.probable @ self.u) ** 2))

    def closer(self, low: float, high: float) -> Array:
        """Return levels over what is probable."""
        likely = np.flatnonzero(self.probable > _IMPROBABLE * self.probable.max())
        return np.linspace(max(low, self.u[likely[0]] - self.step), min(high, self.u[likely[-1]] + self.step), _POINTS)

    def holds_all(self, low: float, high: float) -> bool:
        """Tell whether nothing probable lies beyond the levels, which are close enough."""
        least = _IMPROBABLE * self.probable.max()
        below = self.u[0] <= low or self.probable[0] < least
        above = self.u[-1] >= high or self.probable[-1] < least
        return bool(below and above and self.step < _DENSE * self.spread)


def _profile_over(system: "_System", u: Array, quiet: float, little: Array) -> _Scan:
    slip = np.append(little, np.sqrt(np.maximum(np.exp(u) - quiet**2, little[0] ** 2)))
    prior = np.append(_NO_SLIP / (u[1] - u[0]) * _SPREAD_WEIGHT, np.ones(len(u)))
    profile = _profile(system, slip, prior)
    slipping = np.exp(profile.log_weight[len(little) :] - profile.log_weight[len(little) :].max())
    return _Scan(profile=profile, u=u, probable=slipping / slipping.sum())


def fixed_profile(problem: Problem, at: Linearization, components: VarianceComponents, weights: Weights) -> SlipProfile:
    """Return a profile of one given slip."""
    slip = max(components.slip, _NONE * quiet_slip(problem, at), SMALLEST_SLIP)
    return _profile(_system(problem, at, components, weights), np.array([slip]), np.ones(1))


def shared_equations(
    problem: Problem, at: Linearization, components: VarianceComponents, slip: Array, weights: Weights
) -> tuple[Array, Array]:
    """Return information (K, n, n) and right-hand side (K, n) of the shared unknowns at levels of slip (K,), m/sqrt(m).

    All other unknowns are eliminated.
    """
    system = _system(problem, at, components, weights)
    normal, _, _ = _with_legs(system, slip)
    reduced = eliminate_chain(normal)
    return reduced.information, reduced.right


class _System(NamedTuple):
    """Parts of the normal equations that do not depend on slip."""

    problem: Problem
    legs: LegResiduals
    weight: Array
    pictures: Normal
    eliminated: Eliminated
    squares: float


def _system(problem: Problem, at: Linearization, components: VarianceComponents, weights: Weights) -> _System:
    pictures, squares = picture_equations(problem, at, components)
    return _System(problem, at.legs, weights.legs, *eliminate(pictures), squares)


def _with_legs(system: _System, slip: Array) -> tuple[Normal, Array, Array]:
    """Return the equations, the legs' sums of squares (K,) and covariances (K, N, 3, 3) at levels of slip (K,)."""
    cov = leg_covariance(system.problem, system.legs.model, slip)
    information = np.linalg.inv(cov) * system.weight[:, None, None]
    legs, leg_squares = leg_equations(system.problem, system.legs, information)
    return system.pictures.plus(legs), leg_squares, cov


def _profile(system: _System, slip: Array, prior: Array) -> SlipProfile:
    normal, leg_squares, cov = _with_legs(system, slip)
    solution = solve_chain(normal, system.eliminated)
    log_noise = np.sum(np.linalg.slogdet(cov)[1] * (system.weight > 0), axis=-1)
    log_weight = np.log(prior) - 0.5 * (log_noise + solution.log_det + leg_squares + system.squares - solution.decrease)
    largest = float(log_weight.max())
    if not np.isfinite(largest):
        raise np.linalg.LinAlgError("no slip explains the legs")
    log_evidence = largest + float(np.log(np.sum(np.exp(log_weight - largest))))
    return SlipProfile(
        slip=slip,
        log_weight=log_weight - log_evidence,
        log_evidence=log_evidence - float(np.log(prior.sum())),
        solution=solution,
    )
