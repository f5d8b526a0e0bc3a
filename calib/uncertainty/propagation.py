"""Propagation of a calibration's uncertainty to dead reckoning and projection."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.geometry.parameters import CAMERA, MOUNTING, ORDER
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.leg_model import LegModel, leg_model
from boxcal.calib.likelihood.wheel_path import WheelPath
from boxcal.calib.uncertainty.projection import projection_sigma
from boxcal.target.arrays import Array

STRAIGHT_M = 10.0
_SAMPLES = 500
_WHEELS = slice(5, 8)
_GRID = (16, 12)


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveUncertainty:
    """Standard deviations of dead reckoning after one move.

    Attributes
    ----------
    heading, along, across
        Heading (rad) and position (m, along and across the heading at the start) through the calibration alone: the
        same error on every repetition.
    heading_slip, along_slip, across_slip
        The same through slip and encoder alone: different on every repetition.
    """

    heading: float
    along: float
    across: float
    heading_slip: float
    along_slip: float
    across_slip: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ProjectionUncertainty:
    """Uncertainty of the pixel at which a point fixed to the robot is predicted.

    Attributes
    ----------
    distance_m : m
        Of the points from the camera.
    mean_px, worst_px : px
        Standard deviation (root of the sum of both coordinates' variances): root mean square over the image, and worst.
    worst_at_px
        Where it is worst.
    """

    distance_m: float
    mean_px: float
    worst_px: float
    worst_at_px: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundUncertainty:
    """Uncertainty of dead reckoning and projection under a calibration.

    Attributes
    ----------
    straight
        After 10 m straight ahead.
    turn
        After one full turn on the spot.
    projection
        Over the image, for points fixed to the robot: camera and extrinsics together.
    """

    straight: MoveUncertainty
    turn: MoveUncertainty
    projection: ProjectionUncertainty


def ground_uncertainty(
    estimate: Estimate, image_size: tuple[int, int] = (640, 480), distance_m: float = 1.0
) -> GroundUncertainty:
    """Return the predicted errors of dead reckoning and of projection.

    Parameters
    ----------
    estimate
        The calibration.
    image_size : px
        Width and height.
    distance_m : m
        Of the points that are projected.
    """
    wheels = np.array([estimate.rR, estimate.rL, estimate.b])
    forward = STRAIGHT_M / wheels[:2]
    around = np.pi * wheels[2] / wheels[:2] * (1, -1)
    return GroundUncertainty(
        straight=_move(estimate, wheels, forward),
        turn=_move(estimate, wheels, around),
        projection=_projection(estimate, image_size, distance_m),
    )


def _move(estimate: Estimate, wheels: Array, phi: Array) -> MoveUncertainty:
    model = _model(wheels, phi)
    J = model.d_wheels[0]
    cov = estimate.cov if estimate.odometry_cov is None else estimate.odometry_cov
    systematic = np.sqrt(np.diag(J @ cov[_WHEELS, _WHEELS] @ J.T))
    step = estimate.noise.encoder_step
    ends = model.d_start[0] @ model.d_start[0].T + model.d_end[0] @ model.d_end[0].T
    random = np.sqrt(np.diag(estimate.noise.slip**2 * model.slip[0] + step**2 / 12 * ends))
    return MoveUncertainty(
        heading=float(systematic[2]),
        along=float(systematic[0]),
        across=float(systematic[1]),
        heading_slip=float(random[2]),
        along_slip=float(random[0]),
        across_slip=float(random[1]),
    )


def _model(wheels: Array, phi: Array) -> LegModel:
    n = np.arange(_SAMPLES)
    path = WheelPath(
        dphi=np.tile(phi / _SAMPLES, (_SAMPLES, 1)),
        starts=np.zeros(1, dtype=np.int64),
        leg=np.zeros(_SAMPLES, dtype=np.int64),
        moving=(n, n),
        phi_start=n[:, None] * phi / _SAMPLES,
        t_start_ns=np.zeros(0, dtype=np.int64),
    )
    none = np.zeros((1, 2))
    return leg_model(path, wheels, none, none)


def _projection(estimate: Estimate, image_size: tuple[int, int], distance_m: float) -> ProjectionUncertainty:
    u, v = np.meshgrid(np.linspace(0, image_size[0] - 1, _GRID[0]), np.linspace(0, image_size[1] - 1, _GRID[1]))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    _, cov = camera_covariance(estimate)
    sigma = projection_sigma(estimate.camera, cov, estimate.T_body_cam, uv_px=uv, distance=distance_m)
    seen = np.isfinite(sigma)
    worst = int(np.argmax(np.where(seen, sigma, -1)))
    return ProjectionUncertainty(
        distance_m=distance_m,
        mean_px=float(np.sqrt(np.mean(sigma[seen] ** 2))) if np.any(seen) else np.inf,
        worst_px=float(sigma[worst]) if np.any(seen) else np.inf,
        worst_at_px=(float(uv[worst, 0]), float(uv[worst, 1])),
    )


def camera_covariance(estimate: Estimate) -> tuple[tuple[str, ...], Array]:
    """Return the names of the camera model's coefficients and of the camera extrinsics, and their covariance."""
    names = (*ORDER[CAMERA], *estimate.camera.further, *ORDER[MOUNTING])
    columns = [estimate.names.index(name) for name in names]
    return names, estimate.cov_all[np.ix_(columns, columns)]
