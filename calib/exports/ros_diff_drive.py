"""``diff_drive_controller.yaml``: the wheels as ros2_control's diff_drive_controller takes them.

Its odometry (odometry.cpp, diff_drive_controller.cpp): each wheel's radius is its multiplier times ``wheel_radius``,
the separation is its multiplier times ``wheel_separation``; ``linear = (right + left)/2``,
``angular = (right - left)/separation``.
"""

import re
from dataclasses import dataclass

from boxcal.calib.exports.names import Names
from boxcal.calib.exports.odometry_noise import odometry_noise
from boxcal.calib.exports.text import comment, heading, in_comment, number, numbers, sigma_line, usage
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Nominal

_SPEED = 0.5
"""Speed that the twist's covariance is meant for, m/s."""
_STILL = 1e-6
"""Variance of what a robot on a floor does not do (m^2, rad^2): as robot_localization's examples have it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DiffDrive:
    """Parameters of a diff_drive_controller (m and 1)."""

    wheel_separation: float
    wheel_radius: float
    wheel_separation_multiplier: float
    left_wheel_radius_multiplier: float
    right_wheel_radius_multiplier: float


def diff_drive(wheels: Wheels, nominal: Nominal | None = None) -> DiffDrive:
    """Return the parameters against nominal values, or against the mean radius and the wheel separation found."""
    radius = (wheels.rR + wheels.rL) / 2 if nominal is None else nominal.wheel_radius
    separation = wheels.b if nominal is None else nominal.wheel_separation
    return DiffDrive(
        wheel_separation=separation,
        wheel_radius=radius,
        wheel_separation_multiplier=wheels.b / separation,
        left_wheel_radius_multiplier=wheels.rL / radius,
        right_wheel_radius_multiplier=wheels.rR / radius,
    )


def diff_drive_yaml(calibration: Calibration, nominal: Nominal | None = None, names: Names | None = None) -> str:
    """Return a ROS 2 parameter file.

    It is keyed by the controller's name, in any namespace: parameters under ``/**`` alone lose against those that
    another file gives by name, and would leave nominal radii with calibrated multipliers; a bare name would not reach a
    controller in a robot's namespace.
    """
    controller = (names or Names()).controller
    p = diff_drive(calibration.wheels, nominal)
    against = "the mean radius and the wheel separation found" if nominal is None else in_comment(nominal.source)
    lines = [
        *heading(calibration, "wheels for diff_drive_controller"),
        f"m; multipliers are against {against}",
        "positive wheel angles roll the robot forward; separation is between the wheels' contact points",
        sigma_line(calibration, ("rR", "rL", "b")),
        *usage(calibration, f"give this file after your own parameters; it reaches the node {in_comment(controller)}"),
        *_covariance_lines(calibration),
    ]
    return comment(lines) + (
        f"{_key(controller)}:\n"
        "  ros__parameters:\n"
        f"    wheel_separation: {number(p.wheel_separation)}\n"
        f"    wheel_radius: {number(p.wheel_radius)}\n"
        f"    wheel_separation_multiplier: {number(p.wheel_separation_multiplier)}\n"
        f"    left_wheel_radius_multiplier: {number(p.left_wheel_radius_multiplier)}\n"
        f"    right_wheel_radius_multiplier: {number(p.right_wheel_radius_multiplier)}\n"
        + "".join(f"    {name}: {numbers(values)}\n" for name, values in covariance_diagonals(calibration).items())
    )


def covariance_diagonals(calibration: Calibration) -> dict[str, tuple[float, ...]]:
    """Return the diagonals of pose and twist covariance (x, y, z, roll, pitch, yaw); nothing for the closed form.

    Pose: after one metre straight ahead. Twist: over one second at 0.5 m/s. Each is the calibration's own uncertainty
    and the wheels' slip together; what a robot on a floor does not do has the small variance that filters expect.
    """
    noise = odometry_noise(calibration)
    if noise is None:
        return {}

    def diagonal(distance: float) -> tuple[float, ...]:
        x, y, yaw = (max(v, _STILL) for v in noise.straight(distance))
        return (x, y, _STILL, _STILL, _STILL, yaw)

    return {"pose_covariance_diagonal": diagonal(1.0), "twist_covariance_diagonal": diagonal(_SPEED)}


def _covariance_lines(calibration: Calibration) -> list[str]:
    if calibration.detail is None:
        return []
    return ["covariances: pose after 1 m straight ahead, twist over 1 s at 0.5 m/s; calibration and slip together"]


def _key(controller: str) -> str:
    """Return a node's name as a key of a parameter file: a bare one in any namespace."""
    if not re.fullmatch(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*", controller):
        controller = "diff_drive_controller"
    return controller if "/" in controller else f"/**/{controller}"
