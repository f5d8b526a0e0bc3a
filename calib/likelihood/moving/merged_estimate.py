"""Estimate with values and sigmas of stops and frames on the move, and the sentence on what these are."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.parameters import COUNT
from boxcal.calib.geometry.so3_se3 import inverse, rigid
from boxcal.calib.likelihood.estimate import DriveEstimate, Estimate
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.exposure import Exposure
from boxcal.calib.likelihood.moving.faults import Sound
from boxcal.calib.likelihood.moving.grid import mean_and_sigma
from boxcal.calib.likelihood.moving.leave_out import LeaveOut
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.weave import Woven
from boxcal.calib.likelihood.state import camera_motions
from boxcal.calib.likelihood.summary import reported_cov, values_of
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Doubts:
    """Doubtful things about frames that were used.

    Attributes
    ----------
    without
        Frames that contradict them and were left out, and jumps of the clock.
    among
        Their agreement among themselves.
    exposure
        How long the shutter was open, where that is known.
    """

    without: Sound
    among: LeaveOut
    exposure: Exposure | None


def merged(  # noqa: PLR0917 - two solutions and what is doubtful of the second
    found: Estimate, fit: Fit, settled: Settled, cov: Array, doubts: Doubts, late_s: float = 0.0
) -> Estimate:
    """Return the estimate with values of stops and frames, and with as much less variance as frames take off.

    Parameters
    ----------
    found, fit
        Of the stops, or of frames as if they were stops.
    settled, cov
        Of stops and frames.
    doubts
        Doubtful things about the frames.
    late_s : s
        Clock offset that the frames' stamps were put right by before.
    """
    joint = settled.joint
    state, problem, n = joint.state, joint.problem, len(found.names)
    nothing = np.zeros(len(problem.names), dtype=np.bool_)
    fresh = reported_cov(cov, state, nothing)
    base = reported_cov(fit.cov, fit.state, nothing[:n])
    if len(joint.woven.moving) == len(joint.woven.frame):  # what spoils frames as stops may be in the model of frames
        base[:COUNT, :COUNT] *= np.outer(found.jackknife.inflation, found.jackknife.inflation)
    gain = fresh[:n, :n] - base
    cov_all = fresh.copy()
    cov_all[:n, :n] = found.cov_all + gain
    values, count = values_of(problem, state), len(joint.woven.drives)
    values[-1 - 2 * count : -1] += np.concatenate([joint.clocks.late_s + late_s, joint.clocks.rate])
    less = gain[:COUNT, :COUNT]
    slip, slip_sigma = mean_and_sigma(settled.probable.slip, settled.probable.log_likelihood)
    return replace(
        found,
        camera=found.camera.from_values(problem.lens, state.lens),
        rR=float(state.wheels[0]),
        rL=float(state.wheels[1]),
        b=float(state.wheels[2]),
        T_body_cam=state.T_body_cam,
        drives=tuple(_drive(own, settled, cov_all, d) for d, own in enumerate(found.drives)),
        noise=replace(found.noise, slip=slip, slip_sigma=slip_sigma),
        cov=cov_all[:COUNT, :COUNT],
        odometry_cov=None if found.odometry_cov is None else found.odometry_cov + less,
        names=problem.names,
        values=values,
        cov_all=cov_all,
        notes=(*found.notes, _said(settled, doubts, values, np.sqrt(np.diag(fresh)))),
    )


def rolling(settled: Settled, cov: Array) -> str:
    """Return a rolling shutter's time to read a frame, if longer than the course around a frame is known for."""
    state, problem = settled.joint.state, settled.joint.problem
    readout = float(state.explained[-1])
    sigma = float(np.sqrt(reported_cov(cov, state, np.zeros(len(problem.names), dtype=np.bool_))[-1, -1]))
    if abs(readout) <= max(SAID_SIGMAS * sigma, ROUGH_READOUT_S):
        return ""
    return f"the shutter rolls: a frame takes {1e3 * abs(readout):.1f} +- {1e3 * sigma:.1f} ms"


def _said(settled: Settled, doubts: Doubts, values: Array, sigma: Array) -> str:
    """Return what the frames are and determine: clocks, readout time and jitter, of values (n,) and their sigmas."""
    odd, among = doubts.without.odd, doubts.among
    drives = len(settled.joint.woven.drives)
    late, rate = slice(-1 - 2 * drives, -1 - drives), slice(-1 - drives, -1)
    without = f" ({odd} more, which contradict{'s' if odd == 1 else ''} them, left out)" if odd else ""
    text = (
        f"{len(settled.joint.woven.moving)} frames taken on the move were used{without}: the camera's stamps are "
        f"{_lateness(settled.joint.woven, values[late], sigma[late])} against the wheels', which was allowed for"
    )
    text += "".join(f"; {jump}" for jump in doubts.without.jumps_said(drives))
    clear = np.abs(values[rate]) > SAID_SIGMAS * sigma[rate]
    if clear.any():
        k = int(np.argmax(np.abs(values[rate]) / sigma[rate]))
        text += _of_rate(values[rate][k], sigma[rate][k]) + (f" (drive {k + 1})" if drives > 1 else "")
    if settled.noise.jitter_s > SAID_JITTER_S:
        text += f"; they jitter by {1e3 * settled.noise.jitter_s:.1f} ms"
    if abs(values[-1]) > max(SAID_SIGMAS * sigma[-1], SAID_READOUT_S):
        text += f"; the shutter rolls: a frame takes {1e3 * abs(values[-1]):.1f} +- {1e3 * sigma[-1]:.1f} ms"
    if doubts.exposure is not None and doubts.exposure.time_s > max(
        SAID_SIGMAS * doubts.exposure.sigma_s, SAID_EXPOSURE_S
    ):
        text += _of_exposure(doubts.exposure)
    if np.any(among.inflation > 1):
        text += f"; they disagree among themselves ({among.said}), which the standard deviations allow for"
    return text


def _lateness(woven: Woven, late: Array, sigma: Array) -> str:
    """Return offsets of the clocks of drives that have frames, (D,), s, in words."""
    seen = np.unique(woven.drive[woven.moving]).tolist()
    said = [
        f"{abs(1e3 * late[d]):.1f} +- {1e3 * sigma[d]:.1f} ms {'late' if late[d] > 0 else 'early'}"
        + (f" in drive {d + 1}" if len(late) > 1 else "")
        for d in seen
    ]
    return " and ".join([", ".join(said[:-1]), said[-1]] if len(said) > 1 else said)


def said_of_clock(count: int, camera: str, clock: Array, sigma: Array) -> str:
    """Return how many frames of one of several cameras were used, and how its clock is off.

    Parameters
    ----------
    count, camera
        How many frames, and what the camera is called.
    clock, sigma : (2,), s and s/s
        Offset and rate, and their standard deviations.
    """
    text = (
        f"{count} frames taken on the move by {camera} were used: its stamps are {abs(1e3 * clock[0]):.1f} +- "
        f"{1e3 * sigma[0]:.1f} ms {'late' if clock[0] > 0 else 'early'} against the wheels', which was allowed for"
    )
    return text + (_of_rate(clock[1], sigma[1]) if abs(clock[1]) > SAID_SIGMAS * sigma[1] else "")


def _of_exposure(found: Exposure) -> str:
    """Return how long the shutter is open, and of what moment the offset is, in words."""
    time_ms = 1e3 * found.time_s
    return (
        f"; by their motion blur the shutter is open for {time_ms:.1f} +- {1e3 * found.sigma_s:.1f} ms: the stamps' "
        f"offset is that of the middle, {time_ms / 2:.1f} ms after it opens"
    )


def _of_rate(rate: float, sigma: float) -> str:
    """Return how fast a clock runs, in words."""
    return f"; its clock runs {1e6 * abs(rate):.0f} +- {1e6 * sigma:.0f} ppm {'fast' if rate > 0 else 'slow'}"


SAID_JITTER_S, SAID_READOUT_S, SAID_SIGMAS = 2e-3, 1e-3, 4.0
"""From what on jitter and a rolling shutter are said: s, s, and standard deviations."""
SAID_EXPOSURE_S = 0.01
"""And an exposure."""


ROUGH_READOUT_S = 5e-2
"""A longer readout, s, is not taken for granted: the robot's course is known for about as long around a frame."""


def _drive(found: DriveEstimate, settled: Settled, cov: Array, number: int) -> DriveEstimate:
    """Return the stops of a drive where frames put them; without stops, the frames that were used."""
    joint = settled.joint
    frame = joint.woven.frame
    rows = np.flatnonzero((frame < 0) & (joint.woven.drive == number))
    places = np.arange(len(found.stops))
    if not np.any(frame < 0):
        rows, places = joint.woven.moving, np.searchsorted(found.stops, frame)
    own, _ = settled.levels.solution.stop_blocks()
    motions = camera_motions(joint.problem, joint.state)
    T_cam_body = inverse(joint.state.T_body_cam)
    tilts = joint.problem.tilts.start + 2 * number + np.arange(2)
    T_box_body, pose_cov = found.T_box_body.copy(), found.pose_cov.copy()
    T_box_body[places] = [rigid(motions.R_box_cam[k], motions.p_box_cam[k]) @ T_cam_body for k in rows]
    pose_cov[places] = np.tensordot(settled.weight, own[:, rows, :3, :3], 1)
    return replace(
        found,
        T_box_body=T_box_body,
        pose_cov=pose_cov,
        tilt=joint.state.tilt[number],
        tilt_sigma=np.sqrt(np.diag(cov)[tilts]) if joint.problem.tilt_count else found.tilt_sigma,
    )
