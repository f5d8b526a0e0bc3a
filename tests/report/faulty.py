"""Simulated drives, faultless and with one fault each, and their calibrations."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.detail import ORDER, Covariance, Detail, Ground, Growth, HeldOut, Leg
from calib.estimate.result import Estimate
from calib.estimate.run import estimate
from calib.four_steps import solve_four_steps
from calib.frames import Array, inverse, log_so3, planar
from calib.odometry import legs_between
from calib.result import Calibration, Provenance, Quality, StopResult, Wheels
from calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from calib.simulate.robot import Robot, turtlebot
from detect.correspondences import Correspondences, Source
from target.box import Target, make_target
from target.measured import Measured

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


def calibrated(drive: Correspondences, *, growth: Sequence[int] = (), held_out: Sequence[int] = ()) -> Calibration:
    """The likelihood's calibration of a drive, with all that a report can show."""
    steps = solve_four_steps(drive)
    found = estimate([drive], steps)
    d = found.drives[0]
    stops = tuple(
        StopResult(
            t_start_ns=drive.stops[j].t_start_ns,
            t_end_ns=drive.stops[j].t_end_ns,
            landmarks=len(drive.stops[j].landmark_ids),
            reprojection_rms_px=float(rms),
            T_box_cam=T @ found.T_body_cam,
        )
        for j, rms, T in zip(d.stops, d.stop_rms_px, d.T_box_body, strict=True)
    )
    return Calibration(
        robot=drive.robot,
        image_size=drive.image_size,
        camera=found.camera,
        wheels=Wheels(rR=found.rR, rL=found.rL, b=found.b),
        T_body_cam=found.T_body_cam,
        quality=Quality(
            stops=len(stops),
            landmarks=sum(s.landmarks for s in stops),
            reprojection_rms_px=float(np.sqrt(np.mean(d.stop_rms_px**2))),
            heading_rms_rad=steps.heading.rms,
            sigma5_sigma4=steps.mounting.null_ratio,
            sigma4_sigma3=steps.mounting.rank_ratio,
            up_error_rad=float(np.hypot(*d.tilt)),
        ),
        stops=stops,
        notes=found.notes,
        provenance=Provenance(
            version="0.1.0",
            command=f"fleet-calibrate robots/{drive.robot}.mcap",
            created="2026-01-02T03:04:05+00:00",
            inputs={drive.source.log: drive.source.sha256, "target": drive.source.target_sha256},
            settings={"camera_mode": "joint", "topics": {"camera_topic": None}},
        ),
        method="likelihood",
        detail=detail_of(found, drive, growth=growth, held_out=held_out),
    )


def detail_of(
    found: Estimate, drive: Correspondences, *, growth: Sequence[int] = (), held_out: Sequence[int] = ()
) -> Detail:
    """An estimate in the report's terms; growth re-estimates, held-out stops are made up."""
    d = found.drives[0]
    travel = legs_between(drive, d.stops)
    phi = np.diff(np.stack([travel.phi_R, travel.phi_L], axis=1), axis=0)
    rolled, turned = phi @ [found.rR / 2, found.rL / 2], phi @ [found.rR / found.b, -found.rL / found.b]
    legs = tuple(
        Leg(
            drive=0,
            start=a,
            end=b,
            t_start_ns=drive.stops[a].t_end_ns,
            t_end_ns=drive.stops[b].t_start_ns,
            rolled=float(abs(rolled[k])),
            turned=float(turned[k]),
            residual=tuple(float(v) for v in d.leg_residuals[k]),  # type: ignore[arg-type]
            p_value=float(d.leg_p_values[k]),
            used=bool(d.leg_used[k]),
        )
        for k, (a, b) in enumerate(zip(d.stops[:-1], d.stops[1:], strict=True))
    )
    extra = dict(zip(found.names[14:], found.values[14:].tolist(), strict=True))
    rng = np.random.default_rng(1)
    sigma = (0.002, 0.003, 0.006)
    return Detail(
        covariance=Covariance(matrix=found.cov),
        noise=found.noise,
        lens=str(found.lens),
        lens_extra=found.lens_extra,
        extra=extra,
        extra_sigma=found.extra_sigma,
        legs=legs,
        flagged_legs=found.flagged_legs,
        flagged_corners=found.flagged_corners,
        directions=found.directions,
        ground=ground_of(found),
        held_out=tuple(
            HeldOut(drive=0, stop=j, error=tuple(rng.normal(0, sigma).tolist()), sigma=sigma) for j in held_out
        ),
        growth=tuple(growth_point(drive, count, found) for count in growth),
    )


def growth_point(drive: Correspondences, count: int, final: Estimate) -> Growth:
    """The estimate from the first stops."""
    part = replace(drive, stops=drive.stops[:count])
    e = estimate([part])
    off = log_so3(final.T_body_cam[:3, :3].T @ e.T_body_cam[:3, :3])
    k = e.camera
    values = [k.fu, k.fv, k.cu, k.cv, k.kr, e.rR, e.rL, e.b, *off, *e.T_body_cam[:3, 3]]
    return Growth(stops=count, values=tuple(map(float, values)), sigma=tuple(e.sigma[name] for name in ORDER))


def ground_of(found: Estimate, distance: float = 10.0) -> Ground:
    """What the wheels' covariance means on the ground."""
    cov: Array = found.cov[5:8, 5:8]
    by_wheels = np.array([1 / found.rR, 1 / found.rL, 1 / found.b])
    along = distance * by_wheels * (0.5, 0.5, 0)
    heading = distance / found.b * by_wheels * (1, -1, 0)
    turn = 2 * np.pi * by_wheels * (0.5, 0.5, -1)

    def var(g: Array) -> float:
        return float(g @ cov @ g) if np.all(np.isfinite(cov)) else np.inf

    return Ground(
        straight_heading=var(heading) ** 0.5,
        straight_position=(var(along) + var(heading * distance / 2)) ** 0.5,
        turn_heading=var(turn) ** 0.5,
        distance=2.0,
        projection_mean_px=0.2,
        projection_worst_px=0.5,
    )
