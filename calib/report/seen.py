"""What was seen against what the calibration expects, corner by corner."""

from dataclasses import dataclass

import numpy as np

from calib.estimate.box_shape import box_shape
from calib.estimate.lens import Lens, project_lens
from calib.estimate.options import EstimateOptions
from calib.frames import Array, inverse
from calib.reprojection import transform
from calib.result import Calibration, StopResult
from detect.correspondences import Correspondences, StopView
from detect.wheels import Ids
from target.box import CORNERS, Target


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenStop:
    """One stop: its corners, and how far they lie from where the calibration expects them.

    Attributes
    ----------
    number
        Of the stop in the drive, from 0.
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

    number: int
    result: StopResult
    view: StopView
    p_box: Array
    p_cam: Array
    face: Ids
    error_px: Array
    used: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def lens_values(calibration: Calibration) -> tuple[Lens, Array]:
    """Return the lens model and its coefficients (fu, fv, cu, cv, kr, further ones)."""
    k, detail = calibration.camera, calibration.detail
    extra = list(detail.lens_extra.values()) if detail else []
    return Lens(detail.lens) if detail else Lens.RADIAL, np.array([k.fu, k.fv, k.cu, k.cv, k.kr, *extra])


def stops_seen(calibration: Calibration, drive: Correspondences, target: Target) -> tuple[SeenStop, ...]:
    """Return the stops of a drive that the calibration used, in order."""
    lens, values = lens_values(calibration)
    results = {stop.t_start_ns: stop for stop in calibration.stops}
    wrong = {(c.stop, c.landmark_id) for c in calibration.detail.flagged_corners} if calibration.detail else set()
    seen = []
    for number, view in enumerate(drive.stops):
        result = results.get(view.t_start_ns)
        if result is None or not len(view.landmark_ids):
            continue
        p_box = _landmarks(calibration, target, view)
        p_cam = transform(inverse(result.T_box_cam), p_box)
        error = np.full((len(p_cam), 2), np.nan)
        ahead = p_cam[:, 2] > 0
        error[ahead] = view.uv_px[ahead] - project_lens(lens, values, p_cam[ahead])[0]
        rows = [target.row_of(int(i) // CORNERS) for i in view.landmark_ids]
        seen.append(
            SeenStop(
                number=number,
                result=result,
                view=view,
                p_box=p_box,
                p_cam=p_cam,
                face=target.tag_faces[rows],
                error_px=error,
                used=ahead & np.array([(number, int(i)) not in wrong for i in view.landmark_ids]),
            )
        )
    return tuple(seen)


def _landmarks(calibration: Calibration, target: Target, view: StopView) -> Array:
    """Return a stop's landmarks (L, 3), m, moved by what was estimated of the box' shape."""
    extra = calibration.detail.extra if calibration.detail else {}
    options = EstimateOptions(
        scale_sigma=float("scale_x" in extra),
        ink_sigma=float("ink" in extra),
        face_sigma=(1.0, 1.0) if "face1_tx" in extra else (0.0, 0.0),
        target=target,
    )
    shape = box_shape(options, view.landmark_ids, view.p_box)
    return shape.landmarks(np.array([extra[name] for name in shape.names]))[0]
