"""Reprojection errors of a calibration, corner by corner."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.four_steps.reprojection import transform
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.target_deformation import DEFORMATIONS, target_deformation
from boxcal.calib.results.calibration import Calibration, StopResult
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import project


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenStop:
    """One stop: its corners, and how far they lie from where the calibration expects them.

    Attributes
    ----------
    drive, number
        Of the drive, and of the stop in it, from 0.
    label
        How people call the stop: its number from 1, with the drive's before it where there are several.
    result, view
        What the calibration found, what the camera saw.
    p_box : (L, 3), m
        The corners, with what was estimated of the box' shape.
    p_cam : (L, 3), m
        The same in frame ``cam``.
    face : (L,)
        Which face carries each.
    error_px : (L, 2)
        Seen less expected.
    used : (L,) bool
        Whether the corner counted.
    """

    drive: int
    number: int
    label: str
    result: StopResult
    view: StopObservation
    p_box: Array
    p_cam: Array
    face: Ids
    error_px: Array
    used: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def stop_label(drive: int, number: int, *, several: bool) -> str:
    """Return how people call a stop: ``4``, or ``2.4`` where there are several drives."""
    return f"{drive + 1}.{number + 1}" if several else str(number + 1)


def stops_seen(calibration: Calibration, drives: Sequence[Correspondences], target: Target) -> tuple[SeenStop, ...]:
    """Return the stops of the drives that the calibration used, in order."""
    camera = calibration.camera
    results = {(stop.drive, stop.t_start_ns): stop for stop in calibration.stops}
    wrong: dict[tuple[int, int], list[int]] = {}
    for corner in calibration.detail.flagged_corners if calibration.detail else ():
        wrong.setdefault((corner.drive, corner.stop), []).append(corner.landmark_id)
    used = [
        (d, number, view)
        for d, drive in enumerate(drives)
        for number, view in enumerate(drive.stops)
        if (d, view.t_start_ns) in results and len(view.landmark_ids)
    ]
    seen = []
    for (d, number, view), p_box in zip(used, _landmarks(calibration, target, [v for *_, v in used]), strict=True):
        result = results[d, view.t_start_ns]
        p_cam = transform(inverse(result.T_box_cam), p_box)
        error = np.full((len(p_cam), 2), np.nan)
        ahead = p_cam[:, 2] > 0
        error[ahead] = view.uv_px[ahead] - project(camera, p_cam[ahead])
        seen.append(
            SeenStop(
                drive=d,
                number=number,
                label=stop_label(d, number, several=len(drives) > 1),
                result=result,
                view=view,
                p_box=p_box,
                p_cam=p_cam,
                face=view.faces,
                error_px=error,
                used=ahead & ~np.isin(view.landmark_ids, wrong.get((d, number), [])),
            )
        )
    return tuple(seen)


def _landmarks(calibration: Calibration, target: Target, views: Sequence[StopObservation]) -> list[Array]:
    """Return the landmarks of each stop (L, 3), m, moved by what was estimated of the box' shape."""
    extra = calibration.detail.extra if calibration.detail else {}
    if not (views and extra.keys() & DEFORMATIONS):
        return [view.p_box for view in views]
    ids, p_box = (np.concatenate([getattr(view, name) for view in views]) for name in ("landmark_ids", "p_box"))
    target_as_built = target_deformation(EstimateOptions(target=target), ids, p_box)
    p = target_as_built.landmarks(np.array([extra.get(name, 0.0) for name in target_as_built.names]))[0]
    return np.split(p, np.cumsum([len(view.landmark_ids) for view in views])[:-1])
