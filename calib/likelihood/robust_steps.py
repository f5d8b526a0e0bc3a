"""The four steps from consecutive stops alone, for drives that spoil too many pairs of stops for the paper's procedure.

Strong slip, a robot that was lifted or a box that moved touches one leg between consecutive stops, but every pair of
stops across it. What the likelihood starts from (:mod:`boxcal.calib.likelihood.initial_guess`) is robust against such
legs, and takes the place of steps 2 and 4 where these fail.
"""

from dataclasses import replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.four_steps.step1_camera import CameraStep
from boxcal.calib.four_steps.step2_heading import HeadingStep
from boxcal.calib.four_steps.step3_axis import find_axis
from boxcal.calib.four_steps.step4_mounting import MountingStep, mounting_equations
from boxcal.calib.geometry.diff_drive import legs_between, unit_path
from boxcal.calib.geometry.so3_se3 import inverse, rot_y, rot_z, wrap
from boxcal.calib.likelihood.initial_guess import CameraStart, first_states
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.likelihood.state import State
from boxcal.detect.correspondences import Correspondences


def robust_steps(drive: Correspondences, camera: CameraStep, why: str) -> FourSteps:
    """Return the calibration of one robot from consecutive stops, robust against faulty legs.

    Parameters
    ----------
    drive
        What the robot saw at its stops, and what its wheels did between them.
    camera
        Outcome of step 1.
    why
        Why the four steps fail over all pairs of stops.

    Raises
    ------
    CalibError
        If consecutive stops do not determine the calibration either.
    """
    start = CameraStart(camera=camera.camera, kept=(camera.kept,), T_cam_box=camera.T_cam_box)
    problem = build_problem([drive], start.kept, EstimateOptions(), max(drive.wheels.encoder_steps))
    state = first_states(problem, [drive], start)[0]
    if not np.all(state.wheels > 0):
        raise CalibError("consecutive stops fit no wheels that roll forward")
    return replace(_as_steps(drive, camera, state), replaced=why)


def _as_steps(drive: Correspondences, camera: CameraStep, state: State) -> FourSteps:
    """Return a state in the terms of the four steps, with the values of its fit to consecutive stops."""
    axis = find_axis(camera.T_cam_box)
    legs = legs_between(drive, camera.kept)
    rR, rL, b = (float(w) for w in state.wheels)
    i = np.arange(len(camera.kept) - 1)
    phi = np.diff(np.stack([legs.phi_R, legs.phi_L], axis=1), axis=0)
    turn = -axis.theta[i, i + 1]
    singular = np.linalg.svd(phi, compute_uv=False)
    heading = HeadingStep(
        aR=rR / b,
        aL=-rL / b,
        rms=float(np.sqrt(np.mean(wrap(turn - phi @ (rR / b, -rL / b)) ** 2))),
        condition=float(singular[0] / singular[1]),
    )
    xy, angle = unit_path(legs, heading.aR, heading.aL)
    c, s, d = np.cos(angle[:-1]), np.sin(angle[:-1]), np.diff(xy, axis=0)
    beta = np.stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]], axis=1)
    t = (camera.T_cam_box[1:] @ inverse(camera.T_cam_box)[:-1])[:, :3, 3]
    u = (t @ (rot_y(axis.a2) @ rot_z(axis.a3)).T)[:, :2]
    R, (tx, ty, _) = state.T_body_cam[:3, :3], (float(x) for x in state.T_body_cam[:3, 3])
    yaw = R @ (rot_y(axis.a2) @ rot_z(axis.a3)).T
    a1 = float(np.arctan2(yaw[1, 0], yaw[0, 0]))
    rows = mounting_equations(beta, -turn, u)
    left = rows @ (rL, tx, ty, np.cos(a1), np.sin(a1))
    mounting = MountingStep(
        rR=rR,
        rL=rL,
        b=b,
        a1=a1,
        tx=tx,
        ty=ty,
        singular_values=np.asarray(np.linalg.svd(rows, compute_uv=False), dtype=np.float64),
        rms=float(np.sqrt(np.sum(left**2) / len(u))),
    )
    return FourSteps(camera=camera, axis=axis, heading=heading, mounting=mounting, T_body_cam=state.T_body_cam)
