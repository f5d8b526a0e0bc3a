"""``nav2_amcl.yaml``: the noise of the odometry as AMCL's differential motion model takes it.

Its rule (nav2_amcl, DifferentialMotionModel; Thrun, Burgard, Fox, Probabilistic Robotics, table 5.6): a motion is a
turn, a translation and a turn; variances are ``alpha1 turn^2 + alpha2 translation^2`` of each turn and ``alpha3
translation^2 + alpha4 turn^2`` of the translation. The variance of slip grows with the distance, not with its square,
so the coefficients are those at the size of one update.
"""

from boxcal.calib.exports.odometry_noise import odometry_noise
from boxcal.calib.exports.text import comment, heading, number, sigma_line, usage
from boxcal.calib.results.calibration import Calibration

UPDATE_WAY, UPDATE_TURN = 0.25, 0.2
"""AMCL's own ``update_min_d`` (m) and ``update_min_a`` (rad)."""


def amcl_alphas(calibration: Calibration) -> dict[str, float]:
    """Return AMCL's ``alpha1`` to ``alpha4``; nothing for the closed form, which knows no sigmas."""
    noise = odometry_noise(calibration)
    if noise is None:
        return {}
    x, _, heading_straight = noise.straight(UPDATE_WAY)
    travel, heading_turn = noise.turn(UPDATE_TURN)
    return {
        "alpha1": heading_turn / UPDATE_TURN**2,
        "alpha2": heading_straight / 2 / UPDATE_WAY**2,  # half of it in each of the two turns
        "alpha3": x / UPDATE_WAY**2,
        "alpha4": travel / UPDATE_TURN**2,
    }


def amcl_yaml(calibration: Calibration) -> str | None:
    """Return a ROS 2 parameter file for ``amcl``, in any namespace; None where nothing is known of the noise."""
    alphas = amcl_alphas(calibration)
    if not alphas:
        return None
    lines = [
        *heading(calibration, "noise of the odometry for nav2_amcl"),
        f"for updates of {UPDATE_WAY:g} m and {UPDATE_TURN:g} rad; variances from calibration and slip of this",
        "drive: the least that is justified. AMCL's default is 0.2 each; give more for rougher floors",
        sigma_line(calibration, ("rR", "rL", "b")),
        "x forward, y left, z up",
        *usage(calibration, "give this file after your own parameters"),
    ]
    values = "".join(f"      {name}: {number(value)}\n" for name, value in alphas.items())
    return f"{comment(lines)}/**:\n  amcl:\n    ros__parameters:\n{values}"
