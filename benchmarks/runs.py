"""Simulated runs of one robot, solved by the paper's procedure and by likelihood, in the paper's parameters."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import radians

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps, solve_four_steps
from boxcal.calib.geometry.so3_se3 import rot_y, rot_z, wrap
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import Robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import Target, make_target
from boxcal.target.camera.camera_model import CameraModel

PARAMETERS = ("fu", "fv", "cu", "cv", "kr", "rR", "rL", "b", "a1", "a2", "a3", "tx", "ty", "tz")
WHEELS, ANGLES, TRANSLATION = slice(5, 8), slice(8, 11), slice(11, 14)
MOTION = (5, 6, 7, 8, 11, 12)
"""rR, rL, b, a1, tx and ty: what steps 2 and 4 find from the wheels, and slip spoils."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """How runs are simulated; the defaults are the paper's (section 4), slip aside.

    Attributes
    ----------
    stops
        P.
    slip : m/sqrt(m)
    sigma_px : px
        Gaussian noise of each coordinate of a corner.
    encoder_step : rad
    period_s : s
        Between wheel samples (T).
    plan : (P, 3), m and rad, optional
        Stops (x, y, heading) of all runs, joined by straights and turns on the spot; without it every run draws its
        own stops, and arcs between them.
    """

    stops: int
    slip: float = 0.0
    sigma_px: float = 0.25
    encoder_step: float = radians(0.1302)
    period_s: float = 0.02
    plan: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """One run: (14,) each in the order of ``PARAMETERS``, px, m and rad; NaN where a procedure gave up.

    Attributes
    ----------
    closed, likelihood
        Errors of the paper's procedure and ours.
    sigma
        What ours says about itself.
    singular
        sigma5/sigma4 and sigma4/sigma3 of the paper's step 4.
    """

    closed: Array
    likelihood: Array
    sigma: Array
    singular: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Runs:
    """Runs stacked: (n, 14) each; singular (n, 2)."""

    closed: Array
    likelihood: Array
    sigma: Array
    singular: Array

    @property
    def failed(self) -> tuple[int, int]:
        """How many runs gave no result: the paper's procedure, ours."""
        return int(np.isnan(self.closed[:, 0]).sum()), int(np.isnan(self.likelihood[:, 0]).sum())


def rms(errors: Array) -> Array:
    """Return the root mean square over the runs that gave a result."""
    return np.asarray(np.sqrt(np.nanmean(errors**2, axis=0)))


def drive(robot: Robot, target: Target, setting: Setting, rng: np.random.Generator) -> tuple[Drive, Correspondences]:
    """Return one drive: as it was, and what a detector would see and the encoders read."""
    options = DriveOptions(
        stops=setting.stops,
        slip=setting.slip,
        encoder_step=setting.encoder_step,
        joint_period_s=setting.period_s,
        steps_per_sample=4,
    )
    driven = simulate_drive(robot, target, options, rng, stops=setting.plan)
    return driven, exact_correspondences(robot, target, driven, sigma_px=setting.sigma_px, rng=rng)


def simulate_runs(robot: Robot, setting: Setting, count: int, seed: int = 0) -> Runs:
    """Return ``count`` runs, with the default options of the likelihood."""
    return stack(_run(robot, make_target(), setting, seed, k) for k in range(count))


def stack(runs: Iterator[Run]) -> Runs:
    """Return runs as arrays."""
    found = list(runs)
    return Runs(
        closed=np.array([r.closed for r in found]),
        likelihood=np.array([r.likelihood for r in found]),
        sigma=np.array([r.sigma for r in found]),
        singular=np.array([r.singular for r in found]),
    )


def _run(robot: Robot, target: Target, setting: Setting, seed: int, k: int) -> Run:
    _, seen = drive(robot, target, setting, np.random.default_rng([seed, setting.stops, k]))
    truth = true_values(robot)
    closed = likelihood = sigma = np.full(14, np.nan)
    singular = (np.nan, np.nan)
    steps = None
    try:
        steps = solve_four_steps(seen)
        closed = difference(step_values(steps), truth)
        singular = (steps.mounting.null_ratio, steps.mounting.rank_ratio)
    except CalibError:
        pass  # counted: its errors stay NaN
    try:
        found = estimate([seen], steps, EstimateOptions(find_faults=False))
        likelihood, sigma = difference(estimate_values(found), truth), estimate_sigma(found)
    except CalibError:
        pass
    return Run(closed=closed, likelihood=likelihood, sigma=sigma, singular=singular)


def true_values(robot: Robot) -> Array:
    """Return a simulated robot's parameters."""
    return _values(robot.camera, (robot.rR, robot.rL, robot.b), robot.T_body_cam)


def step_values(steps: FourSteps) -> Array:
    """Return the parameters that the paper's procedure found."""
    m = steps.mounting
    return _values(steps.camera.camera, (m.rR, m.rL, m.b), steps.T_body_cam)


def estimate_values(found: Estimate) -> Array:
    """Return the parameters of greatest likelihood."""
    return _values(found.camera, (found.rR, found.rL, found.b), found.T_body_cam)


def estimate_sigma(found: Estimate) -> Array:
    """Return the likelihood's standard deviations, its rotation turned into the paper's angles."""
    J = np.eye(14)
    J[ANGLES, ANGLES] = np.linalg.inv(_angle_axes(found.T_body_cam[:3, :3]))
    return np.asarray(np.sqrt(np.diag(J @ found.cov @ J.T)))


def difference(values: Array, truth: Array) -> Array:
    """Return values less truth, angles wrapped."""
    error = values - truth
    error[..., ANGLES] = wrap(error[..., ANGLES])
    return np.asarray(error)


def angles(R: Array) -> tuple[float, float, float]:
    """Return a1, a2, a3 of ``R = Rz(a1) Ry(a2) Rz(a3)``, 0 < a2 < pi (eq. 12), rad."""
    a1 = np.arctan2(R[1, 2], R[0, 2])
    a2 = np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])
    return float(a1), float(a2), float(np.arctan2(R[2, 1], -R[2, 0]))


def _angle_axes(R: Array) -> Array:
    """Return the axes about which a1, a2 and a3 turn, in the camera's frame, as columns (3, 3)."""
    _, a2, a3 = angles(R)
    back = (rot_y(a2) @ rot_z(a3)).T
    return np.stack([back[:, 2], rot_z(a3).T[:, 1], np.array([0.0, 0.0, 1.0])], axis=1)


def _values(camera: CameraModel, wheels: tuple[float, float, float], T_body_cam: Array) -> Array:
    k = camera
    return np.array([k.fu, k.fv, k.cu, k.cv, k.kr, *wheels, *angles(T_body_cam[:3, :3]), *T_body_cam[:3, 3]])
