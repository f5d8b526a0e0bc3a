"""Difference of two calibrations of one robot: in sigmas, on the ground, and as a chi-square test."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.reprojection import transform
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.so3_se3 import inverse, log_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import CAMERA
from boxcal.calib.uncertainty.projection import points_at
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import project

STRAIGHT = 10.0
"""Distance driven straight ahead, m."""
_GRID = (25, 19)
_DISTANCE = 1.0
_AHEAD = 0.01
_SINGULAR = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundDifference:
    """Differences of two calibrations in what they predict for the robot's motion and images.

    Attributes
    ----------
    straight_position, straight_heading : m, rad
        Where the wheels' turning that is 10 m straight ahead by A ends by B.
    turn_heading : rad
        What one whole turn on the spot to the left by A is more by B.
    distance : m
        Of the points that the pixels are meant for, from A's camera.
    projection_mean_px, projection_worst_px : px
        How far apart A and B see a point known in the body's frame, over A's image.
    """

    straight_position: float
    straight_heading: float
    turn_heading: float
    distance: float
    projection_mean_px: float
    projection_worst_px: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Difference:
    """Calibration B less calibration A.

    Attributes
    ----------
    values : (14,)
        In the order of ``ORDER``; rx, ry, rz are ``log(R_body_cam_A^T R_body_cam_B)``.
    sigma : (14,), optional
        Standard deviations of the difference, infinite where a drive does not determine a parameter; None without
        covariances.
    chi2, dof, p_value : optional
        Of all determined parameters together; p_value is the chance of a difference as large between two calibrations
        of a robot that did not change, from independent drives. None where that cannot be judged.
    why_not
        Why chance cannot be judged; empty if it can.
    ground
        The difference on the ground.
    """

    values: Array
    sigma: Array | None
    chi2: float | None
    dof: int
    p_value: float | None
    why_not: str
    ground: GroundDifference


def difference(a: Calibration, b: Calibration) -> Difference:
    """Return how calibration B of a robot differs from calibration A.

    The covariances of the two add, since their drives are independent. To first order a right perturbation of either
    mounting is one of their difference, which is small wherever chance is in doubt.

    Raises
    ------
    CalibError
        If their images differ in size, so that their cameras cannot be compared.
    """
    if a.image_size != b.image_size:
        sizes = " and ".join(f"{w} x {h}" for w, h in (a.image_size, b.image_size))
        raise CalibError(f"images of {sizes} px, one size is needed", remedy="calibrate both with one camera mode")
    for which, c in (("A", a), ("B", b)):
        if min(c.wheels.rR, c.wheels.rL, c.wheels.b, c.camera.fu, c.camera.fv) <= 0:
            raise CalibError(f"calibration {which} has a length that is not positive", remedy="calibrate again")
    values, ground = parameter_difference(a, b), ground_difference(a, b)
    missing = [which for which, c in (("A", a), ("B", b)) if c.detail is None]
    if a.detail is None or b.detail is None:
        why_not = f"{' and '.join(missing)} came without a covariance"
        return Difference(values=values, sigma=None, chi2=None, dof=0, p_value=None, why_not=why_not, ground=ground)
    cov = a.detail.covariance.matrix + b.detail.covariance.matrix
    if a.camera.kind is not b.camera.kind:  # coefficients of unlike models mean unlike things
        cov[: len(CAMERA), :] = cov[:, : len(CAMERA)] = np.nan
        cov[np.diag_indices(len(CAMERA))] = np.inf
    if not np.all(np.diag(cov) > 0):
        raise CalibError("a covariance holds variances that are not positive", remedy="calibrate again")
    sigma = np.sqrt(np.diag(cov))
    shared = set(_logs(a)) & set(_logs(b))
    why_not = "both were calibrated from the same log, so their errors are not independent" if shared else ""
    if not np.any(np.isfinite(sigma)):
        why_not = "the drives determine no parameter"
    if why_not:
        return Difference(values=values, sigma=sigma, chi2=None, dof=0, p_value=None, why_not=why_not, ground=ground)
    chi2, dof = _chi_square(values, cov)
    p_value = float(gammaincc(dof / 2, chi2 / 2))
    return Difference(values=values, sigma=sigma, chi2=chi2, dof=dof, p_value=p_value, why_not="", ground=ground)


def parameter_difference(a: Calibration, b: Calibration) -> Array:
    """Return the parameters of B less those of A, (14,), in the order of ``ORDER``."""
    camera = [getattr(b.camera, n) - getattr(a.camera, n) for n in ("fu", "fv", "cu", "cv", "kr")]
    wheels = [getattr(b.wheels, n) - getattr(a.wheels, n) for n in ("rR", "rL", "b")]
    turned = log_so3(a.T_body_cam[:3, :3].T @ b.T_body_cam[:3, :3])
    return np.array([*camera, *wheels, *turned, *(b.T_body_cam[:3, 3] - a.T_body_cam[:3, 3])])


def ground_difference(a: Calibration, b: Calibration) -> GroundDifference:
    """Return what B does otherwise than A: odometry and projection."""
    x, y, straight = _driven(b.wheels, STRAIGHT / a.wheels.rR, STRAIGHT / a.wheels.rL)
    half = np.pi * a.wheels.b
    _, _, turn = _driven(b.wheels, half / a.wheels.rR, -half / a.wheels.rL)
    distance = a.detail.ground.distance if a.detail else _DISTANCE
    shift = projection_shift(a, b, distance)
    seen = shift[np.isfinite(shift)]
    return GroundDifference(
        straight_position=float(np.hypot(x - STRAIGHT, y)),
        straight_heading=straight,
        turn_heading=turn - 2 * np.pi,
        distance=distance,
        projection_mean_px=float(np.mean(seen)) if seen.size else np.inf,
        projection_worst_px=float(np.max(seen)) if seen.size else np.inf,
    )


def projection_shift(a: Calibration, b: Calibration, distance: float) -> Array:
    """Return how far B sees points from where A does, (N,) px, over A's image; NaN where either sees nothing.

    Parameters
    ----------
    a, b
        Calibrations of one robot.
    distance : m
        Of the points from A's camera; they stand still in the body's frame.
    """
    u, v = (np.linspace(0, size - 1, count) for size, count in zip(a.image_size, _GRID, strict=True))
    uv_px = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    p_cam = points_at(a.camera, uv_px, distance)
    p_there = transform(inverse(b.T_body_cam), transform(a.T_body_cam, p_cam))
    ahead = np.nan_to_num(p_there[:, 2]) > _AHEAD * distance
    shift = np.full(len(uv_px), np.nan)
    shift[ahead] = np.linalg.norm(project(b.camera, p_there[ahead]) - uv_px[ahead], axis=1)
    return shift


def _driven(wheels: Wheels, phi_R: float, phi_L: float) -> tuple[float, float, float]:
    """Return where wheels take the robot at constant speeds: x, y (m) and heading (rad)."""
    travel, turn = (wheels.rR * phi_R + wheels.rL * phi_L) / 2, (wheels.rR * phi_R - wheels.rL * phi_L) / wheels.b
    chord = travel * np.sinc(turn / 2 / np.pi)
    return float(chord * np.cos(turn / 2)), float(chord * np.sin(turn / 2)), float(turn)


def _logs(calibration: Calibration) -> list[str]:
    """Return the hashes of the logs that a calibration was made from."""
    return [digest for digest in calibration.provenance.logs.values() if digest]


def _chi_square(values: Array, cov: Array) -> tuple[float, int]:
    """Return chi-square and degrees of freedom of what both drives determine.

    Raises
    ------
    CalibError
        If the covariance is none.
    """
    known = np.isfinite(np.diag(cov))
    d, C = values[known], cov[np.ix_(known, known)]
    scale = np.sqrt(np.diag(C))
    correlation = C / np.outer(scale, scale)
    if not np.all(np.isfinite(correlation)):
        raise CalibError("a covariance has gaps between parameters that it determines", remedy="calibrate again")
    variance, axes = np.linalg.eigh((correlation + correlation.T) / 2)
    if variance[0] < -_SINGULAR:
        raise CalibError("a covariance has a direction of negative variance", remedy="calibrate again")
    kept = variance > _SINGULAR
    along = axes.T @ (d / scale)
    return float(np.sum(along[kept] ** 2 / variance[kept])), int(np.sum(kept))
