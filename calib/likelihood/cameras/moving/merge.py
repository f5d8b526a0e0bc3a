"""Estimates of several cameras with what frames on the move add, or with why they add nothing."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.geometry.parameters import COUNT, MOUNTING, TRANSLATION
from boxcal.calib.geometry.so3_se3 import inverse, rigid
from boxcal.calib.likelihood.cameras.estimates import Cameras, with_values
from boxcal.calib.likelihood.cameras.moving.joint import SettledAll, settled_together
from boxcal.calib.likelihood.cameras.moving.row import Seen
from boxcal.calib.likelihood.cameras.problem import Together, own_name
from boxcal.calib.likelihood.cameras.solve import RobotFit
from boxcal.calib.likelihood.cameras.state import RobotState
from boxcal.calib.likelihood.estimate import DriveEstimate, Estimate
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.agreement import agreement
from boxcal.calib.likelihood.moving.clock import LATE, RATE
from boxcal.calib.likelihood.moving.covariance import joint_covariance
from boxcal.calib.likelihood.moving.faults import FEWEST, Sound, sound
from boxcal.calib.likelihood.moving.grid import mean_and_sigma
from boxcal.calib.likelihood.moving.leave_out import leave_out
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.merge import of_another_kind, unsuitable
from boxcal.calib.likelihood.moving.merged_estimate import said_of_clock
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.rolling import ROLLING
from boxcal.calib.likelihood.moving.solve import FIRST_JITTER_S
from boxcal.calib.likelihood.state import camera_motions
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


def with_frames_of_all(cameras: Cameras, alone: Sequence[tuple[Estimate, Fit, Sequence[Correspondences]]]) -> Cameras:
    """Return the estimates of several cameras with what their frames on the move add, or with why they add nothing.

    Parameters
    ----------
    cameras
        The estimates from the stops of all cameras.
    alone
        What each camera by itself gives: its estimate, the solution of its stops, and its drives.
    """
    stops, count = cameras.fit, sum(len(drive.moving) for _, _, drives in alone for drive in drives)
    if stops is None or cameras.doubt or count < FEWEST:
        return cameras
    seen, factors, why = [], [], []
    for number, (found, fit, drives) in enumerate(alone, 1):
        own, factor, said = _by_itself(found, fit, drives)
        seen.append(own)
        factors.append(factor)
        if said:
            why.append(f"camera {number} {'has none that can be used' if own.settled is None else 'has some'} ({said})")
    if all(own.settled is None for own in seen):
        return _left_out(cameras, "; ".join(why)) if why else cameras
    try:
        settled = settled_together(stops, cameras.drives[0], seen)
    except np.linalg.LinAlgError:
        settled = None
    if settled is None:
        return _left_out(cameras, "wheels and pictures do not fit there")
    cov = _enlarged(settled, factors)
    against = _contradiction(stops, settled, cov)
    if against:
        return _left_out(cameras, against)
    return _merged(cameras, stops, settled, cov, why)


def _left_out(cameras: Cameras, why: str) -> Cameras:
    return replace(cameras, notes=(*cameras.notes, f"frames taken on the move were left out: {why}"))


def _by_itself(found: Estimate, fit: Fit, drives: Sequence[Correspondences]) -> tuple[Seen, Array, str]:
    """Return a camera's frames as they fit its own stops, factors on its standard deviations, and what is odd."""
    nothing, drive = np.ones(len(fit.problem.names)), drives[0]
    why = "" if len(drive.moving) < FEWEST else unsuitable(found, fit, drives)
    if why or len(drive.moving) < FEWEST:
        return Seen(fit=fit, drive=drive, settled=None), nothing, why
    try:
        settled, factors, why = _sound_frames(fit, drives)
    except np.linalg.LinAlgError:
        settled, factors, why = None, nothing, Sound(settled=None).said("", 1)
    return Seen(fit=fit, drive=drive, settled=settled), factors, why


def _sound_frames(fit: Fit, drives: Sequence[Correspondences]) -> tuple[Settled | None, Array, str]:
    """Return a camera's frames that fit its own stops, factors on its standard deviations, and what is odd."""
    nothing = np.ones(len(fit.problem.names))
    noise = FrameNoise(slip=fit.components.slip, jitter_s=FIRST_JITTER_S, sway=1.0, scale=1.0)
    among_all = sound(fit, drives, np.arange(len(drives[0].moving)), noise)
    settled = among_all.settled
    if settled is None:
        return None, nothing, among_all.said("", 1)
    if why := of_another_kind(settled, joint_covariance(fit, settled), Moving.AUTO):
        return None, nothing, among_all.said(why, 1)
    factors = leave_out(fit, settled).inflation[: len(nothing)]
    return settled, factors, "; ".join(among_all.jumps_said(1))


def _enlarged(settled: SettledAll, factors: Sequence[Array]) -> Array:
    """Return the covariance with standard deviations as many times larger as frames of a camera disagree."""
    robot = settled.joint.row.robot
    factor = np.ones(len(robot.problem.names))
    for part, own in zip(robot.parts, factors, strict=True):
        at = part.columns[: len(own)]
        shared = min(len(at), COUNT)
        factor[at[:shared]] = np.maximum(factor[at[:shared]], own[:shared])
    R = _to_body(robot, settled.joint.state)
    cov = R @ settled.cov @ R.T
    return np.asarray(R.T @ (cov * np.outer(factor, factor)) @ R)


def _to_body(robot: Together, state: RobotState) -> Array:
    """Return what turns every camera's translation from its own axes to the body's, (n, n)."""
    R = np.eye(len(robot.problem.names))
    for part, camera in zip(robot.parts, state.cameras, strict=True):
        at = part.columns[TRANSLATION]
        R[np.ix_(at, at)] = camera.T_body_cam[:3, :3]
    return R


def _contradiction(stops: RobotFit, settled: SettledAll, cov: Array) -> str:
    """Return how stops and frames contradict each other; empty if they agree."""
    joint = settled.joint
    for number, (a, b) in enumerate(zip(stops.robot.parts, joint.row.robot.parts, strict=True)):
        at_a, at_b = a.columns[:COUNT], b.columns[:COUNT]
        compared = agreement(
            (stops.found.state.of(a, number), stops.cov[np.ix_(at_a, at_a)]),
            (joint.state.of(b, number), cov[np.ix_(at_b, at_b)]),
        )
        if not compared.holds:
            return (
                f"they contradict the stops (of camera {number + 1} most {compared.parameter}, by "
                f"{compared.sigmas:.1f} of its standard deviations; chance of that {compared.p_value:.1g})"
            )
    return ""


def _merged(cameras: Cameras, stops: RobotFit, settled: SettledAll, cov: Array, why: Sequence[str]) -> Cameras:
    """Return the estimates with values of stops and frames, and with as much less variance as frames take off.

    Where stops disagree, what frames take off is as much larger as what the stops leave: a covariance stays one.
    """
    robot, state = settled.joint.row.robot, settled.joint.state
    names, here = stops.robot.problem.names, list(robot.problem.names)
    same = [here.index(name) for name in names]
    factor = np.ones(len(here))
    factor[same] = cameras.inflation
    fresh = _reported(robot, state, cov) * np.outer(factor, factor)
    base = _reported(stops.robot, stops.found.state, stops.cov) * np.outer(cameras.inflation, cameras.inflation)
    gain = fresh[np.ix_(same, same)] - base
    mounted = np.concatenate([part.columns[MOUNTING] for part in stops.robot.parts])
    estimates = tuple(_estimate(own, c, stops, settled, gain, fresh) for c, own in enumerate(cameras.estimates))
    counts = [int(np.sum(settled.joint.row.camera == c)) for c in range(len(estimates))]
    said = [
        said_of_clock(count, f"camera {c + 1}", e.values[-3:-1], np.sqrt(np.diag(e.cov_all)[-3:-1]))
        for c, (count, e) in enumerate(zip(counts, estimates, strict=True))
        if count
    ]
    return replace(
        cameras,
        estimates=estimates,
        mountings=cameras.mountings + gain[np.ix_(mounted, mounted)],
        notes=(*cameras.notes, *said, *why),
    )


def _reported(robot: Together, state: RobotState, cov: Array) -> Array:
    R = _to_body(robot, state)
    return np.asarray(R @ cov @ R.T)


def _estimate(  # noqa: PLR0917 - one camera of two solutions
    own: Estimate, number: int, stops: RobotFit, settled: SettledAll, gain: Array, fresh: Array
) -> Estimate:
    robot, state = settled.joint.row.robot, settled.joint.state
    before, part = stops.robot.parts[number], robot.parts[number]
    names = stops.robot.problem.names
    n = len(before.columns)
    columns = [int(c) for c in before.columns] + [names.index(name) for name in own.names[n:]]
    change = gain[np.ix_(columns, columns)]
    here, explained = state.of(part, number), robot.problem.explained
    causes = dict(zip(robot.problem.names[explained], state.body.explained.tolist(), strict=True))
    found = with_values(own, before.problem, here, causes, own.cov_all + change)
    slip, slip_sigma = mean_and_sigma(settled.probable.slip, settled.probable.log_likelihood)
    found = replace(
        found,
        drives=(_drive(own.drives[0], number, stops, settled, found.cov_all), *own.drives[1:]),
        noise=replace(own.noise, slip=slip, slip_sigma=slip_sigma),
    )
    if part.course is None:
        return found
    all_names = list(robot.problem.names)
    at = [all_names.index(own_name(name, number + 1)) for name in (LATE, RATE, ROLLING)]
    clock = np.array([causes[all_names[k]] for k in at])
    clocks = settled.joint.row.clocks
    clock[:2] += clocks.late_s[number], clocks.rate[number]
    cross = fresh[np.ix_([all_names.index(names[c]) for c in columns], at)]
    return replace(
        found,
        names=(*found.names, LATE, RATE, ROLLING),
        values=np.concatenate([found.values, clock]),
        cov_all=np.block([[found.cov_all, cross], [cross.T, fresh[np.ix_(at, at)]]]),
    )


def _drive(own: DriveEstimate, number: int, stops: RobotFit, settled: SettledAll, cov: Array) -> DriveEstimate:
    """Return one camera's stops where stops and frames put them."""
    joint = settled.joint
    part = joint.row.robot.parts[number]
    here = joint.state.of(part, number)
    at_stops = np.flatnonzero(joint.row.woven.frame[part.places] < 0)
    motions, T_cam_body = camera_motions(part.problem, here), inverse(here.T_body_cam)
    blocks, _ = settled.probable.levels.solution.stop_blocks()
    pose_cov = np.tensordot(settled.probable.weight, blocks[:, part.places[at_stops], :3, :3], 1)
    tilts = stops.robot.parts[number].problem.tilts
    return replace(
        own,
        T_box_body=np.array([rigid(motions.R_box_cam[k], motions.p_box_cam[k]) @ T_cam_body for k in at_stops]),
        pose_cov=pose_cov,
        tilt=here.tilt[0],
        tilt_sigma=np.sqrt(np.diag(cov)[tilts]) if part.problem.tilt_count else own.tilt_sigma,
    )
