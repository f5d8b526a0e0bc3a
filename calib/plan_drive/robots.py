"""Robots to plan for: from a calibration, a fleet of them, a URDF or a few dimensions; and as they might also be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians, tan
from pathlib import Path

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.euler import yaw_pitch_roll
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.json_format import CALIBRATION, load_calibration
from boxcal.calib.simulate.robot import VGA, Robot, mount, turtlebot
from boxcal.detect.errors import DetectError
from boxcal.detect.log.urdf_wheels import urdf_camera, urdf_wheels
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel

_MAX_ROBOTS = 10_000
_FOCAL = 0.95
"""Focal length over image width where nothing is known of a camera: a field of view of 55 degrees."""
_SIGNS = np.array(
    [[1, 1, 1, 1, 1, 1], [-1, 1, -1, 1, -1, 1], [1, -1, -1, 1, 1, -1], [-1, -1, 1, 1, -1, -1]], dtype=np.float64
)
"""Corners of the box of doubts that are considered: focal length, yaw, pitch, x, y, height."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """Standard deviations of what is known of a robot before it is calibrated.

    Attributes
    ----------
    focal
        Of the focal length, relative.
    direction : rad
        Of the camera's yaw and pitch.
    place : m
        Of the camera's place, along each axis.
    """

    focal: float = 0.0
    direction: float = 0.0
    place: float = 0.0


ROUGH = Doubt(focal=0.08, direction=radians(3.0), place=0.015)
"""Usual values for a robot that only a data sheet or a URDF describes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimensions:
    """Dimensions of a robot that a user gives; what is None is left as it is.

    Attributes
    ----------
    wheel_radius, wheel_separation : m
        Of both wheels, and their distance.
    image_size : px
        Width and height.
    field_of_view : rad
        Across the image.
    camera_at : m, optional
        x (forward), y (left), z (up) of the camera from the floor below the axle's middle.
    yaw, pitch : rad, optional
        Of the camera: to the left, and down.
    """

    wheel_radius: float | None = None
    wheel_separation: float | None = None
    image_size: tuple[int, int] | None = None
    field_of_view: float | None = None
    camera_at: tuple[float, float, float] | None = None
    yaw: float | None = None
    pitch: float | None = None

    def applied(self, robot: Robot) -> Robot:
        """Return a robot with these dimensions in place of its own."""
        if self.image_size is not None or self.field_of_view is not None:
            robot = _with_camera(robot, self.image_size or robot.image_size, self.field_of_view)
        b = self.wheel_separation or robot.b
        rR, rL = (robot.rR, robot.rL) if self.wheel_radius is None else (self.wheel_radius, self.wheel_radius)
        T = robot.T_body_cam
        if self.yaw is not None or self.pitch is not None:
            yaw, pitch, roll = yaw_pitch_roll(T[:3, :3])
            turned = mount(
                yaw=yaw if self.yaw is None else self.yaw, pitch=pitch if self.pitch is None else self.pitch, roll=roll
            )
            T = rigid(turned[:3, :3], T[:3, 3])
        if self.camera_at is not None:
            T = rigid(T[:3, :3], np.array(self.camera_at))
        return replace(robot, rR=rR, rL=rL, b=b, T_body_cam=T)


def _with_camera(robot: Robot, size: tuple[int, int], field_of_view: float | None) -> Robot:
    """Return a robot whose camera has another image: the focal length grows with it unless the field is given."""
    width, height = size
    scale = width / robot.image_size[0]
    f = robot.camera.fu * scale if field_of_view is None else width / 2 / tan(field_of_view / 2)
    camera = CameraModel(fu=f, fv=f, cu=(width - 1) / 2, cv=(height - 1) / 2, kr=robot.camera.kr)
    return replace(robot, camera=camera, image_size=size)


def typical_robot() -> Robot:
    """Return a robot of usual size for where nothing is known: a TurtleBot's, without its own camera's distortion."""
    robot = turtlebot("robot")
    width, height = VGA
    f = _FOCAL * width
    camera = CameraModel(fu=f, fv=f, cu=(width - 1) / 2, cv=(height - 1) / 2)
    return replace(robot, camera=camera, rR=0.033, rL=0.033, b=0.16, T_body_cam=mount(pitch=radians(10), x=0.07, z=0.2))


def calibrated_robot(found: Calibration) -> Robot:
    """Return the robot of a calibration."""
    return Robot(
        name=found.robot,
        camera=found.camera,
        image_size=found.image_size,
        rR=found.wheels.rR,
        rL=found.wheels.rL,
        b=found.wheels.b,
        T_body_cam=found.T_body_cam,
    )


def fleet_robot(folder: Path) -> tuple[Robot, tuple[Robot, ...]]:
    """Return the typical robot of a calibrated fleet, and those that differ from it most.

    Parameters
    ----------
    folder
        Of ``fleet-calibrate``: a folder a robot.

    Raises
    ------
    CalibError
        If there is no calibration in it.
    """
    paths = sorted(folder.glob(f"*/{CALIBRATION}"))[:_MAX_ROBOTS]
    if not paths:
        raise CalibError(f"no */{CALIBRATION}", source=str(folder), remedy="name the folder of fleet-calibrate --out")
    fleet = [calibrated_robot(load_calibration(path)) for path in paths]
    looks = np.array([_looks(robot) for robot in fleet])
    off = np.abs(looks - np.median(looks, axis=0))
    spread = np.maximum(np.median(off, axis=0), 1e-6)
    far = (off / spread).sum(axis=1)
    order = np.argsort(far, kind="stable")
    return fleet[int(order[0])], tuple(fleet[int(k)] for k in order[1:][-3:])


def _looks(robot: Robot) -> Array:
    """Return what decides where a robot sees the box from: field of view, direction and place of the camera, axle."""
    yaw, pitch, _ = yaw_pitch_roll(robot.T_body_cam[:3, :3])
    return np.array([robot.camera.fu / robot.image_size[0], np.sin(yaw), np.cos(yaw), pitch, *robot.T_body_cam[:3, 3]])


def urdf_robot(content: bytes, name: str, link: str | None) -> Robot:
    """Return the robot of a URDF; its camera's field of view is the usual one, since a URDF does not say it.

    Raises
    ------
    CalibError
        If it does not describe two wheels and a camera.
    """
    try:
        radius, separation = urdf_wheels(content, name)
        _, T_body_cam = urdf_camera(content, name, link)
    except DetectError as error:
        raise CalibError(error.found, source=error.source, needed=error.needed, remedy=error.remedy) from error
    stem = name.rpartition(".")[0] or name
    return replace(typical_robot(), name=stem, rR=radius, rL=radius, b=separation, T_body_cam=T_body_cam)


def might_be(robot: Robot, doubt: Doubt) -> tuple[Robot, ...]:
    """Return the robot as it might also be: at the corners of one standard deviation of what is uncertain.

    Without doubt there are none.
    """
    if doubt == Doubt():
        return ()
    return tuple(_shifted(robot, doubt, signs) for signs in _SIGNS)


def _shifted(robot: Robot, doubt: Doubt, signs: Sequence[float] | Array) -> Robot:
    focal, yaw, pitch, *place = signs
    grow = 1 + doubt.focal * focal
    camera = replace(robot.camera, fu=robot.camera.fu * grow, fv=robot.camera.fv * grow)
    R = robot.T_body_cam[:3, :3]
    up = R.T @ np.array([0.0, 0.0, 1.0])
    turned = R @ exp_so3(doubt.direction * yaw * up) @ exp_so3(np.array([doubt.direction * pitch, 0.0, 0.0]))
    T = rigid(turned, robot.T_body_cam[:3, 3] + doubt.place * np.array(place))
    return replace(robot, camera=camera, T_body_cam=T)
