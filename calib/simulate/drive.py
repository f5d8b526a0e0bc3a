"""A simulated drive: stop, drive on, stop again; what the encoders read and where the robot truly was."""

from dataclasses import dataclass, replace
from math import radians

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.imperfections import Imperfections, WheelFaults
from boxcal.calib.simulate.kinematics import slipped, wheel_turns, within_arc
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.rolling import driven_path, rolled
from boxcal.calib.simulate.route import KeepOut, route
from boxcal.calib.simulate.scene import Scene, make_scene
from boxcal.calib.simulate.viewpoints import choose_stops, decodable_tags
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, Target
from boxcal.target.camera.camera_model import project

_NS = 1e9
_EXACT_SIGMA_PX = 1e-6
"""Sigma that exact pixels are given, since a covariance must not vanish."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions:
    """Options of a simulated drive: stops, speeds, slip and encoders.

    Attributes
    ----------
    stops
        How many.
    encoder_step : rad
        Readings are rounded down to a multiple of it; 0 reads exactly.
    joint_period_s : s
        Between two wheel samples.
    steps_per_sample
        The wheels' speeds are constant within ``joint_period_s / steps_per_sample``. With 1, arcs over the samples
        give the true path.
    slip : m per sqrt(m)
        Standard deviation of the distance that a wheel moves over the floor, where it rolled 1 m.
    max_speed : m/s
        Of a wheel's rim.
    stand_s : s
        Shortest and longest time at a stop.
    clearance : m
        How far the robot's outermost part stays off the box.
    t0_ns : ns
        When the drive begins.
    """

    stops: int = 10
    encoder_step: float = radians(0.1302)
    joint_period_s: float = 0.02
    steps_per_sample: int = 20
    slip: float = 0.0002
    max_speed: float = 0.3
    stand_s: tuple[float, float] = (1.2, 2.0)
    clearance: float = 0.15
    t0_ns: int = 1_700_000_000_000_000_000


def exact_options(stops: int = 10) -> DriveOptions:
    """Return options for a drive that its samples describe exactly: no slip, no rounding, constant speeds between."""
    return DriveOptions(stops=stops, encoder_step=0.0, slip=0.0, steps_per_sample=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """One drive, as measured and as it was.

    Attributes
    ----------
    t_ns : (S,) int64, ns
        Header stamps of the wheel samples.
    phi_R, phi_L : (S,), rad
        What the encoders read.
    stop_t_ns : (P, 2) int64, ns
        When each stop began and ended.
    stop_poses : (P, 3), m and rad
        True x, y and heading in frame ``box`` at each stop; headings are continuous, not modulo 2 pi.
    stop_phi : (P, 2), rad
        True wheel angles at each stop, right and left.
    T_box_cam : (P, 4, 4), m
        True camera pose at each stop.
    path_t_ns : (M,) int64, ns
        A fine grid of times.
    path : (M, 3), m and rad
        True poses at those times; arcs between.
    scene
        Floor, box and camera at each stop.
    faults
        What was not exact.
    """

    t_ns: Ids
    phi_R: Array
    phi_L: Array
    stop_t_ns: Ids
    stop_poses: Array
    stop_phi: Array
    T_box_cam: Array
    path_t_ns: Ids
    path: Array
    scene: Scene
    faults: Imperfections

    def stop_at(self, t_ns: int) -> int:
        """Return the stop whose scene holds at a time, ns: midway to the next stop the next one's begins."""
        halves = (self.stop_t_ns[:-1, 1] + self.stop_t_ns[1:, 0]) // 2
        return int(np.searchsorted(halves, t_ns, side="right"))

    def T_box_cam_at(self, t_ns: Ids, stop: int) -> Array:
        """Return the camera's poses (N, 4, 4), m, at times (N,), ns, in the scene of a stop."""
        return np.array([self.scene.T_box_cam(stop, pose) for pose in self.pose_at(t_ns)])

    def pose_at(self, t_ns: Ids) -> Array:
        """Return the true poses (N, 3), x, y, heading, at times (N,), ns, within the drive."""
        k = np.clip(np.searchsorted(self.path_t_ns, t_ns, side="right") - 1, 0, len(self.path_t_ns) - 2)
        fraction = (t_ns - self.path_t_ns[k]) / (self.path_t_ns[k + 1] - self.path_t_ns[k])
        return within_arc(self.path[k], self.path[k + 1], np.clip(fraction, 0, 1))


def simulate_drive(
    robot: Robot,
    target: Target,
    options: DriveOptions,
    rng: np.random.Generator,
    stops: Array | None = None,
    *,
    faults: Imperfections | None = None,
) -> Drive:
    """Drive a robot from stop to stop around the box.

    Each leg is planned from where the robot truly stands, so that slip shifts a stop but does not add up.

    Parameters
    ----------
    robot, target, options
        Who drives around what, and how.
    rng
        Draws the stops, the paths between them, the slip and the wheels' first angles.
    stops : (P, 3), m and rad, optional
        Poses (x, y, heading) to stop at, instead of random ones. Paths between them are straights and turns on the
        spot. Headings hold as numbers: 2 pi more is one more turn on the spot.
    faults
        What is not exact; its slip counts instead of the options'. None for a rigid robot that slips by the options.

    Raises
    ------
    CalibError
        If there is no place to see the box from, or a stop was asked for that is too close to it.
    """
    gap = options.clearance + robot.reach
    keep_out = KeepOut.around(target.box, gap)
    goals = choose_stops(robot, target, options.stops, gap, rng) if stops is None else np.asarray(stops, dtype=float)
    _check(goals, keep_out)
    faults = faults or Imperfections(wheels=WheelFaults(slip=options.slip))
    step_s = options.joint_period_s / options.steps_per_sample
    phi = [rng.uniform(-15, 15, (1, 2))]
    path, ends, before, restarts = [goals[:1]], [[0, 0]], np.zeros(2), np.zeros((0, 2))
    for j, goal in enumerate(goals):
        if j > 0:
            arcs = route(path[-1][-1], goal, keep_out, rng if stops is None else None, exact_heading=stops is not None)
            turns = wheel_turns(arcs, rR=robot.rR, rL=robot.rL, b=robot.b, max_speed=options.max_speed, step_s=step_s)
            dphi = np.stack(turns, axis=1)
            spread = np.exp(faults.wheels.slip_spread * rng.standard_normal()) if faults.wheels.slip_spread else 1.0
            distance, before = rolled(robot, faults.wheels, phi[-1][-1], dphi, before)
            travel = np.stack([slipped(d, float(spread) * faults.wheels.slip, rng) for d in distance.T], axis=1)
            path.append(driven_path(path[-1][-1], travel, robot.b, faults.wheels, j - 1))
            if faults.wheels.restart is not None and faults.wheels.restart[0] == j - 1:
                restarts = np.array([[ends[-1][1] + len(dphi) // 2, faults.wheels.restart[1]]])
            phi.append(np.cumsum(np.concatenate([phi[-1][-1:], dphi]), axis=0)[1:])
        stand = max(round(rng.uniform(*options.stand_s) / step_s), 1)
        begun = ends[-1][1] + len(phi[-1]) * (j > 0)
        for part in (phi, path):
            part.append(np.repeat(part[-1][-1:], stand, axis=0))
        ends.append([begun, begun + stand])
    scene = make_scene(robot, faults, len(goals), rng)
    wheels = _Wheels(phi=np.concatenate(phi), restarts=restarts)
    return _drive(options, faults, scene, wheels, path=np.concatenate(path), ends=np.array(ends[1:]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Wheels:
    """True wheel angles (M, 2), rad, right and left, and where the encoders lost an angle: (step, rad) rows."""

    phi: Array
    restarts: Array


def _check(goals: Array, keep_out: KeepOut) -> None:
    if goals.ndim != 2 or goals.shape[1] != 3 or not len(goals) or not np.all(np.isfinite(goals)):
        raise CalibError(f"stops of shape {goals.shape}: (P, 3) finite numbers x, y, heading are needed")
    off = keep_out.off_box(goals[:, :2])
    if off.min() < keep_out.gap - 1e-9:
        raise CalibError(
            f"stop {int(off.argmin())}: lies {off.min():.3f} m off the box, {keep_out.gap:.3f} m are needed",
            remedy="move it away or reduce the clearance",
        )


def _drive(
    options: DriveOptions, faults: Imperfections, scene: Scene, wheels: _Wheels, *, path: Array, ends: Ids
) -> Drive:
    step_ns = options.joint_period_s / options.steps_per_sample * _NS
    t_ns = options.t0_ns + np.rint(np.arange(len(path)) * step_ns).astype(np.int64)
    at = slice(None, None, options.steps_per_sample)
    seen = wheels.phi.copy()
    for row, lost in wheels.restarts:
        seen[int(row) :] -= lost
    step = options.encoder_step if faults.wheels.encoder_step is None else faults.wheels.encoder_step
    read = _read(seen[at], step) * faults.wheels.counts
    poses = path[ends[:, 0]]
    return Drive(
        t_ns=t_ns[at],
        phi_R=read[:, 0].copy(),
        phi_L=read[:, 1].copy(),
        stop_t_ns=t_ns[ends],
        stop_poses=poses,
        stop_phi=wheels.phi[ends[:, 0]],
        T_box_cam=np.stack([scene.T_box_cam(j, pose) for j, pose in enumerate(poses)]),
        path_t_ns=t_ns,
        path=path,
        scene=scene,
        faults=faults,
    )


def _read(phi: Array, step: float) -> Array:
    return phi if step == 0 else np.asarray(np.floor(phi / step) * step)


def exact_correspondences(
    robot: Robot, target: Target, drive: Drive, sigma_px: float = 0.0, rng: np.random.Generator | None = None
) -> Correspondences:
    """Return what a perfect detector would extract from the drive's log: no images are made.

    Parameters
    ----------
    robot, target, drive
        Who drove around what, and the drive.
    sigma_px : px
        Standard deviation of the noise on each pixel coordinate; it also sets ``cov_px2`` (with 0, that of 1e-6 px).
    rng
        Source of the noise; needed if there is any.
    """
    if sigma_px > 0 and rng is None:
        raise CalibError(f"noise of {sigma_px:g} px was asked for without a random generator", remedy="pass rng")
    stops = []
    for (t_start, t_end), T_box_cam, camera in zip(drive.stop_t_ns, drive.T_box_cam, drive.scene.cameras, strict=True):
        first = int(np.searchsorted(drive.t_ns, t_start, side="left"))
        last = int(np.searchsorted(drive.t_ns, t_end, side="right")) - 1
        ids = decodable_tags(replace(robot, camera=camera), target, T_box_cam)
        p_box = target.tag_corners[np.searchsorted(target.tag_ids, ids)].reshape(-1, 3)
        T_cam_box = inverse(T_box_cam)
        uv_px = project(camera, p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        if sigma_px > 0 and rng is not None:
            uv_px = uv_px + sigma_px * rng.standard_normal(uv_px.shape)
        stops.append(
            StopObservation(
                t_start_ns=int(t_start),
                t_end_ns=int(t_end),
                first_sample=first,
                last_sample=last,
                phi_R=float(drive.phi_R[first]),
                phi_L=float(drive.phi_L[first]),
                landmark_ids=(CORNERS * ids[:, None] + np.arange(CORNERS)).ravel(),
                p_box=p_box,
                uv_px=uv_px,
                cov_px2=np.broadcast_to(np.eye(2) * max(sigma_px, _EXACT_SIGMA_PX) ** 2, (len(p_box), 2, 2)).copy(),
                frames=1,
            )
        )
    return Correspondences(
        robot=robot.name,
        image_size=robot.image_size,
        wheels=WheelSamples(t_ns=drive.t_ns, phi_R=drive.phi_R, phi_L=drive.phi_L),
        stops=tuple(stops),
    )
