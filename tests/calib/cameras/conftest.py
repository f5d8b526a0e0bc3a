from dataclasses import dataclass, replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.imperfections import Imperfections, WheelFaults
from boxcal.calib.simulate.more_cameras import seen_by, with_camera_at
from boxcal.calib.simulate.robot import Robot, mount, turtlebot
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target

STOPS, SIGMA_PX, SLIP = 12, 0.1, 3e-4


@dataclass(frozen=True)
class Rigged:
    """A robot with two cameras, its drive, and what each camera saw of it and gives by itself."""

    robots: tuple[Robot, Robot]
    drive: Drive
    kept: tuple[tuple[int, ...], ...]
    views: tuple[Correspondences, ...]
    fits: tuple[Fit, ...]
    found: tuple[Estimate, ...]


def rigged(robots: tuple[Robot, Robot], seed: int = 5, wheels: WheelFaults | None = None) -> Rigged:
    rng, target = np.random.default_rng(seed), make_target()
    gap = 0.15 + max(robot.reach for robot in robots)
    stops = np.empty((STOPS, 3))
    for k, robot in enumerate(robots):
        stops[k::2] = choose_stops(robot, target, STOPS // 2, gap, rng)
    faults = None if wheels is None else Imperfections(wheels=wheels)
    drive = simulate_drive(robots[0], target, DriveOptions(stops=STOPS, slip=SLIP), rng, stops=stops, faults=faults)
    views, kept = [], []
    for robot, seen in zip(robots, (drive, seen_by(drive, *robots)), strict=True):
        view = exact_correspondences(robot, target, seen, SIGMA_PX, rng)
        rows = tuple(j for j, stop in enumerate(view.stops) if len(stop.landmark_ids) >= 16)
        kept.append(rows)
        views.append(replace(view, stops=tuple(view.stops[j] for j in rows)))
    options = EstimateOptions(systematic_share=0.0)
    fits = tuple(fit([view], None, options) for view in views)
    found = tuple(reported(f, [v], options) for f, v in zip(fits, views, strict=True))
    return Rigged(robots=robots, drive=drive, kept=tuple(kept), views=tuple(views), fits=fits, found=found)


def ahead_and_behind() -> tuple[Robot, Robot]:
    robot = turtlebot()
    behind = mount(yaw=radians(176), pitch=radians(8), x=-0.06, y=0.01, z=0.18)
    lens = replace(robot.camera, fu=620.0, fv=621.0, cu=402.0, cv=297.0, kr=-0.12)
    return robot, with_camera_at(robot, behind, lens, image_size=(800, 600))


@pytest.fixture(scope="session")
def front_and_rear() -> Rigged:
    return rigged(ahead_and_behind())


@pytest.fixture(scope="session")
def stereo() -> Rigged:
    robot = turtlebot()
    offset = np.eye(4)
    offset[0, 3] = 0.06
    return rigged((robot, with_camera_at(robot, robot.T_body_cam @ offset)))
