"""Errors of corners that are alike in all pictures: what they add to the covariance (consider covariance).

Noise averages over thousands of corners; what blur, shading and the camera's response do to all of them alike does not.
No data tell these errors from the camera model, so they are considered, not estimated (Schmidt 1966): smooth fields
over the image, each a small share of a corner's noise, and what each would do to the answer.
"""

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.normal_equations import Solution
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.residuals import corner_residuals
from boxcal.target.arrays import Array

SHARE = 0.045
"""Root mean square of each field over the corners, in standard deviations of a corner's noise.

From robots of two renderers, ours and one that shares no code with it: with it the errors of the cameras are about
as large as their sigmas say (``benchmarks/clean_robots.py``, ``benchmarks/rooms.py``), without it a quarter larger.
"""
_POWERS = tuple((a, b) for a in range(4) for b in range(4 - a) if a + b > 0)
"""Powers of the two image coordinates, up to the third order: a shift of the whole image is no error."""


def systematic_covariance(
    problem: Problem, at: Linearization, components: VarianceComponents, weights: Weights, solution: Solution
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
    """
    fields = _fields(problem)
    corners = corner_residuals(problem, at.state, at.columns)
    counts = np.asarray(np.bincount(corners.group, minlength=len(corners.group_stop)))
    order = np.argsort(corners.group, kind="stable")
    starts = np.cumsum(counts) - counts
    w = weights.corners / components.noise_scale**2
    rows = np.einsum("lam,la,l,lf->lmf", corners.jacobian, _whitened_ones(problem, 0), w, fields)
    other = np.einsum("lam,la,l,lf->lmf", corners.jacobian, _whitened_ones(problem, 1), w, fields)
    by_field = np.concatenate([rows, other], axis=2)[order]
    g = np.add.reduceat(by_field, starts, axis=0)  # (G, m, F)
    P = len(problem.drive)
    first = np.searchsorted(corners.group_stop, np.arange(P))
    a = np.einsum("gmi,gmf->if", corners.J_shared, g)
    c = np.add.reduceat(np.swapaxes(corners.J_pose, 1, 2) @ g, first, axis=0)
    local = np.add.reduceat(np.swapaxes(corners.J_local * components.local_sigma, 1, 2) @ g, first, axis=0)
    e = solution.eliminated
    a = a - np.einsum("pqn,pqf->nf", e.by_shared, local)
    chain = np.einsum("pqk,pqf->pkf", -e.by_chain, local)
    chain[:, :3] += c
    d = solution.cov @ (a - np.einsum("pkn,pkf->nf", solution.Y, chain))
    noise_px = components.noise_scale / np.sqrt(np.mean(np.linalg.det(problem.whiten)))
    d *= SHARE * noise_px
    return np.asarray(d @ d.T)


def _fields(problem: Problem) -> Array:
    """Return smooth fields over the image at the corners, (L, F), each of root mean square 1."""
    centre = problem.uv_px.mean(axis=0)
    x, y = ((problem.uv_px - centre) / np.abs(problem.uv_px - centre).max()).T
    f = np.stack([x**a * y**b for a, b in _POWERS], axis=1)
    return np.asarray(f / np.sqrt(np.mean(f**2, axis=0)))


def _whitened_ones(problem: Problem, axis: int) -> Array:
    """Return what an error of 1 px along an image axis is after whitening, (L, 2)."""
    return problem.whiten[:, :, axis]
