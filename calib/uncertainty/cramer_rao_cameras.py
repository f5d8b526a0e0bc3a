"""Cramer-Rao bound of a drive of a robot with several cameras, at the truth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.geometry.parameters import MOUNTING, TRANSLATION, WHEELS
from boxcal.calib.likelihood.cameras.equations import Levels, about
from boxcal.calib.likelihood.cameras.problem import Together, together
from boxcal.calib.likelihood.cameras.row import one_row
from boxcal.calib.likelihood.cameras.state import Mounted, RobotState
from boxcal.calib.likelihood.levenberg_marquardt import Weights, equations, leg_information
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.likelihood.slip_profile import quiet_slip
from boxcal.calib.likelihood.state import resting
from boxcal.calib.likelihood.stop_elimination import solve
from boxcal.calib.uncertainty.cramer_rao import NO_SLIP, Truth
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


def cramer_rao_cameras(
    drives: Sequence[Correspondences], truths: Sequence[Truth], options: EstimateOptions | None = None
) -> Array:
    """Return the smallest covariance of wheels and extrinsics, (3 + 6 C, 3 + 6 C), all stops used, levels known.

    Parameters
    ----------
    drives
        One drive as each camera saw it.
    truths
        The truth of each camera, with the poses of the stops that it saw; wheels and levels are those of the first.
    options
        The estimator's; each camera's model is its true one.
    """
    options = options or EstimateOptions()
    first = truths[0]
    kept = [[range(len(drive.stops))] for drive in drives]
    problems = [
        build_problem([d], [tuple(k[0])], replace(options, lens=t.camera.kind), first.encoder_step)
        for d, k, t in zip(drives, kept, truths, strict=True)
    ]
    row = one_row([[drive] for drive in drives], kept)
    robot = together(problems, [np.ones(len(p.uv_px)) for p in problems], row, options)
    state = _state(robot, truths)
    here = about(robot, state, [t.noise_scale for t in truths])
    slip = max(first.slip, NO_SLIP * quiet_slip(robot.problem, here.at))
    levels = Levels(
        noise_scale=1.0,
        slip=slip,
        lean=first.lean,
        height=first.height,
        target=dict(first.target),
        scales=tuple(t.noise_scale for t in truths),
    )
    legs = Weights(corners=np.zeros(0), legs=robot.problem.leg_known.astype(np.float64))
    information = leg_information(robot.problem, here.at.legs, legs, np.array(slip))
    cov = solve(equations(robot.problem, here.at, levels, information)[0]).cov
    turn = np.eye(len(cov))
    for part, truth in zip(robot.parts, truths, strict=True):
        at = part.columns[TRANSLATION]
        turn[np.ix_(at, at)] = truth.T_body_cam[:3, :3]
    rows = np.concatenate([robot.parts[0].columns[WHEELS], *(part.columns[MOUNTING] for part in robot.parts)])
    return np.asarray((turn @ cov @ turn.T)[np.ix_(rows, rows)])


def _state(robot: Together, truths: Sequence[Truth]) -> RobotState:
    first, P = truths[0], len(robot.problem.drive)
    poses = np.zeros((P, 3))
    for part, truth in zip(robot.parts, truths, strict=True):
        poses[part.places] = np.concatenate(truth.stop_poses)
    body = resting(
        robot.problem,
        lens=first.camera.values,
        wheels=np.array([first.rR, first.rL, first.b]),
        T_body_cam=first.T_body_cam,
        poses=poses,
    )
    cameras = [
        Mounted(lens=t.camera.values, T_body_cam=t.T_body_cam, common_growth=0.0, growth=np.zeros(P)) for t in truths
    ]
    return RobotState(body=replace(body, explained=np.zeros(robot.causes)), cameras=tuple(cameras))
