"""Cramer-Rao bound of a drive at the truth, and errors of estimates against the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from boxcal.calib.geometry.known_robot import KnownRobot
from boxcal.calib.geometry.parameters import COUNT
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.levenberg_marquardt import Weights, equations, leg_information, linearize
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.calib.likelihood.slip_profile import quiet_slip
from boxcal.calib.likelihood.state import State, resting
from boxcal.calib.likelihood.stop_elimination import solve
from boxcal.calib.likelihood.summary import reported_cov
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel, first_values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """True parameters of a simulated robot and its drives.

    Attributes
    ----------
    camera
        Intrinsics.
    rR, rL, b : m
        Wheels.
    T_body_cam : (4, 4), m
        Camera extrinsics.
    stop_poses
        For each drive (P, 3), x, y (m) and heading (rad) at its stops, on a floor that is not tilted.
    slip : m/sqrt(m)
        Of each wheel.
    encoder_step : rad
        0 for encoders without steps.
    lean, height : rad, m
        How much roll and pitch, and height, truly vary from stop to stop.
    target
        How much the target as built truly deviates, by variance component; where it is missing, as usual.
    noise_scale
        What the corners' true standard deviations are of those in their covariances.
    """

    camera: CameraModel
    rR: float
    rL: float
    b: float
    T_body_cam: Array
    stop_poses: tuple[Array, ...]
    slip: float
    encoder_step: float
    noise_scale: float = 1.0
    lean: float = 0.0
    height: float = 0.0
    target: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, robot: KnownRobot, *stop_poses: Array, slip: float, encoder_step: float) -> "Truth":
        """Return the truth of a robot and its drives, on a floor and around a box without faults."""
        return cls(
            camera=robot.camera,
            rR=robot.rR,
            rL=robot.rL,
            b=robot.b,
            T_body_cam=robot.T_body_cam,
            stop_poses=stop_poses,
            slip=slip,
            encoder_step=encoder_step,
        )


NO_SLIP = 0.02
"""No slip at all is taken as this fraction of what equals the encoders' quantisation, so that nothing is exact."""


def cramer_rao(drives: Sequence[Correspondences], truth: Truth, options: EstimateOptions | None = None) -> Array:
    """Return the smallest covariance that an unbiased estimator can have, (14, 14), all stops used, levels known.

    Order and conventions are those of ``Estimate.cov``. Priors of the options count as measurements.
    """
    options = options or EstimateOptions()
    kept = [tuple(range(len(d.stops))) for d in drives]
    problem = build_problem(drives, kept, options, truth.encoder_step)
    weights = Weights(corners=np.ones(len(problem.uv_px)), legs=problem.leg_known.astype(np.float64))
    at = linearize(problem, _state(problem, truth), weights)
    slip = max(truth.slip, NO_SLIP * quiet_slip(problem, at))
    components = VarianceComponents(
        noise_scale=truth.noise_scale, slip=slip, lean=truth.lean, height=truth.height, target=dict(truth.target)
    )
    normal, _ = equations(problem, at, components, leg_information(problem, at.legs, weights, np.array(slip)))
    nothing = np.zeros(len(problem.names), dtype=np.bool_)
    return reported_cov(solve(normal).cov, at.state, nothing)[:COUNT, :COUNT]


def errors(estimate: Estimate, truth: Truth) -> Array:
    """Return estimate less truth, (14,), in the order and conventions of ``Estimate.cov``."""
    k, e = truth.camera, estimate.camera
    R = truth.T_body_cam[:3, :3]
    return np.concatenate(
        [
            [e.fu - k.fu, e.fv - k.fv, e.cu - k.cu, e.cv - k.cv, e.kr - k.kr],
            [estimate.rR - truth.rR, estimate.rL - truth.rL, estimate.b - truth.b],
            log_so3(R.T @ estimate.T_body_cam[:3, :3]),
            estimate.T_body_cam[:3, 3] - truth.T_body_cam[:3, 3],
        ]
    )


def _state(problem: Problem, truth: Truth) -> State:
    k = truth.camera
    poses = np.concatenate(truth.stop_poses)
    return resting(
        problem,
        lens=first_values(problem.lens, np.array([k.fu, k.fv, k.cu, k.cv, k.kr])),
        wheels=np.array([truth.rR, truth.rL, truth.b]),
        T_body_cam=truth.T_body_cam,
        poses=poses,
    )
