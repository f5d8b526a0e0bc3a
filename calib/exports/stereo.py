"""Stereo pairs: two cameras beside each other, for OpenCV, and as the two files that ROS takes of a pair."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from boxcal.calib.exports.rig import NamedCamera, named_cameras
from boxcal.calib.exports.ros_camera_info import Rectified, camera_info
from boxcal.calib.exports.text import heading, ros_name
from boxcal.calib.geometry.camera_pair import between
from boxcal.calib.geometry.so3_se3 import inverse, nearest_rotation, rigid
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import MOUNTING
from boxcal.target.arrays import Array
from boxcal.target.camera.distortion import CameraKind

_PARALLEL = np.cos(np.radians(30.0))
"""Cameras whose axes are nearer to each other than this (a cosine) can be rectified to each other."""
_SIDE = 1.0
"""A pair is rectified where its baseline is more across the first camera's axis than along it, by this factor."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pair:
    """Two cameras, the left or upper one first."""

    first: NamedCamera
    second: NamedCamera

    @property
    def T_second_first(self) -> Array:
        """Transform (4, 4), m, that maps points of the first camera to the second, as OpenCV has R and T."""
        T = inverse(between(self.first.calibration.T_body_cam, self.second.calibration.T_body_cam))
        return rigid(nearest_rotation(T[:3, :3]), T[:3, 3])

    @property
    def stem(self) -> str:
        """Name of the pair in files' names."""
        return f"{ros_name(self.first.name)}_{ros_name(self.second.name)}"


def stereo_files(calibration: Calibration) -> Mapping[str, str]:
    """Return file name -> content for all pairs of a robot's cameras; nothing for a robot with one.

    Every pair gets ``opencv_stereo_A_B.yaml``; pairs that can be rectified get ``stereo_A_B/left.yaml`` and
    ``right.yaml`` as well.
    """
    files: dict[str, str] = {}
    for a, b in combinations(named_cameras(calibration), 2):
        pair = _ordered(a, b)
        rectified = _rectified(pair)
        files[f"opencv_stereo_{pair.stem}.yaml"] = _opencv(calibration, pair, rectified)
        if rectified is not None:
            for side, camera, of_it in zip(
                ("left", "right"), (pair.first, pair.second), rectified.of_each, strict=True
            ):
                files[f"stereo_{pair.stem}/{side}.yaml"] = camera_info(
                    camera.calibration, of_it, name=ros_name(f"{calibration.robot}/{camera.name}")
                )
    return files


def _ordered(a: NamedCamera, b: NamedCamera) -> _Pair:
    """Return two cameras with that one first which has the other to its right, or below it."""
    x, y, _ = between(a.calibration.T_body_cam, b.calibration.T_body_cam)[:3, 3]
    ahead = x if abs(x) >= abs(y) else y
    return _Pair(first=a, second=b) if ahead >= 0 else _Pair(first=b, second=a)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rectification:
    R1: Array
    R2: Array
    P1: Array
    P2: Array
    Q: Array

    @property
    def of_each(self) -> tuple[Rectified, Rectified]:
        return Rectified(R=self.R1, P=self.P1), Rectified(R=self.R2, P=self.P2)

    def entries(self) -> Iterator[tuple[str, Array]]:
        for name in ("R1", "R2", "P1", "P2", "Q"):
            yield name, getattr(self, name)


def _rectified(pair: _Pair) -> _Rectification | None:
    """Return how OpenCV rectifies a pair; None where they differ in size or lens or look apart."""
    a, b = pair.first.calibration, pair.second.calibration
    fisheye = [c.camera.kind is CameraKind.FISHEYE for c in (a, b)]
    parallel = float(a.T_body_cam[:3, 2] @ b.T_body_cam[:3, 2]) > _PARALLEL
    T = pair.T_second_first
    across, along = float(np.hypot(T[0, 3], T[1, 3])), abs(float(T[2, 3]))
    if a.image_size != b.image_size or fisheye[0] != fisheye[1] or not parallel or across <= _SIDE * along:
        return None
    K1, K2 = a.camera.K, b.camera.K
    D1, D2 = (np.asarray(c.distortion, dtype=np.float64).reshape(1, -1) for c in (a, b))
    R, t = np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3:])
    if fisheye[0]:
        R1, R2, P1, P2, Q = cv2.fisheye.stereoRectify(
            K1, D1.ravel(), K2, D2.ravel(), a.image_size, R, t, flags=cv2.CALIB_ZERO_DISPARITY
        )
    else:
        R1, R2, P1, P2, Q, _, _ = cv2.stereoRectify(
            K1, D1, K2, D2, a.image_size, R, t, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
        )
    R1, R2, P1, P2, Q = (np.asarray(M, dtype=np.float64) for M in (R1, R2, P1, P2, Q))
    found = _Rectification(R1=R1, R2=R2, P1=P1, P2=P2, Q=Q)
    return found if all(np.all(np.isfinite(M)) for _, M in found.entries()) else None


def _opencv(calibration: Calibration, pair: _Pair, rectified: _Rectification | None) -> str:
    """Return a pair as OpenCV's FileStorage reads it, under the names of its stereo sample."""
    a, b, T = pair.first.calibration, pair.second.calibration, pair.T_second_first
    lines = [
        *heading(calibration, f"cameras {pair.first.name} (1) and {pair.second.name} (2) for OpenCV (FileStorage)"),
        "R, T: a point x1 of camera 1 is R x1 + T in camera 2, m; M, D: camera matrix (px), distortion coefficients",
        "R1, R2, P1, P2, Q as of cv::stereoRectify (CALIB_ZERO_DISPARITY, alpha 0), where the pair can be rectified",
        f"covariance: of T_1_2, {', '.join(MOUNTING)}: rotation (right perturbation, rad), translation (m)",
    ]
    file = cv2.FileStorage("boxcal.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for line in lines:
        file.writeComment(line)
    for number, (camera, own) in enumerate(((pair.first, a), (pair.second, b)), 1):
        file.write(f"camera_{number}", camera.name)
        file.write(f"image_width_{number}", own.image_size[0])
        file.write(f"image_height_{number}", own.image_size[1])
        file.write(f"fisheye_model_{number}", int(own.camera.kind is CameraKind.FISHEYE))
        file.write(f"M{number}", np.asarray(own.camera.K, dtype=float))
        file.write(f"D{number}", np.asarray(own.distortion, dtype=float).reshape(1, -1))
    file.write("R", np.ascontiguousarray(T[:3, :3]))
    file.write("T", np.ascontiguousarray(T[:3, 3:]))
    if calibration.rig is not None:
        found = calibration.rig.pair(pair.first.name, pair.second.name)
        file.write("covariance", np.ascontiguousarray(found.covariance))
    for name, M in rectified.entries() if rectified is not None else ():
        file.write(name, np.ascontiguousarray(M))
    return str(file.releaseAndGetString())
