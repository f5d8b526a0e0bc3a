"""The wheels' slip from the data, with its own uncertainty.

Slip is a variance component, estimated by restricted likelihood: what the parameters and the poses have adapted to the
noise is taken off. A drive of 5 stops leaves only about 6 degrees of freedom for it, so a single value would claim
too much: the restricted likelihood is evaluated over all levels that the data allow, with a prior flat in the logarithm
of the legs' variance (the quantisation's part included; Jeffreys' prior for a variance) and a little weight on very
little slip. What is reported is the mean over them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.information_inverse import determinant
from boxcal.calib.likelihood.leg_residuals import LegResiduals, leg_covariance, leg_squares, with_legs
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights, reduced_picture_equations
from boxcal.calib.likelihood.normal_equations import Eliminated, Normal
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.stop_elimination import (
    Bordered,
    EliminatedChain,
    Solution,
    eliminate_chain,
    solve_chain,
    solve_shared,
)
from boxcal.target.arrays import Array

LARGEST_SLIP = 0.3
"""Slip beyond this (m/sqrt(m)) is not considered: a wheel that slips by a third of a metre in one."""
SMALLEST_SLIP = 1e-8
"""What counts as no slip at all where the encoder has no step (m/sqrt(m)); exact data end here."""
LITTLE_SLIP = 2.5e-4
"""What a careful drive on a hard floor slips (m/sqrt(m)); counts where a coarse encoder cannot measure it."""
_SPREAD = np.linspace(-1.0, 1.0, 5)
_SPREAD_WEIGHT = np.exp(-2 * _SPREAD**2) / np.sum(np.exp(-2 * _SPREAD**2))
"""Little slip is only known to a factor of 1.65: logarithms of slip about its middle, and their probabilities."""
_FINE = 1e-4
"""Where the quantisation equals less slip than this (m/sqrt(m)), little slip is taken as a small fraction of that."""
_NO_SLIP = 3.0
"""Prior weight of little slip, in units of one in the logarithm of the variance.

A compromise from simulations with 5 stops: less makes the sigmas of wheels that never slip too large (by 5 % at 1),
more makes those of a slip too small to be told from the cameras' noise (0.1 mm/sqrt(m)) too small in rare runs.
"""
_NONE = 0.02
"""A given slip of nought is taken as this fraction of what equals the quantisation, so that nothing is exact."""
_POINTS = 13
_ZOOMS = 4
_ABOUT = 3.0
"""How far from the components' level it is looked first, in the logarithm of the variance."""
_DENSE = 1.1
"""Levels are close enough at a distance of this many standard deviations: a sum over them is an integral to 1e-7."""
_IMPROBABLE = 1e-5
_NEGLIGIBLE = 1e-7
"""Levels of less probability than this are left out of the profile, but those of little slip.

Together they change no sigma by a part in a million. Without a leg, or with an explanation, little slip may become
probable: tests ask for it.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SlipProfile:
    """The restricted likelihood over levels of slip.

    Attributes
    ----------
    slip : (K,), m/sqrt(m)
        Levels, ascending: those of little slip, then those that are probable at all.
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

    Starts with levels that were probable nearby, or else about the components' level, or else with all, and closes in
    on those that are probable: levels beyond which others may be probable are not taken.

    Parameters
    ----------
    problem, at, components, weights
        The likelihood about a state.
    near
        The profile about a state nearby.

    Raises
    ------
    LinAlgError
        If the likelihood is no number at any level: the data are senseless.
    """
    quiet, little = quiet_slip(problem, at), least_slip(problem, at)
    low, high = 2 * np.log(quiet), np.log(LARGEST_SLIP**2 + quiet**2)
    system = _system(problem, at, components, weights)

    def over(u: Array) -> _Scan:
        return _scan(system, u, quiet, little)

    middle = np.log(components.slip**2 + quiet**2)
    ranges = [(middle - _ABOUT, middle + _ABOUT)]
    if near is not None and len(near.slip) > len(little) + 1:
        u = np.log(near.slip[len(little) :] ** 2 + quiet**2)
        ranges.insert(0, (2 * u[0] - u[1], 2 * u[-1] - u[-2]))
    for ends in ranges:
        first, last = np.clip(ends, low, high).tolist()
        if first < last:
            found = _closed_in(over, over(np.linspace(first, last, _POINTS)), low, high)
            if found.holds_all(low, high):
                return _of_probable(system, found)
    return _of_probable(system, _closed_in(over, over(np.linspace(low, high, _POINTS + 4)), low, high))


class _Scan(NamedTuple):
    """The restricted likelihood over levels of slip: first little slip, then equally spaced in log variance.

    Attributes
    ----------
    slip, prior, log_weight : (K,)
        Levels, their prior weights, and the logarithm of their probability, not normalised.
    u : (K - little,)
        Logarithms of the legs' variance at all but the first levels.
    chain
        The equations at the levels, the stops eliminated.
    """

    slip: Array
    prior: Array
    log_weight: Array
    u: Array
    chain: EliminatedChain

    @property
    def probable(self) -> Array:
        """Probabilities of the levels but those of little slip."""
        slipping = self.log_weight[-len(self.u) :]
        weight = np.exp(slipping - slipping.max())
        return np.asarray(weight / weight.sum())

    @property
    def step(self) -> float:
        return float(self.u[1] - self.u[0])

    @property
    def spread(self) -> float:
        probable = self.probable
        return float(np.sqrt(probable @ (self.u - probable @ self.u) ** 2))

    def closer(self, low: float, high: float) -> Array:
        """Return levels over what is probable."""
        probable = self.probable
        likely = np.flatnonzero(probable > _IMPROBABLE * probable.max())
        return np.linspace(max(low, self.u[likely[0]] - self.step), min(high, self.u[likely[-1]] + self.step), _POINTS)

    def holds_all(self, low: float, high: float) -> bool:
        """Return whether nothing probable lies beyond the levels, which are close enough."""
        probable = self.probable
        least = _IMPROBABLE * probable.max()
        below = self.u[0] <= low or probable[0] < least
        above = self.u[-1] >= high or probable[-1] < least
        return bool(below and above and self.step < _DENSE * self.spread)


def _closed_in(over: "Callable[[Array], _Scan]", found: "_Scan", low: float, high: float) -> "_Scan":
    """Return a scan of levels as close as they must be, over what is probable of another."""
    for _ in range(_ZOOMS):
        if found.step < _DENSE * found.spread:
            break
        found = over(found.closer(low, high))
    return found


def _scan(system: "_System", u: Array, quiet: float, little: Array) -> _Scan:
    """Return the probabilities of levels; no solutions, which cost several times as much."""
    slip = np.append(little, np.sqrt(np.maximum(np.exp(u) - quiet**2, little[0] ** 2)))
    prior = np.append(_NO_SLIP / (u[1] - u[0]) * _SPREAD_WEIGHT, np.ones(len(u)))
    normal, loss = _with_legs(system, slip)
    chain = eliminate_chain(normal)
    log_det, decrease = determinant(chain.information, chain.right)
    eliminated = system.eliminated
    loss += log_det + chain.log_det + eliminated.log_det - decrease - chain.decrease - eliminated.decrease
    log_weight = np.log(prior) - 0.5 * loss
    if not np.isfinite(log_weight.max()):
        raise np.linalg.LinAlgError("no slip explains the legs")
    return _Scan(slip, prior, log_weight, u, chain)


def _of_probable(system: "_System", scan: _Scan) -> SlipProfile:
    """Return the profile, with solutions, of those levels of a scan that are probable at all."""
    largest = float(scan.log_weight.max())
    total = largest + float(np.log(np.sum(np.exp(scan.log_weight - largest))))
    kept = scan.log_weight - total > np.log(_NEGLIGIBLE)
    kept[: -len(scan.u)] = True
    return SlipProfile(
        slip=scan.slip[kept],
        log_weight=scan.log_weight[kept] - total,
        log_evidence=total - float(np.log(scan.prior.sum())),
        solution=solve_shared(scan.chain.some(kept), system.eliminated),
    )


def fixed_profile(problem: Problem, at: Linearization, components: VarianceComponents, weights: Weights) -> SlipProfile:
    """Return a profile of one given slip."""
    slip = max(components.slip, _NONE * quiet_slip(problem, at), SMALLEST_SLIP)
    system = _system(problem, at, components, weights)
    normal, loss = _with_legs(system, np.array([slip]))
    solution = solve_chain(normal, system.eliminated)
    log_evidence = -0.5 * float(loss[0] + solution.log_det[0] - solution.decrease[0])
    if not np.isfinite(log_evidence):
        raise np.linalg.LinAlgError("no slip explains the legs")
    return SlipProfile(slip=np.array([slip]), log_weight=np.zeros(1), log_evidence=log_evidence, solution=solution)


class _System(NamedTuple):
    """Parts of the normal equations that do not depend on slip."""

    problem: Problem
    legs: LegResiduals
    weight: Array
    pictures: Normal
    eliminated: Eliminated
    squares: float


def _system(problem: Problem, at: Linearization, components: VarianceComponents, weights: Weights) -> _System:
    return _System(problem, at.legs, weights.legs, *reduced_picture_equations(problem, at, components))


def _with_legs(system: _System, slip: Array) -> tuple[Bordered, Array]:
    """Return the equations at levels of slip (K,), and the legs' log determinants of noise plus all squares (K,)."""
    cov = leg_covariance(system.problem, system.legs.model, slip)
    inverse, log_det = backend().inverses(cov)
    information = inverse * system.weight[:, None, None]
    squares = leg_squares(system.legs, information)
    log_noise = np.sum(log_det * (system.weight > 0), axis=-1)
    equations = with_legs(system.problem, system.pictures, system.legs, information)
    return equations, log_noise + squares + system.squares
