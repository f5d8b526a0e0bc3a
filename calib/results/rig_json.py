"""Part of ``calibration.json`` that a robot with several cameras adds: written and read."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from boxcal.calib.results.detail_json import covariance_document, finite, read_covariance
from boxcal.calib.results.diagnostics import CAMERA, MOUNTING
from boxcal.calib.results.rig import Rig, RigCamera
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel

PAIR_SIDE = "rx, ry, rz: right perturbation, R_a_b exp(rx, ry, rz); tx, ty, tz: of t_a_b, along the axes of camera a"


def rig_document(rig: Rig) -> dict[str, Any]:
    """Return the fields ``cameras``, ``camera_pairs`` and ``cameras_covariance``, and what was left out and why."""
    order = [f"{camera.name}.{name}" for camera in rig.cameras for name in MOUNTING]
    document: dict[str, Any] = finite(
        {
            "cameras": [_camera_document(camera) for camera in rig.cameras],
            "camera_pairs": [
                {
                    "a": pair.a,
                    "b": pair.b,
                    "T_a_b": pair.T_a_b.tolist(),
                    "sigma": pair.sigma,
                    "covariance": {"order": list(MOUNTING), "side": PAIR_SIDE, "matrix": pair.covariance.tolist()},
                }
                for pair in rig.pairs
            ],
            "cameras_covariance": {"order": order, "matrix": rig.covariance.tolist()},
            "cameras_left_out": [{"topic": topic, "why": why} for topic, why in rig.left_out],
            "cameras_apart": rig.apart,
            "cameras_stops": rig.stops,
        }
    )
    return document


def _camera_document(camera: RigCamera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "topic": camera.topic,
        "frame": camera.frame,
        "image_size": list(camera.image_size),
        "camera": {name: float(getattr(camera.camera, name)) for name in CAMERA},
        "lens": {"model": str(camera.camera.kind), "coefficients": camera.camera.further},
        "T_body_cam": camera.T_body_cam.tolist(),
        "stops": camera.stops,
        "reprojection_rms_px": camera.reprojection_rms_px,
        "clock_offset": camera.clock_offset,
        "landmarks": camera.landmarks,
        "verdict": camera.verdict,
        "why": camera.why,
        "covariance": covariance_document(camera.covariance),
    }


def read_rig(
    document: Mapping[str, Any],
    camera_of: Callable[[Mapping[str, Any], Mapping[str, Any]], CameraModel],
    motion_of: Callable[[object], Array],
) -> Rig | None:
    """Return the cameras in a calibration's document, None if it has one camera only.

    Parameters
    ----------
    document
        The whole document.
    camera_of, motion_of
        What reads a camera model from its two parts, and a rigid motion.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it is not what :func:`rig_document` makes.
    """
    if "cameras" not in document:
        return None
    cameras = tuple(
        RigCamera(
            name=str(c["name"]),
            topic=str(c["topic"]),
            frame=str(c["frame"]),
            image_size=(int(c["image_size"][0]), int(c["image_size"][1])),
            camera=camera_of(c["camera"], c["lens"]),
            T_body_cam=motion_of(c["T_body_cam"]),
            stops=int(c["stops"]),
            reprojection_rms_px=float(c["reprojection_rms_px"]),
            clock_offset=float(c["clock_offset"]),
            landmarks=int(c.get("landmarks", 0)),
            verdict=str(c.get("verdict", "")),
            why=str(c.get("why", "")),
            covariance=read_covariance(c.get("covariance")),
        )
        for c in document["cameras"]
    )
    rows = document["cameras_covariance"]["matrix"]
    matrix = np.array([[np.nan if v is None else float(v) for v in row] for row in rows], dtype=np.float64)
    size = len(MOUNTING) * len(cameras)
    if matrix.shape != (size, size):
        raise ValueError(f"a covariance of {matrix.shape} for {len(cameras)} cameras")
    diagonal = np.einsum("ii->i", matrix)
    diagonal[np.isnan(diagonal)] = np.inf
    return Rig(
        cameras=cameras,
        covariance=matrix,
        left_out=tuple((str(c["topic"]), str(c["why"])) for c in document["cameras_left_out"]),
        apart=str(document["cameras_apart"]),
        stops=int(document.get("cameras_stops", 0)),
    )
