"""Simulated drives, faultless and with one fault each, and their calibrations."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import inverse, log_so3, planar
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.results.build import refined
from boxcal.calib.results.calibration import Calibration, Provenance
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import Robot, turtlebot
from boxcal.calib.uncertainty.convergence_point import ConvergencePoint
from boxcal.calib.uncertainty.cross_validation import validate
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.source import Source
from boxcal.target.box import Target, make_target
from boxcal.target.measure.measured_size import Measured

SIGMA_PX = 0.15
TARGET = make_target()
ROBOT = turtlebot("r01")


def good_drive(stops: int = 14, seed: int = 3, robot: Robot = ROBOT) -> Correspondences:
    """A drive all round the box, nothing wrong."""
    rng = np.random.default_rng(seed)
    drive = simulate_drive(robot, TARGET, DriveOptions(stops=stops, slip=0.0003), rng)
    return _seen(robot, drive, rng)


def few_stops(seed: int = 5) -> Correspondences:
    """Four stops only."""
    return good_drive(stops=4, seed=seed)


def one_side(seed: int = 7) -> Correspondences:
    """Twelve stops before face 0."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(-0.5, 0.5, 12)
    radius = rng.uniform(0.5, 0.8, 12)
    heading = around + np.pi + rng.uniform(-0.25, 0.25, 12)
    stops = np.stack([radius * np.cos(around), radius * np.sin(around), heading], axis=1)
    return _seen(ROBOT, simulate_drive(ROBOT, TARGET, DriveOptions(slip=0.0003), rng, stops), rng)


def no_turn(seed: int = 8) -> Correspondences:
    """Ten stops before face 0, all with one heading."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.5, 0.8, 10), rng.uniform(-0.08, 0.08, 10)
    stops = np.stack([x, y, np.full(10, np.pi)], axis=1)
    return _seen(ROBOT, simulate_drive(ROBOT, TARGET, DriveOptions(slip=0.0003), rng, stops), rng)


def slipped(seed: int = 3) -> Correspondences:
    """The right wheel spins by half a radian in the middle of the sixth leg."""
    drive = good_drive(seed=seed)
    at = (drive.stops[5].last_sample + drive.stops[6].first_sample) // 2
    phi_R = drive.wheels.phi_R.copy()
    phi_R[at:] += 0.5
    stops = [replace(s, phi_R=s.phi_R + 0.5 * (s.first_sample > at)) for s in drive.stops]
    return replace(drive, wheels=replace(drive.wheels, phi_R=phi_R), stops=tuple(stops))


def box_moved(seed: int = 3) -> Correspondences:
    """Somebody pushes the box after the seventh stop."""
    rng = np.random.default_rng(seed)
    drive = simulate_drive(ROBOT, TARGET, DriveOptions(stops=14, slip=0.0003), rng)
    T = drive.T_box_cam.copy()
    T[7:] = inverse(planar(0.03, -0.02, np.radians(4.0))) @ T[7:]
    return _seen(ROBOT, replace(drive, T_box_cam=T), rng)


def wrong_print(seed: int = 3) -> Correspondences:
    """The sheets came out 1 % too wide."""
    rng = np.random.default_rng(seed)
    drive = simulate_drive(ROBOT, TARGET, DriveOptions(stops=14, slip=0.0003), rng)
    box = TARGET.box
    size = Measured(sx=1.01, sy=1.0, width=box.width, depth=box.depth, height=box.height, cov=np.eye(5) * 1e-12)
    seen = _seen(ROBOT, drive, rng, printed=make_target(box, size))
    stops = [replace(s, p_box=TARGET.p_box(s.landmark_ids)) for s in seen.stops]
    return replace(seen, stops=tuple(stops))


def blurred(seed: int = 3) -> Correspondences:
    """Corners err by 1.2 px."""
    rng = np.random.default_rng(seed)
    drive = simulate_drive(ROBOT, TARGET, DriveOptions(stops=14, slip=0.0003), rng)
    return _seen(ROBOT, drive, rng, sigma_px=1.2)


def swapped_wheels(seed: int = 3) -> Correspondences:
    """Left and right joint are taken for one another."""
    drive = good_drive(seed=seed)
    w = drive.wheels
    stops = [replace(s, phi_R=s.phi_L, phi_L=s.phi_R) for s in drive.stops]
    return replace(drive, wheels=replace(w, phi_R=w.phi_L, phi_L=w.phi_R), stops=tuple(stops))


def _seen(
    robot: Robot, drive: object, rng: np.random.Generator, sigma_px: float = SIGMA_PX, printed: Target = TARGET
) -> Correspondences:
    seen = exact_correspondences(robot, printed, drive, sigma_px, rng)  # type: ignore[arg-type]
    return replace(seen, source=Source(log=f"{robot.name}.mcap", sha256="ab" * 32, target_sha256="cd" * 32))


def calibrated(
    *drives: Correspondences, growth: Sequence[int] = (), held_out: bool = False, options: EstimateOptions | None = None
) -> Calibration:
    """The likelihood's calibration of drives, with all that a report can show."""
    steps = [solve_four_steps(drive) for drive in drives]
    found = estimate(drives, steps, options)
    first = drives[0]
    provenance = Provenance(
        version="0.1.0",
        command=f"fleet-calibrate robots/{first.robot}.mcap",
        created="2026-01-02T03:04:05+00:00",
        inputs={first.source.log: first.source.sha256, "target": first.source.target_sha256},
        settings={"camera_mode": "joint", "topics": {"camera_topic": None}},
    )
    return refined(
        first.robot,
        drives,
        steps,
        found,
        provenance,
        validation=validate(drives, steps, options) if held_out else None,
        growth=tuple(growth_point(first, count, found) for count in growth),
    )


def growth_point(drive: Correspondences, count: int, final: Estimate) -> ConvergencePoint:
    """The estimate from the first stops."""
    part = replace(drive, stops=drive.stops[:count])
    e = estimate([part])
    off = log_so3(final.T_body_cam[:3, :3].T @ e.T_body_cam[:3, :3])
    k = e.camera
    values = [k.fu, k.fv, k.cu, k.cv, k.kr, e.rR, e.rL, e.b, *off, *e.T_body_cam[:3, 3]]
    return ConvergencePoint(stops=count, values=tuple(map(float, values)), sigma=tuple(e.sigma[name] for name in ORDER))
