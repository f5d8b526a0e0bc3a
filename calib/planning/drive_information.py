"""Information of a drive in progress, about the estimate that was made from it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, rigid
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.levenberg_marquardt import Weights, equations, leg_information, linearize
from boxcal.calib.likelihood.normal_equations import Normal, eliminate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import PER_STOP, Problem, build_problem
from boxcal.calib.likelihood.state import State, resting
from boxcal.calib.planning.assumptions import Assumptions, Model
from boxcal.calib.simulate.robot import Robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import Target


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveInformation:
    """Information of a drive about shared unknowns and the stop where the robot stands.

    Attributes
    ----------
    model
        Robot, box and noise as the drive told them.
    names : n
        Shared unknowns.
    chain : (n + 5, n + 5)
        Information on them and on the last stop's x, y, heading and encoder errors.
    poses : (P, 3), m and rad
        Stops so far; the robot stands at the last one.
    """

    model: Model
    names: tuple[str, ...]
    chain: Array
    poses: Array


def information_of(
    estimate: Estimate, drives: Sequence[Correspondences], target: Target, robot: str = ""
) -> DriveInformation:
    """Return what drives have told, about the estimate that was made from them; nothing is solved anew.

    Parameters
    ----------
    estimate
        Made from the drives; its noise levels count.
    drives
        In their order; the robot stands at the last stop of the last one.
    target
        The box.
    robot
        Name for messages.
    """
    options = EstimateOptions(lens=estimate.camera.kind, target=target)
    kept = [drive.stops for drive in estimate.drives]
    problem = build_problem(drives, kept, options, estimate.noise.encoder_step)
    poses = np.concatenate([_floor_poses(d.T_box_body, d.tilt) for d in estimate.drives])
    values = dict(zip(estimate.names, estimate.values, strict=True))
    state = resting(
        problem,
        lens=estimate.camera.values,
        wheels=np.array([estimate.rR, estimate.rL, estimate.b]),
        T_body_cam=estimate.T_body_cam,
        poses=poses,
    )
    state = replace(
        state,
        tilt=np.array([d.tilt for d in estimate.drives]),
        shape=np.array([values.get(name, 0.0) for name in problem.target.names]),
    )
    used = np.concatenate([np.zeros(0, dtype=np.bool_), *(d.leg_used for d in estimate.drives)])
    corners = np.ones(len(problem.uv_px))
    for flagged in estimate.flagged_corners:
        row = int(np.flatnonzero((problem.drive == flagged.drive) & (problem.stop == flagged.stop))[0])
        ids = drives[flagged.drive].stops[flagged.stop].landmark_ids
        corners[problem.corner_starts[row] + int(np.searchsorted(ids, flagged.landmark_id))] = 0.0
    model = Model(
        robot=Robot(
            name=robot or drives[0].robot,
            camera=estimate.camera,
            image_size=drives[0].image_size,
            rR=estimate.rR,
            rL=estimate.rL,
            b=estimate.b,
            T_body_cam=estimate.T_body_cam,
        ),
        target=target,
        assumptions=replace(
            Assumptions(),
            corner_px=estimate.noise.pixel_px,
            encoder_step=estimate.noise.encoder_step,
            min_side_px=Assumptions().min_side_px,
        ),
        components=replace(estimate.components, noise_scale=1.0),
        options=options,
    )
    chain = _chain(problem, state, estimate.components, Weights(corners=corners, legs=used.astype(np.float64)))
    return DriveInformation(model=model, names=problem.names, chain=chain, poses=poses)


def _floor_poses(T_box_body: Array, tilt: Array) -> Array:
    """Return x, y, heading (P, 3) on a floor that is tilted against the box."""
    T = inverse(rigid(exp_so3(np.array([*tilt, 0.0])), np.zeros(3))) @ T_box_body
    return np.stack([T[:, 0, 3], T[:, 1, 3], np.arctan2(T[:, 1, 0], T[:, 0, 0])], axis=1)


def _chain(problem: Problem, state: State, components: VarianceComponents, weights: Weights) -> Array:
    """Return the information of shared unknowns and the last stop."""
    at = linearize(problem, state, weights)
    information = leg_information(problem, at.legs, weights, np.array(components.slip))
    normal, _ = equations(problem, at, components, information)
    return last_stop_information(eliminate(normal)[0])


def last_stop_information(normal: Normal) -> Array:
    """Return the information (n + 5, n + 5) of shared unknowns and the last stop, all stops before eliminated.

    Parameters
    ----------
    normal
        Normal equations without local unknowns.
    """
    n, P = normal.A.shape[-1], len(normal.D)
    A, B, D = normal.A.copy(), normal.B[0], normal.D[0]
    for i in range(P - 1):
        gain = np.linalg.solve(D, np.concatenate([B.T, normal.E[i]], axis=1))
        A -= B @ gain[:, :n]
        B = normal.B[i + 1] - B @ gain[:, n:]
        D = normal.D[i + 1] - normal.E[i].T @ gain[:, n:]
    out = np.empty((n + PER_STOP, n + PER_STOP))
    out[:n, :n], out[:n, n:], out[n:, :n], out[n:, n:] = A, B, B.T, D
    return out
