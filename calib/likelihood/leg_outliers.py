"""Possible causes of an outlier leg, in numbers and in words.

One leg gives three numbers, so causes cannot be proven: a box that was pushed and a robot that was carried look alike
to camera and wheels. What can be decided is whether a slip of one wheel (or of both alike) at one moment explains all
three, and how large each explanation is.
"""

from typing import NamedTuple

import numpy as np
from scipy import special

from boxcal.calib.geometry.so3_se3 import rot2
from boxcal.calib.likelihood.estimate import FlaggedLeg
from boxcal.calib.likelihood.outliers import LegTests
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Mask

_EXPLAINED = 0.01
"""A slip explains a leg if what it leaves has at least this chance."""
_ONE_WHEEL = 0.15
"""A slip counts as that of one wheel if the other's is less than this fraction of it."""
_SMALL_MM, _SMALL_DEG = 50.0, 5.0
"""A pushed box moves by less than this; a lifted robot by more, mostly."""


class Slip(NamedTuple):
    """A slip at one moment: what the wheels turned without moving the robot, m; the leg's sample; its chance."""

    right: float
    left: float
    sample: int
    chance: float

    @property
    def simple(self) -> bool:
        """Whether one wheel slipped, or both alike, and that explains the leg."""
        small, large = sorted((abs(self.right), abs(self.left)))
        alike = abs(self.right - self.left) < _ONE_WHEEL * large
        return self.chance > _EXPLAINED and (small < _ONE_WHEEL * large or alike)


def flagged_legs(
    problem: Problem, state: State, tests: LegTests, used: Mask, drives: list[Correspondences]
) -> tuple[FlaggedLeg, ...]:
    """Return the legs left out, each with its time, its size and what explains it."""
    return tuple(_flagged(problem, state, tests, drives, int(k)) for k in np.flatnonzero(~used))


def _flagged(problem: Problem, state: State, tests: LegTests, drives: list[Correspondences], k: int) -> FlaggedLeg:
    i = int(problem.leg_stop[k])
    d, a, b = int(problem.drive[i]), int(problem.stop[i]), int(problem.stop[i + 1])
    difference = tests.difference[k]
    size_mm, turn_deg = float(np.hypot(*difference[:2])) * 1e3, float(np.degrees(difference[2]))
    move, turn = box_motion(state.poses[i], state.poses[i + 1], difference)
    slip = find_slip(problem.path.dphi[problem.path.leg == k], state.wheels, difference, tests.covariance[k])
    t_ns = drives[d].wheels.t_ns
    start, end = drives[d].stops[a].t_end_ns, drives[d].stops[b].t_start_ns
    after = int(np.sum(problem.drive[i + 1 :] == d))
    where = f"stop {a + 1} and stop {b + 1}" if len(drives) == 1 else f"stops {a + 1} and {b + 1} of drive {d + 1}"
    p = float(tests.p_value[k])
    chance = f"{p:.1g}" if p > 1e-300 else "below 1e-300"
    what = (
        f"between {where} ({(start - t_ns[0]) / 1e9:.1f} to {(end - t_ns[0]) / 1e9:.1f} s) wheels and images differ by "
        f"{size_mm:.1f} mm and {turn_deg:+.2f} deg (chance without a fault: {chance}); the leg was left out: "
    )
    box = (
        f"the box was moved by {np.hypot(*move) * 1e3:.1f} mm and {np.degrees(turn):+.2f} deg (all {after} stops after "
        "it agree with that one displacement)"
    )
    moment = (float(t_ns[min(drives[d].stops[a].last_sample + slip.sample, len(t_ns) - 1)]) - float(t_ns[0])) / 1e9
    if slip.simple:
        causes = f"{_slip_words(slip)} at about {moment:.1f} s explains it; or {box}; or the robot was carried"
    elif size_mm > _SMALL_MM or abs(turn_deg) > _SMALL_DEG:
        causes = f"no slip of one wheel at one moment explains it: the robot was lifted and put down, or {box}"
    else:
        causes = f"no slip of one wheel at one moment explains it: {box}, or the robot was carried"
    return FlaggedLeg(
        drive=d,
        leg=a,
        next_stop=b,
        t_start_ns=start,
        t_end_ns=end,
        size_mm=size_mm,
        turn_deg=turn_deg,
        p_value=p,
        box_moved_mm=(float(move[0]) * 1e3, float(move[1]) * 1e3),
        box_turned_deg=float(np.degrees(turn)),
        slip_explains=slip.simple,
        text=what + causes,
    )


def _slip_words(slip: Slip) -> str:
    right, left = slip.right * 1e3, slip.left * 1e3
    if abs(right) > abs(left) / _ONE_WHEEL:
        return f"a slip of the right wheel by {right:.1f} mm"
    if abs(left) > abs(right) / _ONE_WHEEL:
        return f"a slip of the left wheel by {left:.1f} mm"
    return f"a slip of both wheels by {(right + left) / 2:.1f} mm"


def box_motion(first: Array, second: Array, difference: Array) -> tuple[Array, float]:
    """Return the box' displacement (2,), m, and turn, rad, in its frame before, that explains a leg.

    The wheels lead from the first stop to X; seen from the moved box the robot is at Y, so the box moved by X inv(Y).
    """
    here = rot2(float(first[2])) @ difference[:2] + second[:2]
    turn = float(difference[2])
    return here - rot2(turn) @ second[:2], turn


def find_slip(dphi: Array, wheels: Array, difference: Array, covariance: Array) -> Slip:
    """Return the slip at one moment that explains a leg best: among moments that explain it, that of the simplest slip.

    Wheels that turn without moving the robot add a turn psi and a step ds to the path that they describe. psi is the
    difference in heading; for every sample the step that leaves least of the difference in place is taken.

    Parameters
    ----------
    dphi : (S, 2), rad
        Wheel travel on the leg.
    wheels : (3,), m
        rR, rL, b.
    difference : (3,), m and rad
        Wheels less images in the body frame of the leg's start.
    covariance : (3, 3)
        Of the difference.
    """
    u = dphi * wheels[:2]
    dth = (u[:, 0] - u[:, 1]) / wheels[2]
    th = np.concatenate([[0.0], np.cumsum(dth)])
    chord = u.mean(axis=1) * np.sinc(dth / 2 / np.pi)
    middle = th[:-1] + dth / 2
    xy = np.concatenate(
        [np.zeros((1, 2)), np.cumsum(chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], 1), 0)]
    )
    psi = float(difference[2])
    # W - I = (W - p) - R(-psi) (W - p - ds dir), W where the wheels lead and I where the images do.
    to_go = xy[-1] - xy[:-1]
    back = rot2(-psi)
    left_over = difference[:2] - (to_go - to_go @ back.T)  # to be explained by R(-psi) ds dir
    direction = np.stack([np.cos(th[:-1] + psi / 2), np.sin(th[:-1] + psi / 2)], axis=1) @ back.T
    N = np.linalg.inv(covariance[:2, :2] + 1e-16 * np.eye(2))
    ds = np.einsum("si,ij,sj->s", direction, N, left_over) / np.einsum("si,ij,sj->s", direction, N, direction)
    rest = left_over - ds[:, None] * direction
    chance = special.chdtrc(1, np.einsum("si,ij,sj->s", rest, N, rest))
    right, left = ds + wheels[2] * psi / 2, ds - wheels[2] * psi / 2
    small, large = np.minimum(np.abs(right), np.abs(left)), np.maximum(np.abs(right), np.abs(left))
    unlike = np.minimum(small, np.abs(right - left)) / large
    k = int(np.argmin(np.where(chance > _EXPLAINED, unlike, 2.0 + 1 / (1 + chance))))
    return Slip(right=float(right[k]), left=float(left[k]), sample=k, chance=float(chance[k]))
