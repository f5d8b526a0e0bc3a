"""The solution in the solver's own terms."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from boxcal.calib.geometry.two_by_two import determinants
from boxcal.calib.likelihood.camera_score import CameraScore
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.outliers import LegTests
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.slip_profile import SlipProfile
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array, Ids


class Known(Protocol):
    """Parts of a solution that help to find one of nearly the same data: those of a :class:`Fit`, say."""

    @property
    def weights(self) -> Weights:
        """Weights of corners and legs."""

    @property
    def components(self) -> VarianceComponents:
        """Variance components."""

    @property
    def profile(self) -> SlipProfile | None:
        """Levels of slip, if known."""


class Tested(Protocol):
    """Parts of a solution that score tests look at: those of a :class:`Fit`, or of a robot with several cameras."""

    @property
    def problem(self) -> Problem:
        """Data and unknowns."""

    @property
    def at(self) -> Linearization:
        """The likelihood at the mean over slip."""

    @property
    def state(self) -> State:
        """Values of all unknowns."""

    @property
    def weights(self) -> Weights:
        """Weights of corners and legs."""

    @property
    def components(self) -> VarianceComponents:
        """Variance components."""

    @property
    def profile(self) -> SlipProfile:
        """Levels of slip and the solutions that belong to them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Converged fit of the likelihood, the basis of estimate, tests, validation and benchmarks.

    Attributes
    ----------
    problem, options
        Data and what was asked for.
    at
        The likelihood at the mean over slip.
    cov : (n, n)
        Of the shared unknowns (extrinsics: right perturbation, rotation and translation), slip's uncertainty included.
    components
        Variance components: slip is the root of its mean square.
    noise_scale_sigma
        Standard deviation of the noise scale.
    profile
        Levels of slip and the solutions that belong to them.
    weights
        Which corners and legs counted.
    tests
        Of the legs.
    unreliable_stops : (H,)
        Stops where more than half of the corners do not fit.
    camera_scores
        How other camera models did, where one was chosen.
    iterations, converged, cost
        Of the solver: steps, whether weights and components settled, weighted sum of squares.
    """

    problem: Problem
    options: EstimateOptions
    at: Linearization
    cov: Array
    components: VarianceComponents
    noise_scale_sigma: float
    profile: SlipProfile
    weights: Weights
    tests: LegTests
    unreliable_stops: Ids
    iterations: int
    converged: bool
    cost: float
    camera_scores: tuple[CameraScore, ...] = ()

    @property
    def state(self) -> State:
        """Values of all unknowns."""
        return self.at.state


def log_noise(fit: Fit) -> float:
    """Return how much corners err beyond their own covariances: half the log ratio of determinants.

    Only corners that counted. Determinants in px^4 by themselves would make what leaving out a corner costs depend on
    how many px it is known to.
    """
    used = fit.weights.corners > 0
    stated = fit.problem.stated_px2[used]
    floor = determinants(stated + fit.problem.floor_px**2 * np.eye(2)) / determinants(stated)
    return float(np.sum(2 * np.log(fit.components.noise_scale) + 0.5 * np.log(floor)))
