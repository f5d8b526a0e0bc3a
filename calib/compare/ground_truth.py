"""Errors of a calibration against a simulated robot's true parameters."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.log.opener import robot_name_of
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel
from boxcal.target.files.json_document import read_json


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """True parameters of one robot.

    Attributes
    ----------
    camera, wheels
        Intrinsics; radii and wheelbase.
    T_body_cam : (4, 4), m
        The mounting, body origin on the floor.
    """

    camera: CameraModel
    wheels: Wheels
    T_body_cam: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """A calibration less the truth.

    Attributes
    ----------
    rR, rL, b, fu, fv
        Relative.
    cu, cv : px
        Principal point.
    kr
        Radial distortion.
    rotation : rad
        Angle of the rotation between the mountings.
    tx, ty, tz : m
        Translation of the mounting.
    """

    rR: float
    rL: float
    b: float
    fu: float
    fv: float
    cu: float
    cv: float
    kr: float
    rotation: float
    tx: float
    ty: float
    tz: float


def truth_path(log: Path) -> Path:
    """Return where a log's truth lies: ``<robot>.truth.json`` beside it, the robot named as its log."""
    return log.with_name(f"{robot_name_of(log)}.truth.json")


def load_truth(path: Path) -> Truth:
    """Read a truth file.

    Raises
    ------
    CalibError
        If it is missing or no truth file.
    """
    document = read_json(path, "a truth file", error=CalibError, remedy="leave out --truth")
    try:
        camera = {name: float(document["camera"][name]) for name in ("fu", "fv", "cu", "cv", "kr")}
        T = np.array(document["T_vehicle_camera"], dtype=np.float64)
        if T.shape != (4, 4):
            raise ValueError("T_vehicle_camera is not 4x4")
        return Truth(
            camera=CameraModel.from_names(CameraKind.RADIAL, camera, {}),
            wheels=Wheels(rR=float(document["rR"]), rL=float(document["rL"]), b=float(document["b"])),
            T_body_cam=T,
        )
    except (ValueError, KeyError, TypeError) as error:
        raise CalibError(f"not a truth file ({error!r})", source=path.name, remedy="leave out --truth") from error


def compare(result: Calibration, truth: Truth) -> Errors:
    """Return the errors of a calibration."""
    c, c0, w, w0 = result.camera, truth.camera, result.wheels, truth.wheels
    t = result.T_body_cam[:3, 3] - truth.T_body_cam[:3, 3]
    R = truth.T_body_cam[:3, :3].T @ result.T_body_cam[:3, :3]
    return Errors(
        rR=w.rR / w0.rR - 1,
        rL=w.rL / w0.rL - 1,
        b=w.b / w0.b - 1,
        fu=c.fu / c0.fu - 1,
        fv=c.fv / c0.fv - 1,
        cu=c.cu - c0.cu,
        cv=c.cv - c0.cv,
        kr=c.kr - c0.kr,
        rotation=float(np.linalg.norm(log_so3(R))),
        tx=float(t[0]),
        ty=float(t[1]),
        tz=float(t[2]),
    )
