"""Covariance of the shared unknowns with frames on the move, smooth errors of corners in it."""

from dataclasses import dataclass, fields

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.systematic_errors import systematic_covariance
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ByGroup(VarianceComponents):
    """Variance components whose local effects differ from stops to frames.

    Attributes
    ----------
    sigma : (G, 1, 4)
        Standard deviations of the local unknowns, for the corners of each stop on each face.
    """

    sigma: Array

    @property
    def local_sigma(self) -> Array:
        """Standard deviations of the local unknowns, (G, 1, 4)."""
        return self.sigma


def joint_covariance(fit: Fit, found: Settled) -> Array:
    """Return the covariance of the shared unknowns of stops and frames together, (n, n).

    Parameters
    ----------
    fit
        Solution of the stops.
    found
        Of stops and frames.
    """
    joint, levels = found.joint, found.levels
    corners = joint.at.corners
    rows = corners.group_stop
    values = {f.name: getattr(fit.components, f.name) for f in fields(fit.components)}
    components = _ByGroup(**values, sigma=levels.local_sigma[rows][:, None, :])
    return found.cov + systematic_covariance(
        joint.problem,
        joint.at,
        components,
        joint.weights,
        levels.solution.at(found.best),
        share=fit.options.systematic_share,
    )
