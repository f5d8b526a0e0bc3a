"""Drives with one error source at a time: in the camera, the encoders, the floor, the box and the wheels."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import planar
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.kinematics import slipped
from boxcal.calib.simulate.robot import Robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import Target

FINE_S = 0.002
_WEAVE, _WEAVE_HZ = np.radians(5.0), 1.0
"""Headings swing by this much while driving: on plain arcs samples lose nothing, however rare they are."""
ASSUMED_PX = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """Sizes of the errors; the defaults are none at all, sampled every 0.02 s.

    Attributes
    ----------
    pixel : px
        Noise of each coordinate of a corner.
    encoder : rad
        Encoder step.
    period : s
        Between wheel samples.
    slip : m/sqrt(m)
    scale
        The box is larger than its table by this fraction.
    width : m
        It is wider along x: faces 0 and 2 stand further out by half of it each.
    lift : m
        Its prints sit higher.
    toe : rad
        The right wheel points to the left by this angle. Both wheels then share the sideways motion by slipping.
    eccentric : m
        The right wheel turns about a point this far from its centre.
    """

    pixel: float = 0.0
    encoder: float = 0.0
    period: float = 0.02
    slip: float = 0.0
    scale: float = 0.0
    width: float = 0.0
    lift: float = 0.0
    toe: float = 0.0
    eccentric: float = 0.0


def weaving_drive(robot: Robot, target: Target, stops: int, rng: np.random.Generator) -> Drive:
    """Return the wheel angles of a weaving drive, sampled every 2 ms."""
    options = DriveOptions(stops=stops, encoder_step=0.0, slip=0.0, joint_period_s=FINE_S, steps_per_sample=1)
    drive = simulate_drive(robot, target, options, rng)
    rate = np.abs(np.gradient(drive.phi_R)) * robot.rR + np.abs(np.gradient(drive.phi_L)) * robot.rL
    swing = _WEAVE * np.sin(2 * np.pi * _WEAVE_HZ * FINE_S * np.arange(len(rate))) * rate / rate.max()
    half = swing * robot.b / 2
    return replace(drive, phi_R=drive.phi_R + half / robot.rR, phi_L=drive.phi_L - half / robot.rL)


def observe(robot: Robot, target: Target, drive: Drive, sources: Sources, rng: np.random.Generator) -> Correspondences:
    """Return what camera and encoders make of a drive's wheel angles where errors are at work."""
    path = _path(robot, drive, sources, rng)
    at = np.searchsorted(drive.t_ns, drive.stop_t_ns[:, 0])
    kept = slice(None, None, round(sources.period / FINE_S))
    phi_R, phi_L = (_read(phi[kept], sources.encoder) for phi in (drive.phi_R, drive.phi_L))
    T_box_cam = np.stack([planar(*pose) @ robot.T_body_cam for pose in path[at]])
    built = replace(target, tag_corners=_built(target, sources))
    seen = exact_correspondences(
        robot, built, replace(drive, t_ns=drive.t_ns[kept], phi_R=phi_R, phi_L=phi_L, T_box_cam=T_box_cam)
    )
    stops = tuple(
        replace(
            stop,
            p_box=target.p_box(stop.landmark_ids),
            uv_px=stop.uv_px + sources.pixel * rng.standard_normal(stop.uv_px.shape),
            cov_px2=np.tile(np.eye(2) * ASSUMED_PX**2, (len(stop.uv_px), 1, 1)),
        )
        for stop in seen.stops
    )
    return replace(seen, stops=stops)


def _path(robot: Robot, drive: Drive, sources: Sources, rng: np.random.Generator) -> Array:
    """Return the true poses (S, 3) at the drive's samples."""
    middle = (drive.phi_R[1:] + drive.phi_R[:-1]) / 2
    u_R = (robot.rR + sources.eccentric * np.cos(middle)) * np.diff(drive.phi_R)
    u_R = slipped(u_R, sources.slip, rng)
    u_L = slipped(robot.rL * np.diff(drive.phi_L), sources.slip, rng)
    ahead, aside = (u_R * np.cos(sources.toe) + u_L) / 2, u_R * np.sin(sources.toe) / 2
    turn = (u_R * np.cos(sources.toe) - u_L) / robot.b
    heading = drive.stop_poses[0, 2] + np.concatenate([[0.0], np.cumsum(turn)])
    c, s = np.cos(heading[:-1] + turn / 2), np.sin(heading[:-1] + turn / 2)
    x = drive.stop_poses[0, 0] + np.concatenate([[0.0], np.cumsum(c * ahead - s * aside)])
    y = drive.stop_poses[0, 1] + np.concatenate([[0.0], np.cumsum(s * ahead + c * aside)])
    return np.stack([x, y, heading], axis=1)


def _built(target: Target, sources: Sources) -> Array:
    """Return the corners of the box as it stands, where the table has those of the design."""
    corners = target.tag_corners * (1 + sources.scale)
    corners[target.tag_faces == 0, :, 0] += sources.width / 2
    corners[target.tag_faces == 2, :, 0] -= sources.width / 2
    corners[:, :, 2] += sources.lift
    return np.asarray(corners)


def _read(phi: Array, step: float) -> Array:
    return phi if step == 0 else np.asarray(np.floor(phi / step) * step)
