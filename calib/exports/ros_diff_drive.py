"""``diff_drive_controller.yaml``: the wheels as ros2_control's diff_drive_controller takes them.

Its odometry (odometry.cpp, diff_drive_controller.cpp): each wheel's radius is its multiplier times ``wheel_radius``,
the separation is its multiplier times ``wheel_separation``; ``linear = (right + left)/2``,
``angular = (right - left)/separation``.
"""

from dataclasses import dataclass

from boxcal.calib.exports.text import comment, heading, in_comment, number, sigma_line
from boxcal.calib.results.calibration import Calibration, Wheels
from boxcal.calib.settings import Nominal


@dataclass(frozen=True, slots=True, kw_only=True)
class DiffDrive:
    """Parameters of a diff_drive_controller (m and 1)."""

    wheel_separation: float
    wheel_radius: float
    wheel_separation_multiplier: float
    left_wheel_radius_multiplier: float
    right_wheel_radius_multiplier: float


def diff_drive(wheels: Wheels, nominal: Nominal | None = None) -> DiffDrive:
    """Return the parameters against nominal values, or against the mean radius and the wheelbase found."""
    radius = (wheels.rR + wheels.rL) / 2 if nominal is None else nominal.wheel_radius
    separation = wheels.b if nominal is None else nominal.wheel_separation
    return DiffDrive(
        wheel_separation=separation,
        wheel_radius=radius,
        wheel_separation_multiplier=wheels.b / separation,
        left_wheel_radius_multiplier=wheels.rL / radius,
        right_wheel_radius_multiplier=wheels.rR / radius,
    )


def diff_drive_yaml(calibration: Calibration, nominal: Nominal | None = None) -> str:
    """Return a ROS 2 parameter file."""
    p = diff_drive(calibration.wheels, nominal)
    against = "the mean radius and the wheelbase found" if nominal is None else in_comment(nominal.source)
    lines = [
        heading(calibration, "wheels for diff_drive_controller"),
        f"m; multipliers are against {against}",
        "positive wheel angles roll the robot forward; separation is between the wheels' contact points",
        sigma_line(calibration, ("rR", "rL", "b")),
        "/** reaches the controller whatever it is called; give this file after your own parameters",
    ]
    return comment(lines) + (
        "/**:\n"
        "  ros__parameters:\n"
        f"    wheel_separation: {number(p.wheel_separation)}\n"
        f"    wheel_radius: {number(p.wheel_radius)}\n"
        f"    wheel_separation_multiplier: {number(p.wheel_separation_multiplier)}\n"
        f"    left_wheel_radius_multiplier: {number(p.left_wheel_radius_multiplier)}\n"
        f"    right_wheel_radius_multiplier: {number(p.right_wheel_radius_multiplier)}\n"
    )
