"""A drive of a robot that is not exact, as correspondences: no images are made, so hundreds take a minute."""

from dataclasses import dataclass
from math import radians

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.as_built import as_built
from boxcal.calib.simulate.drive import Drive, DriveOptions, simulate_drive
from boxcal.calib.simulate.imperfections import BoxFaults, CameraFaults, Imperfections, WheelFaults
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.viewpoints import decodable_tags
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, FACES, Target
from boxcal.target.camera.camera_model import project

FRAMES = 3
"""Images of a stop, spread evenly over it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImperfectDrive:
    """A drive of a robot that is not exact, and what it was.

    Attributes
    ----------
    seen
        What a calibration gets.
    robot
        The robot as it is; where the camera was knocked, before that.
    faults
        What was wrong.
    """

    seen: Correspondences
    robot: Robot
    faults: Imperfections


def imperfect_drive(
    robot: Robot, target: Target, options: DriveOptions, faults: Imperfections, rng: np.random.Generator
) -> ImperfectDrive:
    """Drive a robot around the box, as :func:`boxcal.calib.simulate.drive.simulate_drive` does, with faults.

    ``options.slip`` is not used: the faults have their own.
    """
    drive = simulate_drive(robot, target, options, rng, faults=faults)
    return ImperfectDrive(seen=seen_from(robot, target, drive, rng), robot=robot, faults=faults)


def seen_from(robot: Robot, target: Target, drive: Drive, rng: np.random.Generator) -> Correspondences:
    """Return what a robot sees and its wheels read on a drive, corners with the noise of the drive's camera."""
    wheels = WheelSamples(t_ns=drive.t_ns, phi_R=drive.phi_R, phi_L=drive.phi_L)
    stops = _stops(robot, target, drive, rng)
    return Correspondences(robot=robot.name, image_size=robot.image_size, wheels=wheels, stops=stops)


def _stops(robot: Robot, target: Target, drive: Drive, rng: np.random.Generator) -> tuple[StopObservation, ...]:
    built = as_built(target, drive.faults.box)
    late, drift = drive.faults.camera.late, drive.faults.camera.drift
    t_ns, phi = drive.t_ns, np.stack([drive.phi_R, drive.phi_L])
    out = []
    for j, (begun, ended) in enumerate(drive.stop_t_ns):
        when = begun + (ended - begun) * np.arange(1, FRAMES + 1) / (FRAMES + 1)
        true = when - (late + drift * (begun - drive.path_t_ns[0]) * 1e-9) * 1e9
        views = drive.T_box_cam_at(np.clip(true, drive.path_t_ns[0], drive.path_t_ns[-1]).astype(np.int64), j)
        seen = _look(robot, built, drive, j, views=list(views), rng=rng)
        if seen is None:
            continue
        first = int(np.searchsorted(t_ns, begun, side="left"))
        last = int(np.searchsorted(t_ns, ended, side="right")) - 1
        ids, uv, cov = seen
        out.append(
            StopObservation(
                t_start_ns=int(begun),
                t_end_ns=int(ended),
                first_sample=first,
                last_sample=last,
                phi_R=float(phi[0, first]),
                phi_L=float(phi[1, first]),
                landmark_ids=ids,
                p_box=target.p_box(ids),
                uv_px=uv,
                cov_px2=cov,
                frames=FRAMES,
            )
        )
    return tuple(out)


def _look(
    robot: Robot, built: Target, drive: Drive, stop: int, *, views: list[Array], rng: np.random.Generator
) -> tuple[Ids, Array, Array] | None:
    """Return landmarks, pixels and their covariances, mean over the images of one stop; None if no tag is seen."""
    camera, faults = drive.scene.cameras[stop], drive.faults.camera
    tags = [set(decodable_tags(robot, built, T).tolist()) for T in views]
    ids = np.array(sorted(set.intersection(*tags)), dtype=np.int64)
    if not len(ids):
        return None
    p = built.tag_corners[np.searchsorted(built.tag_ids, ids)].reshape(-1, 3)
    frames = []
    for T in views:
        T_cam_box = inverse(T)
        frames.append(project(camera, p @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]))
    uv = np.mean(frames, axis=0)
    motion = np.mean([(f - uv) ** 2 for f in frames], axis=(0, 2))
    tag = uv.reshape(-1, CORNERS, 2)
    outward = tag - tag.mean(axis=1, keepdims=True)
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    uv = uv + faults.noise * rng.standard_normal(uv.shape) + faults.shift * rng.standard_normal(2)
    uv = uv + faults.spread * rng.standard_normal() * outward.reshape(-1, 2)
    face = np.repeat(built.tag_faces[np.searchsorted(built.tag_ids, ids)], CORNERS)
    uv[:, 0] += faults.side_light * np.cos(2 * np.pi * face / FACES)
    cov = np.eye(2) * (faults.noise**2 + motion)[:, None, None]
    return (CORNERS * ids[:, None] + np.arange(CORNERS)).ravel(), uv, cov


def hand_made(rng: np.random.Generator, *, lean: float = radians(0.05)) -> Imperfections:
    """Return what a careful user has: sheets and faces off by 0.3 mm and 0.15 deg, a bow of 0.3 mm, a real lens."""
    place = rng.standard_normal((FACES, 3)) * (3e-4, 3e-4, radians(0.1))
    pose = np.zeros((FACES, 6))
    pose[:, :2], pose[:, 5] = radians(0.15) * rng.standard_normal((FACES, 2)), 3e-4 * rng.standard_normal(FACES)
    k2, p1, p2 = rng.normal(0, 0.05), *rng.normal(0, 5e-4, 2)
    return Imperfections(
        wheels=WheelFaults(slip=3e-4),
        camera=CameraFaults(lens=(k2, p1, p2, 0.0), shift=0.01, spread=0.01),
        box=BoxFaults(
            scale=(1 + 7e-4 * rng.standard_normal(), 1 + 7e-4 * rng.standard_normal()),
            place=place,
            pose=pose,
            bow=tuple((3e-4 * rng.standard_normal(FACES)).tolist()),
        ),
        lean=lean,
        tilt=(radians(0.3) * rng.standard_normal(), radians(0.3) * rng.standard_normal()),
    )
