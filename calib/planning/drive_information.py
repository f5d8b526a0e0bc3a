"""Information of a drive in progress, about the estimate that was made from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, rigid
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.estimate import Estimate, NoiseLevels
from boxcal.calib.likelihood.estimator import LEGS_FOR_SLIP
from boxcal.calib.likelihood.levenberg_marquardt import Weights, equations, leg_information, linearize
from boxcal.calib.likelihood.normal_equations import Normal, eliminate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import PER_STOP, Problem, build_problem
from boxcal.calib.likelihood.state import State, resting
from boxcal.calib.planning.assumptions import Assumptions, Model, vague_sigma
from boxcal.calib.results.calibration import Calibration, StopResult
from boxcal.calib.simulate.robot import Robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Mask
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveInformation:
    """Information of a drive about shared unknowns and the stop where the robot stands.

    Attributes
    ----------
    model
        Robot, box and noise as the drive determined them.
    names : n
        Shared unknowns.
    chain : (n + 5, n + 5)
        Information on them and on the last stop's x, y, heading and encoder errors.
    poses : (P, 3), m and rad
        Stops so far; the robot stands at the last one.
    slip_doubt
        Standard deviation of the wheels' slip over its value, on which the wheels' information depends; None if it was
        assumed.
    """

    model: Model
    names: tuple[str, ...]
    chain: Array
    poses: Array
    slip_doubt: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solved:
    """Result about which a drive's information is taken; made from an estimate or from a calibration.

    Attributes
    ----------
    camera, rR, rL, b, T_body_cam
        Camera, wheels and extrinsics.
    stops
        For each drive the numbers of the stops used.
    T_box_body
        For each drive (P, 4, 4), m, where the body was.
    tilt : (D, 2), rad
        Of each drive's floor.
    legs_used
        For each drive (P - 1,), which legs counted.
    values
        Values of further shared unknowns by name.
    flagged
        Corners left out: drive, stop and landmark.
    components
        Variance components.
    corner_px, encoder_step : px, rad
        Noise of corners; 0 for encoders without steps.
    slip_spread
        Standard deviation of the slip over its mean; 0 where it was given or assumed.
    """

    camera: CameraModel
    rR: float
    rL: float
    b: float
    T_body_cam: Array
    stops: tuple[tuple[int, ...], ...]
    T_box_body: tuple[Array, ...]
    tilt: Array
    legs_used: tuple[Mask, ...]
    values: Mapping[str, float]
    flagged: tuple[tuple[int, int, int], ...]
    components: VarianceComponents
    corner_px: float
    encoder_step: float
    slip_spread: float

    @property
    def slip_doubt(self) -> float | None:
        """Standard deviation of the slip over its value; None where the legs are too few to estimate it."""
        if sum(int(used.sum()) for used in self.legs_used) < LEGS_FOR_SLIP:
            return None
        return self.slip_spread


def solved_by_estimate(estimate: Estimate) -> Solved:
    """Return what an estimate says."""
    return Solved(
        camera=estimate.camera,
        rR=estimate.rR,
        rL=estimate.rL,
        b=estimate.b,
        T_body_cam=estimate.T_body_cam,
        stops=tuple(d.stops for d in estimate.drives),
        T_box_body=tuple(d.T_box_body for d in estimate.drives),
        tilt=np.array([d.tilt for d in estimate.drives]),
        legs_used=tuple(d.leg_used for d in estimate.drives),
        values={name: float(v) for name, v in zip(estimate.names, estimate.values, strict=True)},
        flagged=tuple((c.drive, c.stop, c.landmark_id) for c in estimate.flagged_corners),
        components=estimate.components,
        corner_px=estimate.noise.pixel_px,
        encoder_step=estimate.noise.encoder_step,
        slip_spread=_spread(estimate.noise),
    )


def solved_by_calibration(calibration: Calibration, drives: Sequence[Correspondences]) -> Solved:
    """Return what a calibration says of the drives that it was made from.

    Raises
    ------
    CalibError
        If it is the closed form alone, or was made from other drives.
    """
    detail = calibration.detail
    if detail is None:
        raise CalibError(
            "the closed form alone says nothing of uncertainty",
            source=calibration.robot,
            remedy="calibrate without --closed-form",
        )
    wheels, T_cam_body = calibration.wheels, inverse(calibration.T_body_cam)
    stops = tuple(tuple(_number_of(drive, s.t_start_ns) for s in _of(calibration, d)) for d, drive in enumerate(drives))
    several = len(drives) > 1
    names = [[f"tilt_{axis}_{d + 1}" if several else f"tilt_{axis}" for axis in "xy"] for d in range(len(drives))]
    effects = detail.effects
    return Solved(
        camera=calibration.camera,
        rR=wheels.rR,
        rL=wheels.rL,
        b=wheels.b,
        T_body_cam=calibration.T_body_cam,
        stops=stops,
        T_box_body=tuple(np.array([s.T_box_cam @ T_cam_body for s in _of(calibration, d)]) for d in range(len(drives))),
        tilt=np.array([[detail.extra.get(name, 0.0) for name in pair] for pair in names]),
        legs_used=tuple(
            np.array([leg.used for leg in detail.legs if leg.drive == d], dtype=np.bool_) for d in range(len(drives))
        ),
        values=detail.extra,
        flagged=tuple((c.drive, c.stop, c.landmark_id) for c in detail.flagged_corners),
        components=VarianceComponents(
            noise_scale=detail.noise_scale,
            corner_floor=detail.corner_floor_px / detail.noise_scale,
            slip=detail.noise.slip,
            lean=effects.get("lean_rad", 0.0),
            height=effects.get("height_m", 0.0),
            growth=effects.get("growth_px", 0.0),
            target={
                name: effects[key]
                for name, key in (("print", "print"), ("place", "place_m"), ("turn", "turn_rad"), ("bow", "bow_m"))
                if key in effects
            },
        ),
        corner_px=detail.noise.pixel_px,
        encoder_step=detail.noise.encoder_step,
        slip_spread=_spread(detail.noise),
    )


def _spread(noise: NoiseLevels) -> float:
    return noise.slip_sigma / noise.slip if noise.slip > 0 else 0.0


def _of(calibration: Calibration, drive: int) -> list[StopResult]:
    return [stop for stop in calibration.stops if stop.drive == drive]


def _number_of(drive: Correspondences, t_start_ns: int) -> int:
    for number, stop in enumerate(drive.stops):
        if stop.t_start_ns == t_start_ns:
            return number
    raise CalibError(
        f"no stop of it began at {t_start_ns} ns, as the calibration has it",
        source=drive.source.log or drive.robot,
        remedy="give the drives that the calibration was made from",
    )


def information_of(
    solved: Solved, drives: Sequence[Correspondences], target: Target, robot: str = ""
) -> DriveInformation:
    """Return the information of drives about the result that was made from them; nothing is solved anew.

    Parameters
    ----------
    solved
        Made from the drives; its noise levels count.
    drives
        In their order; the robot stands at the last stop of the last one.
    target
        The box.
    robot
        Name for messages.
    """
    options = EstimateOptions(lens=solved.camera.kind, target=target)
    problem = build_problem(drives, solved.stops, options, solved.encoder_step)
    problem = with_floor(problem, solved.components.corner_floor)
    poses = np.concatenate([_floor_poses(T, t) for T, t in zip(solved.T_box_body, solved.tilt, strict=True)])
    state = resting(
        problem,
        lens=solved.camera.values,
        wheels=np.array([solved.rR, solved.rL, solved.b]),
        T_body_cam=solved.T_body_cam,
        poses=poses,
    )
    shape = np.array([solved.values.get(name, 0.0) for name in problem.target.names])
    used = np.concatenate([np.zeros(0, dtype=np.bool_), *solved.legs_used])
    weights = Weights(corners=_corner_weights(problem, solved, drives), legs=used.astype(np.float64))
    known = Robot(
        name=robot or drives[0].robot,
        camera=solved.camera,
        image_size=drives[0].image_size,
        rR=solved.rR,
        rL=solved.rL,
        b=solved.b,
        T_body_cam=solved.T_body_cam,
    )
    model = Model(
        robot=known,
        target=target,
        assumptions=Assumptions(corner_px=solved.corner_px, encoder_step=solved.encoder_step),
        components=replace(solved.components, noise_scale=1.0),
        options=options,
    )
    chain = _chain(problem, replace(state, tilt=solved.tilt, shape=shape), solved.components, weights)
    n = len(problem.names)
    chain[np.arange(n), np.arange(n)] += 1 / np.square(vague_sigma(problem.names, known))  # what is open stays solvable
    return DriveInformation(model=model, names=problem.names, chain=chain, poses=poses, slip_doubt=solved.slip_doubt)


def _corner_weights(problem: Problem, solved: Solved, drives: Sequence[Correspondences]) -> Array:
    """Return 0 for corners that were left out, 1 for all others."""
    weights = np.ones(len(problem.uv_px))
    for drive, stop, landmark in solved.flagged:
        rows = np.flatnonzero((problem.drive == drive) & (problem.stop == stop))
        for row in rows:
            ids = drives[drive].stops[stop].landmark_ids
            weights[problem.corner_starts[row] + int(np.searchsorted(ids, landmark))] = 0.0
    return weights


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
