"""What may have happened on a leg whose wheels and images disagree, in numbers and in words."""

import numpy as np
from scipy import stats

from calib.estimate.faults import LegTests
from calib.estimate.model import Problem, State
from calib.estimate.residuals import leg_residuals
from calib.estimate.result import FlaggedLeg
from calib.frames import Array, Mask, rot2
from detect.correspondences import Correspondences

_EXPLAINED = 0.01
"""A slip at one moment explains a leg if what it leaves has at least this chance."""
_SMALL_MM, _SMALL_DEG = 50.0, 5.0
"""A pushed box moves by less than this; a lifted robot by more, mostly."""


def flagged_legs(
    problem: Problem, state: State, tests: LegTests, used: Mask, drives: list[Correspondences]
) -> tuple[FlaggedLeg, ...]:
    """Return the legs left out, each with its time, its size and what explains it."""
    model = leg_residuals(problem, state).model
    out = np.flatnonzero(~used)
    return tuple(
        _flagged(problem, state, tests, drives, k=int(k), by_travel=model.by_travel[:, :, problem.path.leg == k])
        for k in out
    )


def _flagged(
    problem: Problem, state: State, tests: LegTests, drives: list[Correspondences], *, k: int, by_travel: Array
) -> FlaggedLeg:
    i = int(problem.leg_stop[k])
    d, a, b = int(problem.drive[i]), int(problem.stop[i]), int(problem.stop[i + 1])
    difference = tests.difference[k]
    size_mm, turn_deg = float(np.hypot(*difference[:2])) * 1e3, float(np.degrees(difference[2]))
    move, turn = _box_motion(state.poses[i], state.poses[i + 1], difference)
    slip = _slip_explains(by_travel, difference, tests.covariance[k])
    start, end = drives[d].stops[a].t_end_ns, drives[d].stops[b].t_start_ns
    t0 = int(drives[d].wheels.t_ns[0])
    after = int(np.sum(problem.drive[i + 1 :] == d))
    where = f"stop {a + 1} and stop {b + 1}" if len(drives) == 1 else f"stops {a + 1} and {b + 1} of drive {d + 1}"
    p = float(tests.p_value[k])
    what = (
        f"between {where} ({(start - t0) / 1e9:.1f} to {(end - t0) / 1e9:.1f} s) wheels and images differ by "
        f"{size_mm:.1f} mm and {turn_deg:+.2f} deg (chance without a fault {p:.1g}); the leg was left out: "
    )
    box = (
        f"the box was pushed by {np.hypot(*move) * 1e3:.1f} mm and {np.degrees(turn):+.2f} deg (all {after} stops "
        "after it agree with that one displacement)"
    )
    large = size_mm > _SMALL_MM or abs(turn_deg) > _SMALL_DEG
    if slip:
        causes = f"a wheel slipped, the robot was carried, or {box}"
    elif large:
        causes = f"no slip at one moment explains it: the robot was lifted and turned, or {box}"
    else:
        causes = f"no slip at one moment explains it: {box}, or the robot was carried"
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
        slip_explains=slip,
        text=what + causes,
    )


def _box_motion(first: Array, second: Array, difference: Array) -> tuple[Array, float]:
    """Return the box' displacement (2,), m, and turn, rad, in its frame before, that explains a leg.

    The wheels lead from the first stop to X; seen from the moved box the robot is at Y, so the box moved by X inv(Y).
    """
    here = rot2(float(first[2])) @ difference[:2] + second[:2]
    turn = float(difference[2])
    return here - rot2(turn) @ second[:2], turn


def _slip_explains(by_travel: Array, difference: Array, covariance: Array) -> bool:
    """Return whether some travel of the two wheels, in any one sample, explains a difference (3,)."""
    L = np.linalg.cholesky(covariance + 1e-18 * np.eye(3))
    g = np.linalg.solve(L, by_travel.transpose(2, 1, 0))  # (S, 3, 2)
    z = np.linalg.solve(L, difference)
    normal = np.cross(g[:, :, 0], g[:, :, 1])
    length = np.linalg.norm(normal, axis=1)
    left = np.abs(normal @ z)[length > 0] / length[length > 0]
    return bool(left.size and stats.chi2.sf(float(left.min()) ** 2, 1) > _EXPLAINED)
