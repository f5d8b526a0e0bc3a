"""``calibration.json``: a calibration saved and loaded."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.results.calibration import Calibration, Provenance, Quality, StopResult
from boxcal.calib.results.detail_json import detail_document, finite, read_detail, read_finding
from boxcal.calib.results.diagnostics import CAMERA
from boxcal.calib.results.rig_json import read_rig, rig_document
from boxcal.calib.results.verdict import Kind, Level, Reason, Verdict
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_atomically
from boxcal.target.files.json_document import read_json

SCHEMA = 1
CALIBRATION = "calibration.json"
"""File name of a result in a robot's folder."""


def calibration_document(result: Calibration) -> dict[str, Any]:
    """Return the content of ``calibration.json``."""
    return {
        "schema": SCHEMA,
        "robot": result.robot,
        "camera": {name: float(getattr(result.camera, name)) for name in CAMERA},
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
            "fingerprint": result.provenance.fingerprint,
        },
        "units": "m, rad, px; T_body_cam maps camera points to body, rows of a 4x4 matrix",
        "method": result.method,
        **({} if result.verdict is None else {"verdict": verdict_document(result.verdict)}),
        "findings": finite([asdict(finding) for finding in result.findings]),
        "lens": {"model": str(result.camera.kind), "coefficients": result.camera.further},
        **(detail_document(result.detail) if result.detail else {}),
        **(rig_document(result.rig) if result.rig else {}),
    }


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict as JSON has it: level, headline, reasons (causes first) and what to do."""
    document: dict[str, Any] = asdict(verdict)
    return document


def save_calibration(result: Calibration, path: str | Path) -> None:
    """Write ``calibration.json`` (atomically).

    Examples
    --------
    >>> import boxcal
    >>> found = boxcal.load_calibration("calibration/r01/calibration.json")
    >>> boxcal.save_calibration(found, "r01.json")
    """
    write_atomically(Path(path), calibration_bytes(result))


def calibration_bytes(result: Calibration) -> bytes:
    """Return the bytes of ``calibration.json``."""
    return (json.dumps(calibration_document(result), indent=2, allow_nan=False) + "\n").encode()


def load_calibration(path: str | Path) -> Calibration:
    """Read what :func:`save_calibration` wrote.

    Raises
    ------
    CalibError
        If the file is missing, half written, of another schema or inconsistent.

    Examples
    --------
    >>> import boxcal
    >>> found = boxcal.load_calibration("calibration/r01/calibration.json")
    >>> sorted(found.detail.covariance.sigma)[:4]
    ['b', 'cu', 'cv', 'fu']
    """
    path = Path(path)
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
            findings=tuple(read_finding(f) for f in document.get("findings", ())),
            verdict=_verdict(document["verdict"]) if "verdict" in document else None,
            rig=read_rig(document, _camera, _motion),
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, TargetError) as error:
        raise CalibError(f"not a calibration ({error!r})", source=path, remedy="calibrate again") from error


def _verdict(document: Mapping[str, Any]) -> Verdict:
    return Verdict(
        level=Level(document["level"]),
        headline=str(document["headline"]),
        reasons=tuple(
            Reason(
                rule=str(reason["rule"]),
                level=Level(reason["level"]),
                text=str(reason["text"]),
                advice=str(reason["advice"]),
                kind=Kind(reason.get("kind", "check")),
                because=str(reason.get("because", "")),
            )
            for reason in document["reasons"]
        ),
        next_steps=tuple(str(step) for step in document["next_steps"]),
    )


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
