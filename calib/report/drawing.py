"""Data of a page's drawings as plain numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.stop_residuals import SeenStop
from boxcal.calib.results.trajectory import DrivenLeg, floor_pose
from boxcal.calib.uncertainty.projection import projection_sigma
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target

MAX_CORNERS = 40_000
"""Corners drawn at most; more are thinned out evenly, which the page says."""
_GRID = 24
_LARGEST_PX = 1e4


def residual_data(calibration: Calibration, seen: Sequence[SeenStop]) -> dict[str, Any]:
    """Return all corners, stop by stop: where they were seen and how far from where they were expected."""
    total = sum(len(s.face) for s in seen)
    every = max(1, -(-total // MAX_CORNERS))
    stops = []
    for s in seen:
        rows = np.flatnonzero(np.isfinite(s.error_px).all(axis=1))[::every]
        error = np.clip(s.error_px[rows], -_LARGEST_PX, _LARGEST_PX)
        stops.append(
            {
                "stop": s.label,
                "u": _list(s.view.uv_px[rows, 0], 1),
                "v": _list(s.view.uv_px[rows, 1], 1),
                "du": _list(error[:, 0], 3),
                "dv": _list(error[:, 1], 3),
                "face": s.face[rows].tolist(),
                "wrong": np.flatnonzero(~s.used[rows]).tolist(),
            }
        )
    return {"size": list(calibration.image_size), "every": every, "stops": stops}


def legs_data(legs: Sequence[DrivenLeg]) -> dict[str, Any]:
    """Return the gaps between wheels and images, in mm and degrees."""
    gaps = np.array([leg.gap for leg in legs]).reshape(-1, 3)
    return {
        "names": [leg.name for leg in legs],
        "used": [leg.judged.used if leg.judged else leg.fault is None for leg in legs],
        "forward": _list(gaps[:, 0] * 1e3, 3),
        "left": _list(gaps[:, 1] * 1e3, 3),
        "turn": _list(np.degrees(gaps[:, 2]), 4),
    }


def scene_data(
    calibration: Calibration, seen: Sequence[SeenStop], legs: Sequence[DrivenLeg], target: Target
) -> dict[str, Any]:
    """Return box, tags, stops, cameras and path in frame ``box``, m."""
    box = target.box
    faces = [target.T_box_face(f) for f in range(FACES)]
    return {
        "box": [box.width, box.depth, box.height],
        "faces": [_list(T[:3, 2], 0) for T in faces],
        "tags": [[_list(tag.ravel(), 4), int(f)] for tag, f in zip(target.tag_corners, target.tag_faces, strict=True)],
        "stops": [
            {
                "stop": s.label,
                "cam": _list(s.result.T_box_cam[:3, 3], 4),
                "view": _list(_frustum(calibration, s).ravel(), 4),
                "body": _list(floor_pose(s.result.T_box_cam, calibration.T_body_cam), 4),
                "rms": round(s.result.reprojection_rms_px, 3),
            }
            for s in seen
        ],
        "legs": [
            {
                "path": _list(leg.path.ravel(), 4),
                "used": leg.judged.used if leg.judged else leg.fault is None,
                "name": leg.name,
            }
            for leg in legs
        ],
        "robot": [round(float(calibration.wheels.b), 4), _list(inverse(calibration.T_body_cam)[:3, 3], 4)],
    }


def _frustum(calibration: Calibration, s: SeenStop) -> Array:
    """Return the far corners (4, 3) of what the camera sees, drawn a sixth of the distance to the box."""
    k, (width, height) = calibration.camera, calibration.image_size
    depth = float(np.clip(np.linalg.norm(s.result.T_box_cam[:3, 3]) / 6, 0.05, 0.3))
    u, v = np.array([-0.5, width - 0.5]), np.array([-0.5, height - 0.5])
    x, y = (u - k.cu) / k.fu * depth, (v - k.cv) / k.fv * depth
    corners = np.array([[x[0], y[0], depth], [x[1], y[0], depth], [x[1], y[1], depth], [x[0], y[1], depth]])
    return np.asarray(corners @ s.result.T_box_cam[:3, :3].T + s.result.T_box_cam[:3, 3])


def projection_data(calibration: Calibration) -> dict[str, Any] | None:
    """Return how certain the place of a known point's image is, over the image, at some distances; None if unknown."""
    detail = calibration.detail
    if detail is None or not np.all(np.isfinite(detail.covariance.matrix)):
        return None
    width, height = calibration.image_size
    columns = _GRID if width >= height else max(4, round(_GRID * width / height))
    rows = _GRID if height > width else max(4, round(_GRID * height / width))
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    cov = calibration.projection_covariance
    middle = detail.ground.distance
    maps = []
    for distance in sorted({round(middle, 3), 0.5, 5.0}):
        sigma = projection_sigma(calibration.camera, cov, calibration.T_body_cam, uv_px=uv, distance=distance)
        seen = sigma[np.isfinite(sigma)]
        if len(seen):
            maps.append(
                {
                    "distance": distance,
                    "sigma": [None if not np.isfinite(s) else float(f"{s:.4g}") for s in sigma],
                    "mean": float(np.sqrt(np.mean(seen**2))),
                    "worst": float(seen.max()),
                    "best": float(seen.min()),
                    "chosen": bool(distance == round(middle, 3)),
                }
            )
    if not maps:
        return None
    return {"columns": columns, "rows": rows, "size": [width, height], "maps": maps}


def _list(values: Array, places: int) -> list[float]:
    return np.round(np.asarray(values, dtype=float), places).tolist()  # type: ignore[no-any-return]
