"""The evidence of a solution, so that solutions with other unknowns and variances can be compared."""

import numpy as np

from boxcal.calib.likelihood.fit import Fit, log_noise

LEG_LEFT_OUT, CORNER_LEFT_OUT = 10.0, 12.0
"""What leaving out one of them costs, in log likelihood: about where their tests draw the line."""


def log_evidence(fit: Fit) -> float:
    """Return the logarithm of a solution's evidence, up to a constant of the data.

    The restricted likelihood, averaged over slip, counts all unknowns by their information but not how wide their
    priors are: without that an unknown of small prior would seem to cost much, and a variance found anew nothing.
    What had to be left out counts against a solution.
    """
    sigma = fit.components.prior_sigma(fit.problem)
    priors = float(np.sum(np.log(sigma[np.isfinite(sigma) & (sigma > 0)])))
    legs = LEG_LEFT_OUT * float(np.sum(fit.problem.leg_known & (fit.weights.legs == 0)))
    corners = CORNER_LEFT_OUT * float(np.sum(fit.weights.corners == 0))
    return fit.profile.log_evidence - priors - log_noise(fit) - legs - corners
