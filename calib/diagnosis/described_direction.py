"""The direction that the camera looks in against that of the robot's description.

Wheel joints that are exchanged and both reversed are a robot that drives backward, and fit as well as the right ones:
the camera then looks in the opposite direction. Static transforms in the log show which it is. A described camera frame
is an optical one (z along the view) or one of a link (x along the view), so either axis will do.
"""

import numpy as np

from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.log.source import Source
from boxcal.target.arrays import Array

_LEAST_LEVEL = 0.3
"""A view has a direction on the floor if this fraction of it is level."""
_OTHER_DEG = 75.0
"""Of a camera that looks in the opposite direction the nearer of its frame's two axes is 90 deg off (optical) or 180 (a
link's)."""


def elsewhere_than_described(T_body_cam: Array, source: Source) -> Finding | None:
    """Return what is said of a camera that looks elsewhere than described; None if not, or the log does not say.

    Parameters
    ----------
    T_body_cam : (4, 4)
        The camera's pose as it came out, optical axes.
    source
        Where the drive comes from, with the camera's pose in the base frame.
    """
    seen_deg = direction_deg(T_body_cam[:3, 2])
    if not source.nominal_T_base_cam or seen_deg is None:
        return None
    R = np.reshape(source.nominal_T_base_cam, (4, 4))[:3, :3]
    described = [deg for deg in (direction_deg(R[:, 2]), direction_deg(R[:, 0])) if deg is not None]
    off = min((abs((seen_deg - deg + 180) % 360 - 180) for deg in described), default=0.0)
    if off < _OTHER_DEG:
        return None
    return Finding(
        cause="camera-direction",
        text=f"the camera looks to {seen_deg:.0f} deg (0 ahead, left positive), elsewhere than the robot's description "
        "in the log has it look: the wheel joints are exchanged and both count backwards, or the description is not of "
        "this robot",
        advice="Check that the left wheel's readings are the left one's and rise as it rolls forward (else give "
        "--left-joint, --right-joint, --reverse-left and --reverse-right); where they are right, correct the "
        "description.",
    )


def direction_deg(axis: Array) -> float | None:
    """Return the direction (from x forward to y left, deg) that an axis (3,) has on the floor; None if it stands."""
    if np.hypot(axis[0], axis[1]) < _LEAST_LEVEL:
        return None
    return float(np.degrees(np.arctan2(axis[1], axis[0])))
