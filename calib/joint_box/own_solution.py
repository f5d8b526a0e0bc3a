"""Solution of one robot under a given shape of the box, small enough to be sent, and its block there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.joint_box.block import Block, without
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.levenberg_marquardt import (
    Linearization,
    Weights,
    equations,
    leg_information,
    linearize,
    moved,
)
from boxcal.calib.likelihood.normal_equations import Normal, eliminate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.stop_elimination import eliminate_chain, solve
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target

SETTLED = 1e-6
"""Promised decrease of a robot's sum of squares at which its own unknowns have followed the shape."""
_MOST_STEPS = 20
_HALVINGS = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnSolution:
    """Solution of one robot without its data: what :func:`settled` starts from.

    Attributes
    ----------
    options
        Unknowns and explanations; without the target, which all robots share.
    step : rad
        Encoder step.
    kept
        Stops used, for each drive.
    floor_px : px
        Floor of the corners' errors.
    state
        Values of all unknowns.
    components
        Variance components.
    rejected : (R,)
        Corners left out.
    legs : (N,)
        Weights of the legs.
    leg_information : (N, 3, 3)
        Of the legs, weights in it; held while the shape is sought.
    """

    options: EstimateOptions
    step: float
    kept: tuple[tuple[int, ...], ...]
    floor_px: float
    state: State
    components: VarianceComponents
    rejected: Ids
    legs: Array
    leg_information: Array

    def problem(self, drives: Sequence[Correspondences], target: Target) -> Problem:
        """Return the data and the unknowns again, for the drives that it was found from."""
        problem = build_problem(drives, self.kept, replace(self.options, target=target), self.step)
        return with_floor(problem, self.floor_px)

    def weights(self, problem: Problem) -> Weights:
        """Return the weights of corners and legs."""
        corners = np.ones(len(problem.uv_px))
        corners[self.rejected] = 0.0
        return Weights(corners=corners, legs=self.legs)


def own_solution(fit: Fit) -> OwnSolution:
    """Return what is kept of a robot's fit."""
    problem = fit.problem
    kept = tuple(tuple(problem.stop[problem.drive == d].tolist()) for d in range(problem.drives))
    return OwnSolution(
        options=replace(fit.options, target=None, lens=problem.lens),
        step=problem.step,
        kept=kept,
        floor_px=problem.floor_px,
        state=fit.state,
        components=fit.components,
        rejected=np.flatnonzero(fit.weights.corners == 0),
        legs=fit.weights.legs,
        leg_information=leg_information(problem, fit.at.legs, fit.weights, np.array(fit.components.slip)),
    )


def shape_of(problem: Problem, state: State, names: Sequence[str]) -> Array:
    """Return the values of the shape's unknowns in a state, (m,)."""
    return np.array([problem.target.value(state.shape, name) for name in names])


def settled(
    problem: Problem, own: OwnSolution, names: Sequence[str], shape: Array | None = None, tolerance: float = SETTLED
) -> tuple[OwnSolution, Block]:
    """Return a robot's solution under a shape, and its information on that shape.

    Parameters
    ----------
    problem
        Its data (:meth:`OwnSolution.problem`).
    own
        Its solution under another shape near by.
    names : m
        The shape's unknowns.
    shape : (m,)
        Their values, held; those of the solution if not given.
    tolerance
        Promised decrease of the sum of squares at which its own unknowns stay.

    Raises
    ------
    CalibError
        If its equations have no solution there.
    """
    free, weights, columns = _without_prior(problem, names), own.weights(problem), _columns(problem, names)
    rest = np.setdiff1d(np.arange(len(problem.names)), columns)
    about = shape_of(problem, own.state, names) if shape is None else shape
    at = linearize(free, _shaped(problem, own.state, names, about), weights)
    normal, cost = equations(free, at, own.components, own.leg_information)
    left = np.inf
    for _ in range(_MOST_STEPS):
        step = solve(_only(normal, rest))
        left = float(step.decrease)
        if not np.isfinite(left):
            raise CalibError("its equations have no solution at the shape of the box that the others found")
        if not left > tolerance:
            break
        d_shared = np.zeros(len(problem.names))
        d_shared[rest] = step.d_shared
        trial = _lower(free, at, own, weights, (d_shared, step.d_stops, step.d_local), float(cost))
        if trial is None:
            break  # rounding hides what is left
        at = trial
        normal, cost = equations(free, at, own.components, own.leg_information)
    shared = eliminate_chain(eliminate(normal)[0])
    information, score = without(shared.information, shared.right, columns)
    return replace(own, state=at.state), Block(about=about, information=information, score=score, left=left)


def _lower(  # noqa: PLR0917 - a state and what moves it
    problem: Problem,
    at: Linearization,
    own: OwnSolution,
    weights: Weights,
    step: tuple[Array, Array, Array],
    cost: float,
) -> Linearization | None:
    """Return the likelihood after a step, shortened until the sum of squares falls; None if it does not."""
    for k in range(_HALVINGS):
        part = (step[0] * 0.5**k, step[1] * 0.5**k, step[2] * 0.5**k)
        trial = linearize(problem, moved(problem, at.state, own.components, part), weights)
        if trial.valid and float(equations(problem, trial, own.components, own.leg_information)[1]) <= cost:
            return trial
    return None


def _columns(problem: Problem, names: Sequence[str]) -> list[int]:
    return [problem.names.index(name) for name in names]


def _shaped(problem: Problem, state: State, names: Sequence[str], shape: Array) -> State:
    values = state.shape.copy()
    values[[problem.target.names.index(name) for name in names]] = shape
    return replace(state, shape=values)


def _without_prior(problem: Problem, names: Sequence[str]) -> Problem:
    """Return the problem without what is known of the shape before: that counts once, not once a robot."""
    columns = _columns(problem, names)
    prior, information = problem.prior.copy(), problem.information.copy()
    prior[columns] = np.inf
    information[columns, :] = information[:, columns] = 0.0
    component = tuple("" if k in set(columns) else name for k, name in enumerate(problem.component))
    return replace(problem, prior=prior, component=component, information=information)


def _only(normal: Normal, rows: Ids) -> Normal:
    """Return the equations of some of the shared unknowns, the others held."""
    local = normal.local
    return replace(
        normal,
        A=normal.A[np.ix_(rows, rows)],
        B=normal.B[:, rows],
        a=normal.a[rows],
        local=None if local is None else replace(local, by_shared=local.by_shared[:, rows]),
    )
