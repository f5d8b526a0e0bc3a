"""Small logs of a robot that keeps the box in view while it moves, with a camera of any clock and shutter."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.simulate.drive import Drive, DriveOptions, simulate_drive
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.calib.simulate.robot import Robot, turtlebot
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel

TARGET = make_target()
SIZE = (400, 300)
CAMERA = CameraModel(fu=383.0, fv=384.0, cu=194.9, cv=154.4, kr=-0.08)
TURN = np.radians(14)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Driven:
    """A robot, and a drive of it."""

    robot: Robot
    drive: Drive


def _stops() -> Array:
    """Poses to stop at, (12, 3): at three sides of the box, turned to either side and nearer."""
    out = []
    for side in np.radians([20, 110, 235]):
        for distance, turned in ((1.0, TURN), (1.0, -TURN), (0.75, -TURN), (0.75, TURN)):
            out.append((distance * np.cos(side), distance * np.sin(side), side + np.pi + turned))
    poses = np.array(out)
    poses[:, 2] = np.unwrap(poses[:, 2])
    return poses


@cache
def driven(seed: int = 3) -> Driven:
    """The drive that all logs show."""
    rng = np.random.default_rng(seed)
    robot = replace(turtlebot(), camera=CAMERA, image_size=SIZE)
    drive = simulate_drive(
        robot, TARGET, DriveOptions(slip=2e-4, encoder_step=1e-3, max_speed=0.08), rng, stops=_stops()
    )
    return Driven(robot=robot, drive=drive)


def write(path: Path, **options: float) -> Path:
    """Write a log of that drive by a camera of some clock and shutter, and return where it is."""
    asked = RecordOptions(**{"frames": 2, "moving_frames": 8, "exposure_s": 2e-3, **options})  # type: ignore[arg-type]
    write_log(path, driven().robot, TARGET, driven().drive, asked, rng=np.random.default_rng(1))
    return path


def worst(found: Calibration) -> float:
    """Return the largest error of wheels and the camera's place, in standard deviations."""
    robot = driven().robot
    assert found.detail is not None
    cov = found.detail.covariance
    sigma = dict(zip(cov.names, np.sqrt(np.diag(cov.matrix)).tolist(), strict=True))
    assert cov.names[: len(ORDER)] == ORDER
    off = found.T_body_cam[:3, 3] - robot.T_body_cam[:3, 3]
    errors = {"rR": found.wheels.rR - robot.rR, "rL": found.wheels.rL - robot.rL, "b": found.wheels.b - robot.b}
    errors |= {"tx": float(off[0]), "ty": float(off[1])}
    return max(abs(error) / sigma[name] for name, error in errors.items())
