"""The robot on the floor right now: seen from its image, or reckoned from its last stop."""

from dataclasses import dataclass
from math import atan2

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.guide.drive.glance import Glance
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.simulate.kinematics import arc_path
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array

FRESH_NS = 700_000_000
"""A look at an image older than this says nothing of where a moving robot is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Whereabouts:
    """Pose on the floor, in the box's frame.

    Attributes
    ----------
    x, y : m
    heading : rad
    source
        ``seen`` (by the tags), ``reckoned`` (by the wheels since the last stop) or ``camera`` (nothing is known of
        where the camera sits on the robot, so it is the camera's place and direction).
    """

    x: float
    y: float
    heading: float
    source: str


def whereabouts(
    seen: Glance | None,
    estimate: Estimate | None,
    drive: Correspondences | None,
    wheels: WheelSamples | None,
    now_ns: int,
) -> Whereabouts | None:
    """Return where the robot is, None if that is unknown.

    Parameters
    ----------
    seen
        The last look at an image.
    estimate, drive
        The calibration so far, and what it was made from.
    wheels
        All samples so far.
    now_ns : ns
        Stamp of the newest sample.
    """
    if seen is not None and seen.T_box_cam is not None and abs(now_ns - seen.t_ns) < FRESH_NS:
        if estimate is None:
            ahead = seen.T_box_cam[:2, 2]
            x, y = seen.T_box_cam[:2, 3]
            return Whereabouts(x=float(x), y=float(y), heading=atan2(ahead[1], ahead[0]), source="camera")
        return _of(seen.T_box_cam @ inverse(estimate.T_body_cam), "seen")
    if estimate is None or drive is None or wheels is None:
        return None
    found = estimate.drives[0]
    stop = drive.stops[found.stops[-1]]
    rows = wheels.t_ns >= stop.t_end_ns
    x, y, heading = _reckoned(found.T_box_body[-1], estimate, wheels.phi_R[rows], wheels.phi_L[rows])
    return Whereabouts(x=x, y=y, heading=heading, source="reckoned")


def _of(T_box_body: Array, source: str) -> Whereabouts:
    return Whereabouts(
        x=float(T_box_body[0, 3]),
        y=float(T_box_body[1, 3]),
        heading=atan2(T_box_body[1, 0], T_box_body[0, 0]),
        source=source,
    )


def _reckoned(T_box_body: Array, estimate: Estimate, phi_R: Array, phi_L: Array) -> tuple[float, float, float]:
    """Return the pose (m, rad) that wheels lead to from a stop."""
    start = np.array([T_box_body[0, 3], T_box_body[1, 3], atan2(T_box_body[1, 0], T_box_body[0, 0])])
    right, left = estimate.rR * np.diff(phi_R), estimate.rL * np.diff(phi_L)
    path = arc_path(start, (right + left) / 2, (right - left) / estimate.b)
    x, y, heading = path[-1]
    return float(x), float(y), float(heading)
