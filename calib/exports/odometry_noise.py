"""Variances of odometry that follow from a calibration's own uncertainty and from the wheels' slip together."""

from dataclasses import dataclass
from math import isfinite, pi

from boxcal.calib.results.calibration import Calibration

_STRAIGHT = 10.0
"""Distance that the calibration's ground uncertainty is given for, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryNoise:
    """Sizes that variances of odometry follow from.

    Attributes
    ----------
    along
        Relative standard deviation of the distance driven, from the calibration.
    heading_per_m, heading_per_rad : rad/m, 1
        Standard deviation of the heading from the calibration, over the distance and over the turn on the spot.
    slip : m
        Of each wheel over its first metre; variances grow with the distance.
    b : m
        Wheel separation.
    """

    along: float
    heading_per_m: float
    heading_per_rad: float
    slip: float
    b: float

    def straight(self, distance: float) -> tuple[float, float, float]:
        """Return the variances of x, y (m^2) and heading (rad^2) after a distance straight ahead, m."""
        x = (self.along * distance) ** 2 + self.slip**2 * distance / 2
        heading = (self.heading_per_m * distance) ** 2 + 2 * self.slip**2 * distance / self.b**2
        return x, heading * distance**2 / 3, heading

    def turn(self, angle: float) -> tuple[float, float]:
        """Return the variances of the distance (m^2) and of the heading (rad^2) after a turn on the spot, rad."""
        rolled = self.b * angle / 2
        return self.slip**2 * rolled / 2, (self.heading_per_rad * angle) ** 2 + 2 * self.slip**2 * rolled / self.b**2


def odometry_noise(calibration: Calibration) -> OdometryNoise | None:
    """Return the noise of a calibrated robot's odometry; None where no sigmas were estimated or some is infinite."""
    detail, wheels = calibration.detail, calibration.wheels
    if detail is None:
        return None
    sigma = detail.covariance.sigma
    found = OdometryNoise(
        along=max(sigma["rR"] / wheels.rR, sigma["rL"] / wheels.rL),
        heading_per_m=detail.ground.straight_heading / _STRAIGHT,
        heading_per_rad=detail.ground.turn_heading / (2 * pi),
        slip=detail.noise.slip,
        b=wheels.b,
    )
    sizes = (found.along, found.heading_per_m, found.heading_per_rad, found.slip)
    return found if all(isfinite(size) for size in sizes) else None
