"""``robot_localization.yaml``: the wheels' odometry as an input of robot_localization's Kalman filter."""

from boxcal.calib.exports.names import Names
from boxcal.calib.exports.odometry_noise import OdometryNoise, odometry_noise
from boxcal.calib.exports.text import comment, heading, number, sigma_line, usage
from boxcal.calib.results.calibration import Calibration

SPEED = 0.5
"""Speed that the process noise is meant for, m/s."""
_DEFAULTS = (0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04, 0.01, 0.01, 0.02, 0.01, 0.01, 0.015)
"""Diagonal of the process noise where nobody sets it (ekf.yaml): x y z, roll pitch yaw, their rates, accelerations."""
_X, _Y, _YAW = 0, 1, 5


def process_noise(noise: OdometryNoise) -> tuple[float, ...]:
    """Return the diagonal (15,) of the filter's process noise, per second: the slip at SPEED in x, y and yaw."""
    diagonal = list(_DEFAULTS)
    diagonal[_X] = diagonal[_Y] = noise.slip**2 * SPEED / 2
    diagonal[_YAW] = 2 * noise.slip**2 * SPEED / noise.b**2
    return tuple(diagonal)


def robot_localization_yaml(calibration: Calibration, names: Names | None = None) -> str | None:
    """Return a ROS 2 parameter file for ``ekf_filter_node``; None where nothing is known of the noise.

    The wheels' forward and turning speeds are used, and that they do not go sideways; their variances come with each
    message, from the diagonals in ``diff_drive_controller.yaml``.
    """
    noise = odometry_noise(calibration)
    if noise is None:
        return None
    names = names or Names()
    controller = names.controller.rstrip("/")
    lines = [
        *heading(calibration, "the wheels' odometry for robot_localization"),
        "odom0: speeds ahead, sideways (none) and of turning; their variances come with each message",
        "(diff_drive_controller.yaml sets them from the calibration's sigmas and the slip)",
        f"process noise, per second: x, y and yaw are the slip of this drive at {SPEED:g} m/s, the least that is",
        "justified; the rest are the filter's defaults",
        sigma_line(calibration, ("rR", "rL", "b")),
        "x forward, y left, z up",
        *usage(calibration, "add your other sensors"),
    ]
    diagonal = process_noise(noise)
    rows = [[diagonal[k] if k == j else 0.0 for k in range(len(diagonal))] for j in range(len(diagonal))]
    cells = ",\n".join("        " + ", ".join(number(v) for v in row) for row in rows)
    used = [(False,) * 6, (True, True, False, False, False, True), (False,) * 3]
    flags = ", ".join(str(flag).lower() for part in used for flag in part)
    return comment(lines) + (
        "/**:\n"
        "  ekf_filter_node:\n"
        "    ros__parameters:\n"
        "      two_d_mode: true\n"
        f"      base_link_frame: {names.base}\n"
        f"      odom0: {controller}/odom\n"
        f"      odom0_config: [{flags}]\n"
        f"      process_noise_covariance: [\n{cells}]\n"
    )
