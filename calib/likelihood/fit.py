"""The solution in the solver's own terms."""

from dataclasses import dataclass

from boxcal.calib.likelihood.levenberg_marquardt import Levels, Linearised, Weights
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.outliers import LegTests
from boxcal.calib.likelihood.problem import Problem, State
from boxcal.calib.likelihood.variance_components import SlipProfile
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """What the estimate is made from, and what validation and benchmarks build on.

    Attributes
    ----------
    problem, options
        Data and what was asked for.
    at
        The likelihood at the mean over the levels of slip.
    cov : (n, n)
        Of the shared unknowns (mounting: right perturbation, rotation and translation), slip's uncertainty included.
    levels
        Noise levels: slip is the root of its mean square.
    factor_sigma
        Standard deviation of the pixel factor.
    profile
        Levels of slip and the solutions that belong to them.
    weights
        Which corners and legs counted.
    tests
        Of the legs.
    hopeless : (H,)
        Stops where more than half of the corners do not fit.
    iterations, converged, cost
        Of the solver: steps, whether weights and levels settled, weighted sum of squares.
    """

    problem: Problem
    options: EstimateOptions
    at: Linearised
    cov: Array
    levels: Levels
    factor_sigma: float
    profile: SlipProfile
    weights: Weights
    tests: LegTests
    hopeless: Ids
    iterations: int
    converged: bool
    cost: float

    @property
    def state(self) -> State:
        """Values of all unknowns."""
        return self.at.state
