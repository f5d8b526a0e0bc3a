"""``camchain.yaml``: the robot's cameras as Kalibr describes a chain of them."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.exports.lens_models import kalibr_distortion
from boxcal.calib.exports.names import Names
from boxcal.calib.exports.rig import NamedCamera, named_cameras
from boxcal.calib.exports.text import comment, heading, number, numbers, sigma_line
from boxcal.calib.geometry.so3_se3 import inverse, nearest_rotation, rigid
from boxcal.calib.results.calibration import Calibration
from boxcal.target.arrays import Array

_OVERLAP = np.cos(np.radians(45.0))
"""Cameras whose axes are nearer to each other than this (a cosine) are said to overlap."""


def camchain(calibration: Calibration, names: Names | None = None) -> str | None:
    """Return the file, or None where Kalibr has no such lens model for one of the cameras.

    Every key on its top level is a camera to Kalibr, so all stands in ``cam0``, ``cam1`` ... ``T_cam_body`` stands
    where a camera with an IMU has ``T_cam_imu``, and has its direction; ``T_cn_cnm1`` maps points of the camera before.
    """
    cameras = named_cameras(calibration, names)
    if any(kalibr_distortion(camera.calibration) is None for camera in cameras):
        return None
    lines = [
        *heading(calibration, "camera chain for Kalibr"),
        "intrinsics [fu, fv, pu, pv], px; pixel (0, 0) is the centre of the top-left pixel; radtan is k1, k2, p1, p2",
        "T_cam_body, m: maps points of the body (on the floor below the middle of the axle, x forward, y left, z up)",
        "to the camera (x right, y down, z forward), the direction of Kalibr's T_cam_imu",
        sigma_line(calibration, ("fu", "fv", "cu", "cv", "kr", "rx", "ry", "rz", "tx", "ty", "tz")),
    ]
    if len(cameras) > 1:
        lines += [f"cam{k}: {camera.name}" for k, camera in enumerate(cameras)]
    return comment(lines) + "".join(_camera(k, cameras) for k in range(len(cameras)))


def _camera(k: int, cameras: Sequence[NamedCamera]) -> str:
    calibration, names = cameras[k].calibration, cameras[k].names
    c, lens = calibration.camera, kalibr_distortion(calibration)
    if lens is None:
        raise ValueError(f"Kalibr has no model of camera {k}")
    T = _T_cam_body(cameras[k])
    chain = f"  T_cn_cnm1:\n{_rows(T @ inverse(_T_cam_body(cameras[k - 1])))}" if k else ""
    return (
        f"cam{k}:\n"
        f"  cam_overlaps: {_overlaps(k, cameras)}\n"
        "  camera_model: pinhole\n"
        f"  distortion_coeffs: {numbers(lens.coefficients)}\n"
        f"  distortion_model: {lens.model}\n"
        f"  intrinsics: [{number(c.fu)}, {number(c.fv)}, {number(c.cu)}, {number(c.cv)}]\n"
        f"  resolution: [{calibration.image_size[0]}, {calibration.image_size[1]}]\n"
        f'  rostopic: "{names.topic}"\n'
        f"{chain}  T_cam_body:\n{_rows(T)}"
    )


def _T_cam_body(camera: NamedCamera) -> Array:
    T = camera.calibration.T_body_cam
    return inverse(rigid(nearest_rotation(T[:3, :3]), T[:3, 3]))


def _rows(T: Array) -> str:
    return "".join(f"  - {numbers(row)}\n" for row in T.tolist())


def _overlaps(k: int, cameras: Sequence[NamedCamera]) -> list[int]:
    axes = [camera.calibration.T_body_cam[:3, 2] for camera in cameras]
    return [j for j, axis in enumerate(axes) if j != k and float(axis @ axes[k]) > _OVERLAP]


def camchain_missing(calibration: Calibration) -> str | None:
    """Return why there is no camera chain; None where there is one."""
    without = [c for c in named_cameras(calibration) if kalibr_distortion(c.calibration) is None]
    if not without:
        return None
    kind = without[0].calibration.camera.kind
    lines = [
        *heading(calibration, "no camera chain for Kalibr"),
        "Kalibr's models (radtan: k1, k2, p1, p2; equidistant) have no place for all coefficients of the model that",
        f"the images ask for ({kind}). Calibrate with --lens radial or --lens fisheye if Kalibr's",
        "file is needed, or read the camera from camera_info.yaml.",
    ]
    return "\n".join(lines) + "\n"
