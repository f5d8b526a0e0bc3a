"""Errors of corners that are alike in all pictures: what they add to the covariance (consider covariance).

Noise averages over thousands of corners; what blur, shading and the camera's response do to all of them alike does not.
No data tell these errors from the camera model, so they are considered, not estimated (Schmidt 1966): smooth fields
over the image, each a small share of a corner's noise, and what each would do to the answer.
"""

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_sums import by_stop, groups_of
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.normal_equations import Solution
from boxcal.calib.likelihood.problem import Problem
from boxcal.target.arrays import Array

_ALONG_U = ((1, 0), (3, 0), (1, 2))
_ALONG_V = ((0, 1), (0, 3), (2, 1))
"""Powers of the two image coordinates in the fields along u and v: larger or smaller on both sides of the middle, as
blur and growth make them. Shifts to one side are not of that kind, and single pictures tell them."""


def systematic_covariance(
    problem: Problem,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    solution: Solution,
    *,
    share: float,
) -> Array:
    """Return what smooth errors common to all pictures add to the covariance of the shared unknowns, (n, n).

    Parameters
    ----------
    problem, at
        The likelihood about a state.
    components, weights
        Variance components and weights.
    solution
        Solution of the equations that they make there.
    share
        Root mean square of each field over the corners, in standard deviations of a corner's noise.
    """
    along_u, along_v = _fields(problem, _ALONG_U), _fields(problem, _ALONG_V)
    corners = at.corners
    w = weights.corners / components.noise_scale**2
    pulls = np.swapaxes(corners.jacobian, 1, 2) @ (problem.whiten * w[:, None, None])  # (L, m, 2)
    groups = groups_of(corners.group, len(corners.group_stop))
    g = np.array([_pull(pulls[rows], along_u[rows], along_v[rows]) for rows in groups])
    P = len(problem.drive)
    a = np.tensordot(corners.J_shared, g, axes=([0, 1], [0, 1]))
    c = by_stop(np.swapaxes(corners.J_pose, 1, 2) @ g, corners.group_stop, P)
    local = by_stop(np.swapaxes(corners.J_local * components.local_sigma, 1, 2) @ g, corners.group_stop, P)
    e = solution.eliminated
    a -= np.tensordot(e.by_shared, local, axes=([0, 1], [0, 1]))
    chain = -np.swapaxes(e.by_chain, 1, 2) @ local
    chain[:, :3] += c
    d = solution.cov @ (a - np.tensordot(solution.Y, chain, axes=([0, 1], [0, 1])))
    d *= share * components.noise_scale * problem.sigma_px
    return np.asarray(d @ d.T)


def _fields(problem: Problem, powers: tuple[tuple[int, int], ...]) -> Array:
    """Return smooth fields over the image at the corners, (L, F), each of root mean square 1."""
    centre = problem.uv_px.mean(axis=0)
    x, y = ((problem.uv_px - centre) / np.abs(problem.uv_px - centre).max()).T
    f = np.stack([x**a * y**b for a, b in powers], axis=1)
    return np.asarray(f / np.sqrt(np.mean(f**2, axis=0)))


def _pull(pulls: Array, along_u: Array, along_v: Array) -> Array:
    """Return the right-hand sides (m, F) of one group, fields along u first."""
    return np.concatenate([pulls[:, :, 0].T @ along_u, pulls[:, :, 1].T @ along_v], axis=1)
