"""Distortion coefficients that a drive nearly needs: the paper's one was chosen, Brown's five may be true.

Coefficients that fall just short of their charge bias principal point and direction by several of the sigmas that know
nothing of them. As with causes (:mod:`boxcal.calib.diagnosis.doubts`), both models are averaged: the estimate stays,
its covariance holds what the richer model would change, weighed by its Akaike weight (Burnham and Anderson 2002).
"""

import numpy as np

from boxcal.calib.likelihood.camera_selection import PER_COEFFICIENT, with_camera
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.levenberg_marquardt import linearize
from boxcal.calib.likelihood.problem import with_kind
from boxcal.calib.likelihood.slip_profile import fixed_profile
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind

LEAST = 0.1
"""A richer model less probable than this changes no sigma: three of four drives whose lens has one coefficient."""


def camera_doubt(fit: Fit) -> Array | None:
    """Return what averaging over camera models adds to the covariance of the shared unknowns, (n, n); None if nothing.

    One step towards Brown's model from the solution with one coefficient; nothing is solved again.
    """
    problem = fit.problem
    if problem.lens is not CameraKind.RADIAL:
        return None
    wider = with_kind(problem, CameraKind.BROWN)
    state = with_camera(problem, fit.state, CameraKind.BROWN)
    profile = fixed_profile(wider, linearize(wider, state, fit.weights), fit.components, fit.weights)
    step, cov = profile.solution.d_shared[0], profile.solution.cov[0]
    known = np.array([wider.names.index(name) for name in problem.names])
    new = np.setdiff1d(np.arange(len(wider.names)), known)
    gained = float(step[new] @ np.linalg.solve(cov[np.ix_(new, new)], step[new]))
    probability = 1 / (1 + np.exp((PER_COEFFICIENT * len(new) - gained) / 2))
    if probability < LEAST:
        return None
    G = np.linalg.solve(cov[np.ix_(new, new)], cov[np.ix_(new, known)])
    shift = step[known]
    return np.asarray(probability * (G.T @ cov[np.ix_(new, new)] @ G + np.outer(shift, shift)))
