"""Robots with two cameras of three kinds, their drives, and what both numbers of a comparison are made from."""

from collections.abc import Callable
from dataclasses import replace
from math import atan2, radians, tan

import numpy as np

from boxcal.calib.likelihood import CameraKind
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.simulate.drive import Drive, DriveOptions, simulate_drive
from boxcal.calib.simulate.more_cameras import with_camera_at
from boxcal.calib.simulate.robot import Robot, mount, random_robot
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel

STOPS, SIGMA_PX, SLIP, CLEARANCE = 20, 0.1, 3e-4, 0.15
LEAST_TAGS = 4
Kind = Callable[[np.random.Generator], tuple[Robot, Robot]]


def ahead_and_behind(rng: np.random.Generator) -> tuple[Robot, Robot]:
    """Return a robot with its camera ahead, and with one of another lens behind."""
    first = _looking_ahead(rng)
    z = rng.uniform(0.08, 0.25)
    place = mount(
        yaw=radians(180 + rng.uniform(-8, 8)),
        pitch=atan2(z - 0.1, 0.6) + radians(rng.uniform(-4, 4)),
        x=-rng.uniform(0.02, 0.08),
        y=rng.uniform(-0.02, 0.02),
        z=z,
    )
    return first, with_camera_at(first, place, replace(first.camera, fu=480.0, fv=482.0, kr=-0.1))


def stereo(rng: np.random.Generator) -> tuple[Robot, Robot]:
    """Return a robot with its left and with its right camera, 60 mm apart."""
    first = _looking_ahead(rng)
    offset = np.eye(4)
    offset[:3, 3] = 0.06, *rng.normal(0, 5e-4, 2)
    other = replace(first.camera, fu=first.camera.fu * 1.01, fv=first.camera.fv * 1.01, kr=first.camera.kr - 0.02)
    return first, with_camera_at(first, first.T_body_cam @ offset, other)


def narrow_and_wide(rng: np.random.Generator) -> tuple[Robot, Robot]:
    """Return a robot with a lens of 30 deg across, and with a fisheye lens of 120 deg beside it."""
    first = _looking_ahead(rng)
    f = (first.image_size[0] / 2) / tan(radians(15))
    first = replace(first, camera=replace(first.camera, fu=f, fv=f * 1.002, kr=-0.05))
    f = (first.image_size[0] / 2) / radians(60)
    wide = CameraModel(
        fu=f, fv=f * 1.003, cu=321.0, cv=238.0, kr=0.02, k2=-0.008, k3=0.002, k4=-4e-4, kind=CameraKind.FISHEYE
    )
    offset = np.eye(4)
    offset[:3, 3] = rng.uniform(0.02, 0.05), 0.0, 0.0
    return first, with_camera_at(first, first.T_body_cam @ offset, wide)


def _looking_ahead(rng: np.random.Generator) -> Robot:
    while True:
        robot = random_robot("robot", rng)
        if robot.T_body_cam[0, 2] > 0.8:
            return robot


KINDS: dict[str, Kind] = {
    "ahead and behind": ahead_and_behind,
    "stereo, 60 mm": stereo,
    "30 and 120 deg": narrow_and_wide,
}


def driven(robots: tuple[Robot, Robot], rng: np.random.Generator) -> Drive:
    """Return a drive whose stops show the box to the one camera and to the other by turns."""
    target, gap = make_target(), CLEARANCE + max(robot.reach for robot in robots)
    stops = np.empty((STOPS, 3))
    for k, robot in enumerate(robots):
        stops[k::2] = choose_stops(robot, target, STOPS // 2, gap, rng)
    return simulate_drive(robots[0], target, DriveOptions(stops=STOPS, slip=SLIP), rng, stops=stops)


def found_wheels(found: Estimate) -> Array:
    return np.array([found.rR, found.rL, found.b])


def true_wheels(robot: Robot) -> Array:
    return np.array([robot.rR, robot.rL, robot.b])


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def whitened(error: Array, cov: Array) -> Array:
    """Return errors (n,) in units of their covariance (n, n): independent, each of standard deviation 1."""
    scale = np.sqrt(np.diag(cov))
    return np.asarray(np.linalg.solve(np.linalg.cholesky(cov / np.outer(scale, scale)), error / scale))


def of_one(errors: list[Array]) -> str:
    """Return the root mean square of whitened errors and by how many standard deviations of chance it is off 1."""
    square = np.concatenate([e.ravel() for e in errors]) ** 2
    off = (square.mean() - 1) / np.sqrt(2 / len(square))
    return f"{np.sqrt(square.mean()):.3f} (rms; {off:+.1f} sigma from 1)"
