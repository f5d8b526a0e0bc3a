"""Causes of legs that were left out: slip, a pushed box, a robot carried, encoders that jumped or fell silent.

A leg that was left out is a leg whose displacement was solved for: three unknowns of its own. A box that was pushed and
a robot that was carried look alike to camera and wheels; how far decides which is likelier.
"""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.diagnosis.counters import jumps, largest_steps
from boxcal.calib.diagnosis.leg_likelihoods import LegCause, leg_log_evidences, slip_of
from boxcal.calib.likelihood.estimate import Estimate, FlaggedLeg
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_outliers import box_motion
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_SILENT_S = 0.5
_MISSING = 10.0
"""Time without a sample, in usual ones, from which on the wheels were silent."""


def leg_findings(fit: Fit, found: Estimate, drives: Sequence[Correspondences]) -> tuple[Finding, ...]:
    """Return what is said of each leg that was left out.

    Parameters
    ----------
    fit, found
        The solution, and the estimate made of it.
    drives
        What it was made from.
    """
    by_start = {(int(fit.problem.drive[i]), int(fit.problem.stop[i])): k for k, i in enumerate(fit.problem.leg_stop)}
    out = [_finding(leg, fit, by_start[leg.drive, leg.leg], drives[leg.drive]) for leg in found.flagged_legs]
    unknown = np.flatnonzero(~fit.problem.leg_known)
    return (*out, *(_unknown(fit, int(k)) for k in unknown))


def _finding(leg: FlaggedLeg, fit: Fit, k: int, drive: Correspondences) -> Finding:
    difference, cov = fit.tests.difference[k], fit.tests.covariance[k]
    size = float(np.hypot(*difference[:2]))
    sigma = _largest_sigma(cov[:2, :2])
    where = f"between stop {leg.leg + 1} and stop {leg.next_stop + 1}"
    moved = (
        f"{1e3 * size:.1f} +- {1e3 * sigma:.1f} mm and {leg.turn_deg:+.2f} +- {np.degrees(np.sqrt(cov[2, 2])):.2f} deg"
    )
    pushed, sigma_pushed = _pushed(fit, k)
    jump, silent = _jump(drive, leg)
    evidence = leg_log_evidences(fit, k)
    likeliest = max(evidence, key=lambda cause: evidence[cause])
    if silent is not None:
        cause, text = "wheels-silent", f"{where} the wheels' readings are missing for {silent:.1f} s"
        advice = "Look for lost joint messages."
    elif jump is not None:
        cause, text = "encoder-restart", f"{where} the wheels' readings jump by {jump:.2f} rad within one sample"
        advice = "Look for a restart of the driver or of its counters."
    elif likeliest is LegCause.SLIPPED:
        side, length, s_length = slip_of(fit, k)
        cause = "leg-slipped"
        text = (
            f"{where} the {side} wheel slipped by {1e3 * abs(length):.1f} +- {1e3 * s_length:.1f} mm, or the robot was "
            f"held: wheels and images differ by {moved}"
        )
        size, sigma = abs(length), s_length
        advice = "Drive slower, with gentle starts, on a dry floor without sills or cables."
    elif likeliest is LegCause.CARRIED:
        cause, text = "robot-carried", f"{where} the robot was carried or pushed: wheels and images differ by {moved}"
        advice = "Do not move the robot by hand during the drive."
    else:
        cause = "box-moved"
        text = (
            f"{where} the box was pushed by {pushed:.1f} +- {sigma_pushed:.1f} mm and {leg.box_turned_deg:+.2f} deg, "
            f"or the robot was: wheels and images differ by {moved}"
        )
        advice = "Fasten the box to the floor (tape will do) and keep clear of it."
    return Finding(
        cause=cause,
        text=f"{text}; the leg was left out",
        advice=advice,
        adopted=True,
        stops=(leg.leg, leg.next_stop),
        size=pushed if cause == "box-moved" else 1e3 * size,
        sigma=sigma_pushed if cause == "box-moved" else 1e3 * sigma,
        unit="mm",
        p_value=leg.p_value,
    )


def _pushed(fit: Fit, k: int) -> tuple[float, float]:
    """Return how far the box was pushed if that explains a leg, and its standard deviation, mm.

    The leg's turn determines the box' turn, and with the robot's distance from it the box' place: a long lever.
    """
    i = fit.problem.leg_stop[k]
    first, second = fit.state.poses[i], fit.state.poses[i + 1]
    here = fit.tests.difference[k]
    move, _ = box_motion(first, second, here)
    step = 1e-6
    J = np.stack([(box_motion(first, second, here + step * e)[0] - move) / step for e in np.eye(3)], axis=1)
    return 1e3 * float(np.hypot(*move)), 1e3 * _largest_sigma(J @ fit.tests.covariance[k] @ J.T)


def _largest_sigma(cov: Array) -> float:
    """Return the standard deviation of a vector in the direction where it is known worst."""
    return float(np.sqrt(np.linalg.eigvalsh(cov)[-1]))


def _unknown(fit: Fit, k: int) -> Finding:
    i = int(fit.problem.leg_stop[k])
    first, second = int(fit.problem.stop[i]), int(fit.problem.stop[i + 1])
    return Finding(
        cause="leg-without-wheels",
        text=f"between stop {first + 1} and stop {second + 1} the wheels' travel is not known; the leg was left out",
        advice="Look for missing joint messages or a restart of the driver.",
        adopted=True,
        stops=(first, second),
    )


def _jump(drive: Correspondences, leg: FlaggedLeg) -> tuple[float | None, float | None]:
    """Return the largest travel within one sample of a leg, rad, and the longest time without one, s, if unusual."""
    t_ns = drive.wheels.t_ns
    every = largest_steps(drive.wheels)
    first, last = drive.stops[leg.leg].last_sample, drive.stops[leg.next_stop].first_sample
    at = jumps(every)
    jumped = every[at[(at >= first) & (at < last)]]
    dt = np.diff(t_ns[first : last + 1]) * 1e-9
    longest = float(dt.max(initial=0.0))
    silent = longest if longest > max(_SILENT_S, _MISSING * float(np.median(np.diff(t_ns))) * 1e-9) else None
    return (float(jumped.max()) if jumped.size else None), silent
