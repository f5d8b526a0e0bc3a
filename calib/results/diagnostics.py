"""Uncertainty, legs, outliers and unobservable directions of a calibration."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.likelihood.estimate import Direction, FlaggedCorner, FlaggedLeg, NoiseLevels
from boxcal.calib.uncertainty.convergence_point import ConvergencePoint
from boxcal.target.arrays import Array

CAMERA, WHEELS, MOUNTING = ORDER[:5], ORDER[5:8], ORDER[8:]
"""What of it belongs to the camera, to the wheels and to the camera extrinsics (rotation, then translation)."""
SIDE = (
    "rx, ry, rz: right perturbation of the mounting, R_body_cam exp(rx, ry, rz), about the camera's own axes; "
    "tx, ty, tz: of t_body_cam itself, along the body's axes"
)


_MOST_FLOOR = 1 - 1e-6
"""The largest fraction of the corners' noise that the floor may be: something of their own covariances is always
left."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Covariance:
    """Covariance of named parameters.

    Attributes
    ----------
    matrix : (n, n)
        In the order of ``names``, with the side of ``SIDE``; infinite on the diagonal (and NaN beside it) where the
        drive does not determine a parameter.
    names : (n,)
        The parameters; the 14 reported ones unless said otherwise.
    """

    matrix: Array
    names: tuple[str, ...] = ORDER

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter by name; infinite where it is not determined."""
        return dict(zip(self.names, np.sqrt(np.diag(self.matrix)).tolist(), strict=True))

    def correlation(self, a: str, b: str) -> float:
        """Return the correlation of two parameters."""
        i, j = self.names.index(a), self.names.index(b)
        return float(self.matrix[i, j] / np.sqrt(self.matrix[i, i] * self.matrix[j, j]))

    def block(self, names: Sequence[str]) -> Array:
        """Return the covariance of some of the parameters, in their order."""
        rows = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(rows, rows)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One leg of the drive, between two stops that were used.

    Attributes
    ----------
    drive
        Number of the drive, from 0.
    start, end
        Numbers of the stops in the drive, from 0.
    t_start_ns, t_end_ns : ns
        When it was driven.
    rolled : m
        Mean distance that the wheels rolled.
    turned : rad
        Heading change by the wheels.
    residual : (3,)
        Wheels less images, whitened: forward, sideways, turn.
    p_value
        Chance of a leg that differs as much from what all other data predict.
    used
        Whether it counted.
    """

    drive: int
    start: int
    end: int
    t_start_ns: int
    t_end_ns: int
    rolled: float
    turned: float
    residual: tuple[float, float, float]
    p_value: float
    used: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Standard deviations of odometry and projection that follow from a calibration's uncertainty.

    Attributes
    ----------
    straight_heading, straight_position : rad, m
        Heading and position error after 10 m straight ahead, from the calibration's uncertainty alone.
    turn_heading : rad
        Heading error after one whole turn on the spot.
    distance : m
        Distance that the projection is meant for.
    projection_mean_px, projection_worst_px : px
        Uncertainty of where a point at that distance, known in the body's frame, appears in the image.
    """

    straight_heading: float
    straight_position: float
    turn_heading: float
    distance: float
    projection_mean_px: float
    projection_worst_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """One stop that was left out and predicted from the others, odometry and calibration.

    Attributes
    ----------
    drive, stop
        Numbers from 0, as in the drive.
    error : (3,), m and rad
        Predicted less seen: forward, to the left, heading.
    sigma : (3,), m and rad
        Standard deviations that the prediction claims.
    """

    drive: int
    stop: int
    error: tuple[float, float, float]
    sigma: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaveOneOut:
    """Standard deviations that do not trust the model, from leaving out each stop's image and each leg.

    Attributes
    ----------
    sigma, ratio : (14,)
        In the order of the covariance; their ratio to what the likelihood alone claims, 1 where it was not tested.
    limit
        Of the ratio, beyond which it is not by chance; the covariance is enlarged to what is beyond.
    unexplained
        Whether any is beyond chance: something is not as the model has it.
    """

    sigma: tuple[float, ...]
    ratio: tuple[float, ...]
    limit: float
    unexplained: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Detail:
    """All that the likelihood adds to a calibration.

    Attributes
    ----------
    covariance
        Of the reported parameters.
    noise
        Noise levels found in the data.
    camera_covariance
        Of the camera model's coefficients and of the camera extrinsics together; None in files of before 0.2, which
        give it for the 14 reported parameters only.
    extra, extra_sigma
        Further unknowns (tilt of the floor, print scale, face poses, ink) by name, and their sigmas.
    legs
        Every leg used or left out.
    flagged_legs, flagged_corners
        Outliers found.
    directions
        What the drive determines badly or not at all, in words.
    ground
        What the uncertainty means on the ground.
    leave_one_out
        Standard deviations from leaving out stops and legs; None in files of before 0.2.
    effects
        Standard deviations of random effects by name with their unit: how much the robot leans from stop to stop, how
        well the box was made, by how much every corner errs besides its own covariance. Those that the data say are
        none are zero.
    scale_sigma
        What the print's own size leaves open in every length, relative: it comes on top of every length's sigma.
    held_out
        Stops predicted from the others, where asked for.
    growth
        Estimates over the number of stops, where asked for.
    """

    covariance: Covariance
    noise: NoiseLevels
    extra: dict[str, float]
    extra_sigma: dict[str, float]
    legs: tuple[Leg, ...]
    flagged_legs: tuple[FlaggedLeg, ...]
    flagged_corners: tuple[FlaggedCorner, ...]
    directions: tuple[Direction, ...]
    ground: Ground
    held_out: tuple[HeldOut, ...] = ()
    growth: tuple[ConvergencePoint, ...] = ()
    camera_covariance: Covariance | None = None
    leave_one_out: LeaveOneOut | None = None
    effects: dict[str, float] = field(default_factory=dict)
    scale_sigma: float | None = None

    @property
    def corner_floor_px(self) -> float:
        """Standard deviation, px, of what every corner errs by besides its own covariance, less than the whole."""
        return min(self.effects.get("corner_floor_px", 0.0), _MOST_FLOOR * self.noise.pixel_px)

    @property
    def noise_scale(self) -> float:
        """Noise scale of the corners' own covariances: without the floor."""
        if self.corner_floor_px == 0:
            return self.noise.pixel_factor
        return self.noise.pixel_factor * float(np.sqrt(1 - (self.corner_floor_px / self.noise.pixel_px) ** 2))

    def corner_cov_px2(self, told_px2: Array) -> Array:
        """Return the covariances of corners' errors, (L, 2, 2), px^2, from those that come with the corners."""
        return self.noise_scale**2 * told_px2 + self.corner_floor_px**2 * np.eye(2)
