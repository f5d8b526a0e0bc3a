"""Errors of corners that are alike in all images: what they add to the covariance (consider covariance).

Noise averages over thousands of corners; what blur, shading and the camera's response do to all of them alike does not.
No data distinguish these errors from the camera model, so they are considered, not estimated (Schmidt 1966): smooth
fields over the image, each a small fraction of a corner's noise, and what each would do to the answer.
"""

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_sums import by_stop, groups_of
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.stop_elimination import Solution
from boxcal.target.arrays import Array


def systematic_covariance(
    problem: Problem,
    at: Linearization,
    components: VarianceComponents,
    weights: Weights,
    solution: Solution,
    *,
    share: float,
) -> Array:
    """Return what smooth errors common to all images add to the covariance of the shared unknowns, (n, n).

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
    along_u, along_v = _fields(problem)
    corners = at.corners
    w = weights.corners / components.noise_scale**2
    whiten = problem.whiten * w[:, None, None]
    errors = np.concatenate([whiten[:, :, :1] * along_u[:, None], whiten[:, :, 1:] * along_v[:, None]], axis=2)
    groups, m, F = groups_of(corners.group, len(corners.group_stop)), corners.jacobian.shape[2], errors.shape[2]
    g = np.array([corners.jacobian[rows].reshape(-1, m).T @ errors[rows].reshape(-1, F) for rows in groups])
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


def _fields(problem: Problem) -> tuple[Array, Array]:
    """Return smooth fields over the image at the corners, along u and along v, (L, F), each of root mean square 1.

    They are larger or smaller on both sides of the middle, as blur and growth make them: ``x, x^3, x y^2`` along u, and
    likewise along v. Shifts to one side are not of that kind, and single images determine them.
    """
    off = problem.uv_px - problem.uv_px.mean(axis=0)
    x, y = (off / np.abs(off).max()).T
    xx, yy = x * x, y * y
    fields = np.array([x, xx * x, x * yy, y, yy * y, y * xx])
    fields /= np.sqrt(np.einsum("fl,fl->f", fields, fields) / len(x))[:, None]
    return fields[:3].T, fields[3:].T
