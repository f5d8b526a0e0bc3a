"""Priors of the shared unknowns and of encoder errors, added to normal equations."""

import numpy as np

from boxcal.calib.likelihood.normal_equations import Normal
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import READINGS, State
from boxcal.target.arrays import Array


def shared_values(problem: Problem, state: State) -> Array:
    """Return the values of the shared unknowns that have priors, (n,); 0 for the others."""
    value = np.zeros(len(problem.names))
    value[problem.tilts] = state.tilt.ravel() if problem.tilt_count else 0.0
    value[problem.shapes] = state.shape
    value[problem.growth] = state.common_growth
    value[problem.explained] = state.explained
    return value


def add_priors(problem: Problem, state: State, sigma: Array, normal: Normal) -> float:
    """Add the priors of shared unknowns and encoder errors to normal equations, in place; return their sum of squares.

    Parameters
    ----------
    problem, state
        Unknowns and their values.
    sigma : (n,)
        Standard deviations of the shared unknowns' priors.
    normal
        The equations.
    """
    value = shared_values(problem, state)
    weight = problem.information + np.diag(1 / np.square(sigma))
    pull = weight @ value
    normal.A[...] += weight
    normal.a[...] -= pull
    normal.D[:, 3, 3] += 1.0
    normal.D[:, 4, 4] += 1.0
    normal.c[:, READINGS] -= state.encoder_errors
    return float(value @ pull + np.sum(state.encoder_errors**2))
