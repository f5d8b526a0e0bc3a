"""Odometry poses as the two wheels that their driver reckoned them from."""

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.encoder import gaps_covered, span
from boxcal.detect.log.signals import OdometrySignal
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Ids

ASSUMED_RADIUS, ASSUMED_SEPARATION = 0.05, 0.3
"""Wheels that stand for a driver's own where these are not known, m: what is found then are corrections, not sizes."""
_JUMP_M, _JUMP_RAD = 0.5, 1.0
"""A pose that changes by more than this from one message to the next was set anew."""


def virtual_wheels(signal: OdometrySignal, t_ns: Ids, nominal: tuple[float, float], who: str) -> WheelSamples:
    """Return the wheel angles that give an odometry's poses, by the driver's own radius and separation.

    Between two poses the robot drives an arc: with the chord c and the turn d its length is ``c (d/2)/sin(d/2)``, and
    the wheels roll ``s +- b d/2``. A pose that jumps was set anew: the travel to it is not known.

    Parameters
    ----------
    signal
        Poses in order of arrival.
    t_ns : (N,) ns
        Their stamps.
    nominal : m
        The driver's wheel radius and separation.
    who
        Recording and topic, for messages.

    Raises
    ------
    DetectError
        If fewer than two different stamps remain.
    """
    radius, separation = nominal
    t_ns, first = np.unique(t_ns, return_index=True)
    if t_ns.size < 2:
        raise DetectError(f"odometry of {span(t_ns)}", source=who, needed="times are needed", remedy="record again")
    x, y, heading = np.array(signal.poses, dtype=np.float64)[first].T
    turn = np.diff(np.unwrap(heading))
    dx, dy = np.diff(x), np.diff(y)
    middle = heading[:-1] + turn / 2
    chord = dx * np.cos(middle) + dy * np.sin(middle)
    travel = chord / np.sinc(turn / (2 * np.pi))
    jump = (np.hypot(dx, dy) > _JUMP_M) | (np.abs(turn) > _JUMP_RAD)
    travel, turn = np.where(jump, 0.0, travel), np.where(jump, 0.0, turn)
    phi_R, phi_L = (
        np.concatenate([[0.0], np.cumsum((travel + side * separation / 2 * turn) / radius)]) for side in (1.0, -1.0)
    )
    covered = gaps_covered(t_ns, phi_R) & gaps_covered(t_ns, phi_L)
    covered[1:] &= ~jump
    return WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L, encoder_steps=(0.0, 0.0), covered=covered)
