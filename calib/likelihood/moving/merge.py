"""Estimate with what frames on the move add, or with why they add nothing."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.parameters import COUNT
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.explanation import in_pictures
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.agreement import agreement
from boxcal.calib.likelihood.moving.covariance import joint_covariance
from boxcal.calib.likelihood.moving.exposure import exposure
from boxcal.calib.likelihood.moving.faults import FEWEST, Sound, enough_frames, sound
from boxcal.calib.likelihood.moving.leave_out import LeaveOut, leave_out
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.merged_estimate import Doubts, merged, rolling
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import FIRST_JITTER_S
from boxcal.calib.likelihood.summary import reported_cov
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


def with_moving_frames(
    found: Estimate, fit: Fit, drives: Sequence[Correspondences], moving: Moving = Moving.AUTO
) -> Estimate:
    """Return an estimate with what the frames add that were taken between its stops, or with why they add nothing.

    Parameters
    ----------
    found, fit
        The estimate from the stops alone, and the solution that it reports.
    drives
        The drives.
    moving
        Whether they must be used.

    Raises
    ------
    CalibError
        If they must be used and cannot.
    """
    count = sum(len(drive.moving) for drive in drives)
    if moving is Moving.AUTO and count < FEWEST:
        return found
    try:
        result = _with_frames(found, fit, drives, moving)
    except np.linalg.LinAlgError:
        result = "wheels and pictures do not fit there"
    if isinstance(result, Estimate):
        return result
    if moving is Moving.ON:
        raise CalibError(
            f"{count} frames on the move cannot be used: {result}", remedy="calibrate with --moving auto or off"
        )
    return replace(found, notes=(*found.notes, f"{count} frames taken on the move were left out: {result}"))


def _with_frames(found: Estimate, fit: Fit, drives: Sequence[Correspondences], moving: Moving) -> Estimate | str:
    """Return the estimate with frames on the move, or why they cannot be used."""
    why = unsuitable(found, fit, drives)
    if why:
        return why
    noise = FrameNoise(slip=fit.components.slip, jitter_s=FIRST_JITTER_S, sway=1.0, scale=1.0)
    among_all = sound(fit, drives, enough_frames(drives), noise)
    result = _checked(found, fit, drives, moving, among_all)
    return among_all.said(result, len(drives)) if isinstance(result, str) else result


def _checked(
    found: Estimate, fit: Fit, drives: Sequence[Correspondences], moving: Moving, among_all: Sound
) -> Estimate | str:
    """Return the estimate with frames on the move that do not contradict each other, or why they cannot be used."""
    settled = among_all.settled
    if settled is None:
        return ""
    cov = joint_covariance(fit, settled)
    why = of_another_kind(settled, cov, moving)
    if why:
        return why
    among = leave_out(fit, settled)
    cov = among.enlarged(cov)
    if moving is Moving.AUTO and _less_sure(fit, settled, among, cov):
        return f"they disagree among themselves ({among.said}), which leaves them less certain than the stops"
    compared = agreement((fit.state, fit.cov), (settled.joint.state, cov))
    if not compared.holds:
        return (
            f"they contradict the stops ({compared.parameter} by {compared.sigmas:.1f} of its standard deviations; "
            f"chance of that {compared.p_value:.1g})"
        )
    return merged(found, fit, settled, cov, Doubts(without=among_all, among=among, exposure=exposure(settled, drives)))


def of_another_kind(settled: Settled, cov: Array, moving: Moving) -> str:
    """Return which shutter the frames have that the model does not; empty if none."""
    rolls = rolling(settled, cov)
    if rolls and moving is Moving.AUTO:
        return f"{rolls}, too long for the robot's course to be known over it (--moving on uses them all the same)"
    return ""


def _less_sure(fit: Fit, settled: Settled, among: LeaveOut, cov: Array) -> bool:
    """Return whether disagreement among frames leaves a parameter less certain than the stops alone."""
    nothing = np.zeros(COUNT, dtype=np.bool_)
    stops = np.diag(reported_cov(fit.cov[:COUNT, :COUNT], fit.state, nothing))
    both = np.diag(reported_cov(cov[:COUNT, :COUNT], settled.joint.state, nothing))
    return bool(np.any((among.inflation[:COUNT] > 1) & (both >= stops)))


def unsuitable(found: Estimate, fit: Fit, drives: Sequence[Correspondences]) -> str:
    """Return why frames on the move cannot be used here; empty if they can."""
    if any(map(in_pictures, fit.problem.explanations)):
        return "what happened to camera or box is known at stops only"
    if found.jackknife.unexplained:
        return "the stops do not agree among themselves"
    if not np.all(np.isfinite(found.cov)):
        return "the stops do not determine all parameters"
    most = max(len(drive.moving) for drive in drives)
    if most < FEWEST:
        return f"{most} are too few" if len(drives) == 1 else f"{most} in a drive are too few"
    return ""
