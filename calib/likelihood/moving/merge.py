"""Estimate with what frames on the move add, or with why they add nothing."""

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.parameters import COUNT
from boxcal.calib.geometry.so3_se3 import inverse, rigid
from boxcal.calib.likelihood.estimate import DriveEstimate, Estimate
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.agreement import agreement
from boxcal.calib.likelihood.moving.covariance import joint_covariance
from boxcal.calib.likelihood.moving.faults import FEWEST, sound
from boxcal.calib.likelihood.moving.leave_out import LeaveOut, leave_out
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import FIRST_JITTER_S
from boxcal.calib.likelihood.state import camera_motions
from boxcal.calib.likelihood.summary import reported_cov, values_of
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


class Moving(StrEnum):
    """Use of frames on the move: where the data allow it, always (else the drive is refused), or never."""

    AUTO = "auto"
    ON = "on"
    OFF = "off"


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
    why = _unsuitable(found, fit, drives)
    if why:
        return why
    drive = drives[0]
    noise = FrameNoise(slip=fit.components.slip, jitter_s=FIRST_JITTER_S, sway=1.0, scale=1.0)
    settled, odd = sound(fit, drive, np.arange(len(drive.moving)), noise)
    if settled is None:
        return f"{odd} of them contradict the others" if odd else "wheels and pictures do not fit there"
    cov = joint_covariance(fit, settled)
    rolls = _rolls(settled, cov)
    if rolls and moving is Moving.AUTO:
        return f"{rolls}, over which the robot's speed is taken as constant (--moving on uses them all the same)"
    among = leave_out(fit, settled)
    cov = among.enlarged(cov)
    if moving is Moving.AUTO and _less_sure(fit, settled, among, cov):
        return f"they disagree among themselves ({among.said}), which leaves them less sure than the stops"
    compared = agreement((fit.state, fit.cov), (settled.joint.state, cov))
    if not compared.holds:
        return (
            f"they contradict the stops ({compared.parameter} by {compared.sigmas:.1f} of its standard deviations; "
            f"chance of that {compared.p_value:.1g})"
        )
    return _merged(found, fit, settled, cov, (odd, among))


def _less_sure(fit: Fit, settled: Settled, among: LeaveOut, cov: Array) -> bool:
    """Return whether disagreement among frames leaves a parameter less sure than the stops alone have it."""
    nothing = np.zeros(COUNT, dtype=np.bool_)
    stops = np.diag(reported_cov(fit.cov[:COUNT, :COUNT], fit.state, nothing))
    both = np.diag(reported_cov(cov[:COUNT, :COUNT], settled.joint.state, nothing))
    return bool(np.any((among.inflation[:COUNT] > 1) & (both >= stops)))


def _unsuitable(found: Estimate, fit: Fit, drives: Sequence[Correspondences]) -> str:
    """Return why frames on the move cannot be used here; empty if they can."""
    if len(drives) > 1:
        return "they are used with single drives only"
    if fit.problem.explanations and any(getattr(e, "in_pictures", True) for e in fit.problem.explanations):
        return "what happened to camera or box is known at stops only"
    if found.jackknife.unexplained:
        return "the stops do not agree among themselves"
    if not np.all(np.isfinite(found.cov)):
        return "the stops do not determine all parameters"
    if len(drives[0].moving) < FEWEST:
        return f"{len(drives[0].moving)} are too few"
    return ""


def _merged(found: Estimate, fit: Fit, settled: Settled, cov: Array, doubts: tuple[int, LeaveOut]) -> Estimate:
    """Return the estimate with values of stops and frames, and with as much less variance as frames take off."""
    joint = settled.joint
    state, problem, n = joint.state, joint.problem, len(found.names)
    nothing = np.zeros(len(problem.names), dtype=np.bool_)
    fresh = reported_cov(cov, state, nothing)
    gain = fresh[:n, :n] - reported_cov(fit.cov, fit.state, nothing[:n])
    cov_all = fresh.copy()
    cov_all[:n, :n] = found.cov_all + gain
    values = values_of(problem, state)
    values[-2] += joint.late_s
    less = gain[:COUNT, :COUNT]
    w, slip = settled.weight, settled.levels.slip
    mean = float(w @ slip)
    return replace(
        found,
        camera=found.camera.from_values(problem.lens, state.lens),
        rR=float(state.wheels[0]),
        rL=float(state.wheels[1]),
        b=float(state.wheels[2]),
        T_body_cam=state.T_body_cam,
        drives=(_drive(found.drives[0], settled, cov_all),),
        noise=replace(found.noise, slip=mean, slip_sigma=float(np.sqrt(w @ (slip - mean) ** 2))),
        cov=cov_all[:COUNT, :COUNT],
        odometry_cov=None if found.odometry_cov is None else found.odometry_cov + less,
        names=problem.names,
        values=values,
        cov_all=cov_all,
        notes=(*found.notes, _said(settled, doubts, values[-2:], np.sqrt(np.diag(fresh)[-2:]))),
    )


def _rolls(settled: Settled, cov: Array) -> str:
    """Return how long a rolling shutter takes to read a frame, if so long that the model of it is too rough."""
    state, problem = settled.joint.state, settled.joint.problem
    readout = float(state.explained[-1])
    sigma = float(np.sqrt(reported_cov(cov, state, np.zeros(len(problem.names), dtype=np.bool_))[-1, -1]))
    if abs(readout) <= max(SAID_SIGMAS * sigma, ROUGH_READOUT_S):
        return ""
    return f"the shutter rolls: a frame takes {1e3 * abs(readout):.1f} +- {1e3 * sigma:.1f} ms"


def _said(settled: Settled, doubts: tuple[int, LeaveOut], values: Array, sigma: Array) -> str:
    """Return what the frames are and tell: clock offset and readout time (2,), s, and their standard deviations."""
    (late, readout), (odd, among) = values.tolist(), doubts
    without = f" ({odd} more, which contradict{'s' if odd == 1 else ''} them, left out)" if odd else ""
    text = (
        f"{len(settled.joint.woven.moving)} frames taken on the move were used{without}: the camera's stamps are "
        f"{abs(1e3 * late):.1f} +- {1e3 * sigma[0]:.1f} ms {'late' if late > 0 else 'early'} against the wheels', "
        "which was allowed for"
    )
    if settled.noise.jitter_s > SAID_JITTER_S:
        text += f"; they jitter by {1e3 * settled.noise.jitter_s:.1f} ms"
    if abs(readout) > max(SAID_SIGMAS * sigma[1], SAID_READOUT_S):
        text += f"; the shutter rolls: a frame takes {1e3 * abs(readout):.1f} +- {1e3 * sigma[1]:.1f} ms"
    if np.any(among.inflation > 1):
        text += f"; they disagree among themselves ({among.said}), which the standard deviations allow for"
    return text


SAID_JITTER_S, SAID_READOUT_S, SAID_SIGMAS = 2e-3, 1e-3, 4.0
"""From what on jitter and a rolling shutter are said: s, s, and standard deviations."""


ROUGH_READOUT_S = 5e-3
"""A longer readout, s, is not taken for granted: with 20 ms the largest error was 4.5 of its standard deviations where
the stops alone gave 3.2 (``benchmarks/moving.py``)."""


def _drive(found: DriveEstimate, settled: Settled, cov: Array) -> DriveEstimate:
    """Return the stops of the drive where frames put them."""
    joint = settled.joint
    rows = np.flatnonzero(joint.woven.frame < 0)
    own, _ = settled.levels.solution.stop_blocks()
    motions = camera_motions(joint.problem, joint.state)
    T_cam_body = inverse(joint.state.T_body_cam)
    tilts = joint.problem.tilts
    return replace(
        found,
        T_box_body=np.array([rigid(motions.R_box_cam[k], motions.p_box_cam[k]) @ T_cam_body for k in rows]),
        pose_cov=np.tensordot(settled.weight, own[:, rows, :3, :3], 1),
        tilt=joint.state.tilt[0],
        tilt_sigma=np.sqrt(np.diag(cov)[tilts]) if joint.problem.tilt_count else found.tilt_sigma,
    )
