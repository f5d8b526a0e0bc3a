"""The calibration of one robot: what a drive gave, saved and loaded as JSON."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.results.diagnostics import Detail
from boxcal.calib.results.json_format import detail_document, read_detail
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_atomically
from boxcal.target.files.json_document import read_json

SCHEMA = 1
_CAMERA = ("fu", "fv", "cu", "cv", "kr")


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheels:
    """The wheels of a differential drive.

    Attributes
    ----------
    rR, rL : m
        Radii of the right and the left wheel.
    b : m
        Wheelbase: distance between the wheels' contact points.
    """

    rR: float
    rL: float
    b: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """How well the data fit the calibration.

    Attributes
    ----------
    stops, landmarks
        Used, over the whole drive.
    reprojection_rms_px
        Root mean square of the 2-D reprojection errors.
    heading_rms_rad
        Root mean square of turns seen less turns rolled, over all pairs of stops.
    sigma5_sigma4, sigma4_sigma3
        Singular value ratios of step 4: how well one solution fits (0 in the ideal), and how well the moves determine
        it (0.7 is usual, below 0.001 is refused).
    up_error_rad
        Angle between the axis that the robot turns about and the box's own vertical.
    """

    stops: int
    landmarks: int
    reprojection_rms_px: float
    heading_rms_rad: float
    sigma5_sigma4: float
    sigma4_sigma3: float
    up_error_rad: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StopResult:
    """One stop of the drive.

    Attributes
    ----------
    t_start_ns, t_end_ns : ns
        When the robot stood.
    landmarks
        How many were used.
    reprojection_rms_px
        Of this stop.
    T_box_cam : (4, 4), m
        Where the camera was.
    drive
        Number of the drive, from 0, where several were solved together.
    """

    t_start_ns: int
    t_end_ns: int
    landmarks: int
    reprojection_rms_px: float
    T_box_cam: Array
    drive: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """How a result came about.

    Attributes
    ----------
    version
        Of boxcal.
    command
        As it was given.
    created
        UTC, ISO 8601.
    inputs
        File name -> SHA-256 of its bytes (``target``: of the landmark table).
    settings
        Everything that was asked for, defaults included.
    """

    version: str
    command: str
    created: str
    inputs: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """The calibration of one robot.

    Attributes
    ----------
    robot
        Name: the log's stem.
    image_size : px
        Width and height of the images that the intrinsics belong to.
    camera
        The camera model.
    wheels
        Radii and wheelbase.
    T_body_cam : (4, 4), m
        The mounting: maps camera points (x right, y down, z forward) to body (x forward, y left, z up, origin on the
        floor below the axle's middle).
    quality
        How well the data fit.
    stops
        What was found for each stop used.
    notes
        What the user should know.
    provenance
        How the result came about.
    method
        ``likelihood``, or ``four-steps`` for the closed form alone.
    detail
        What the likelihood adds: covariance, noise, faults, what is not determined. None for the closed form.
    """

    robot: str
    image_size: tuple[int, int]
    camera: CameraModel
    wheels: Wheels
    T_body_cam: Array
    quality: Quality
    stops: tuple[StopResult, ...]
    notes: tuple[str, ...]
    provenance: Provenance
    method: str = "four-steps"
    detail: Detail | None = None


def calibration_document(result: Calibration) -> dict[str, Any]:
    """Return the content of ``calibration.json``."""
    return {
        "schema": SCHEMA,
        "robot": result.robot,
        "camera": {name: float(getattr(result.camera, name)) for name in _CAMERA},
        "image_size": list(result.image_size),
        "wheels": {name: float(value) for name, value in asdict(result.wheels).items()},
        "T_body_cam": result.T_body_cam.tolist(),
        "quality": asdict(result.quality),
        "stops": [
            {
                "drive": stop.drive,
                "t_start_ns": stop.t_start_ns,
                "t_end_ns": stop.t_end_ns,
                "landmarks": stop.landmarks,
                "reprojection_rms_px": stop.reprojection_rms_px,
                "T_box_cam": stop.T_box_cam.tolist(),
            }
            for stop in result.stops
        ],
        "notes": list(result.notes),
        "provenance": {
            "version": result.provenance.version,
            "command": result.provenance.command,
            "created": result.provenance.created,
            "inputs": dict(result.provenance.inputs),
            "settings": dict(result.provenance.settings),
        },
        "units": "m, rad, px; T_body_cam maps camera points to body, rows of a 4x4 matrix",
        "method": result.method,
        "lens": {"model": str(result.camera.kind), "coefficients": result.camera.further},
        **(detail_document(result.detail) if result.detail else {}),
    }


def save_calibration(result: Calibration, path: Path) -> None:
    """Write ``calibration.json`` (atomically)."""
    text = json.dumps(calibration_document(result), indent=2, allow_nan=False)
    write_atomically(path, (text + "\n").encode())


def load_calibration(path: Path) -> Calibration:
    """Read what :func:`save_calibration` wrote.

    Raises
    ------
    CalibError
        If the file is missing, half written, of another schema or inconsistent.
    """
    document = read_json(path, "a calibration", error=CalibError, remedy="check the path, or calibrate again")
    if "schema" not in document:
        raise CalibError("no calibration in it", source=path, remedy="calibrate again")
    if document["schema"] != SCHEMA:
        raise CalibError(
            f"schema {document['schema']!r}, this version reads {SCHEMA}", source=path, remedy="calibrate again"
        )
    try:
        return Calibration(
            robot=str(document["robot"]),
            image_size=(int(document["image_size"][0]), int(document["image_size"][1])),
            camera=_camera(document["camera"], document.get("lens", {"model": "radial", "coefficients": {}})),
            wheels=Wheels(**{k: _positive(v) for k, v in document["wheels"].items()}),
            T_body_cam=_motion(document["T_body_cam"]),
            quality=Quality(**document["quality"]),
            stops=tuple(StopResult(**{**stop, "T_box_cam": _motion(stop["T_box_cam"])}) for stop in document["stops"]),
            notes=tuple(str(note) for note in document["notes"]),
            provenance=Provenance(**document["provenance"]),
            method=str(document["method"]),
            detail=read_detail(document),
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, TargetError) as error:
        raise CalibError(f"not a calibration ({error!r})", source=path, remedy="calibrate again") from error


def _camera(intrinsics: Mapping[str, Any], lens: Mapping[str, Any]) -> CameraModel:
    named, further = ({str(k): _number(v) for k, v in m.items()} for m in (intrinsics, lens["coefficients"]))
    return CameraModel.from_names(CameraKind(lens["model"]), named, further)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a finite number")
    return float(value)


def _positive(value: object) -> float:
    number = _number(value)
    if number <= 0:
        raise ValueError(f"{value!r} is not a positive length")
    return number


def _motion(rows: object) -> Array:
    T = np.asarray(rows, dtype=np.float64)
    rigid = (
        T.shape == (4, 4)
        and np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6)
        and np.linalg.det(T[:3, :3]) > 0
        and np.array_equal(T[3], [0, 0, 0, 1])
    )
    if not rigid:
        raise ValueError("a pose is not a rigid motion of 4 rows of 4")
    return T
