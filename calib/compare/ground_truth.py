"""Errors of a calibration against a simulated robot's true parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.each_camera import each_camera
from boxcal.detect.log.opener import robot_name_of
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.topics import same_topic, without_transport
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel
from boxcal.target.files.json_document import read_json


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """True parameters of one robot.

    Attributes
    ----------
    camera, wheels
        Intrinsics; radii and wheel separation.
    T_body_cam : (4, 4), m
        The camera extrinsics, body origin on the floor.
    topic
        Of the camera's images; empty in files that do not say.
    others
        Of further cameras, with the same wheels.
    """

    camera: CameraModel
    wheels: Wheels
    T_body_cam: Array
    topic: str = ""
    others: "tuple[Truth, ...]" = ()


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
        Angle of the rotation between the extrinsics.
    tx, ty, tz : m
        Translation of the camera extrinsics.
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
        wheels = Wheels(rR=float(document["rR"]), rL=float(document["rL"]), b=float(document["b"]))
        return replace(
            _of_camera(document["camera"], document["T_vehicle_camera"], document.get("camera_topic"), wheels),
            others=tuple(
                _of_camera(other, other["T_vehicle_camera"], other.get("topic"), wheels)
                for other in document.get("cameras", ())
            ),
        )
    except KeyError as error:
        raise _no_truth(path, f"it has no {printable(str(error.args[0]))}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise _no_truth(path, f"a part of it is of another kind: {error}") from error


def _no_truth(path: Path, why: str) -> CalibError:
    return CalibError(
        f"not a truth file of a robot ({why})",
        source=path.name,
        needed="camera, rR, rL, b and T_vehicle_camera are needed, as simulate-fleet writes them",
        remedy="leave out --truth",
    )


def with_truth(result: Calibration, truth: Truth) -> list[tuple[Calibration, Truth]]:
    """Return a robot's cameras, each with its own truth, found by its topic; those without one are left out."""
    if result.rig is None:
        return [(result, truth)]
    every = (truth, *truth.others)
    pairs = [
        (one, next((t for t in every if same_topic(without_transport(t.topic), without_transport(camera.topic))), None))
        for one, camera in zip(each_camera(result), result.rig.cameras, strict=True)
    ]
    return [(one, found) for one, found in pairs if found is not None]


def _of_camera(camera: Mapping[str, Any], T_body_cam: object, topic: object, wheels: Wheels) -> Truth:
    values = {name: float(camera[name]) for name in ("fu", "fv", "cu", "cv", "kr")}
    T = np.array(T_body_cam, dtype=np.float64)
    if T.shape != (4, 4):
        raise ValueError("T_vehicle_camera is not 4x4")
    model = CameraModel.from_names(CameraKind.RADIAL, values, {})
    return Truth(camera=model, wheels=wheels, T_body_cam=T, topic=str(topic or ""))


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
