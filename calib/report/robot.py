"""The report of one robot."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from boxcal.calib.assessment.estimate_rules import held_out_ratio
from boxcal.calib.assessment.gauges import gauges, slip_on_top
from boxcal.calib.assessment.verdict import Drives, judge
from boxcal.calib.console.cameras import HEADER, pair_cells
from boxcal.calib.report.cameras import camera_rows
from boxcal.calib.report.drawing import legs_data, projection_data, residual_data, scene_data
from boxcal.calib.report.page import page, readable_time
from boxcal.calib.report.parameters import parameter_groups
from boxcal.calib.report.series import growth_data, growth_rows, held_out_data, held_out_rows
from boxcal.calib.report.tables import (
    extra_rows,
    face_row,
    leg_row,
    noise_rows,
    provenance_rows,
    rms,
    setting_rows,
    singular_ratios,
    stop_row,
)
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.stop_residuals import SeenStop, stops_seen
from boxcal.calib.results.trajectory import driven_legs
from boxcal.calib.results.verdict import Reason, Verdict
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import FACES, Target

SCRIPTS = ("draw.js", "scene.js", "residuals.js", "photographs.js", "charts.js")
FLEET_PAGE = "../fleet.html"
"""Address of the fleet's page from a robot's folder."""
_SINGULAR_LOW = 1e-4
_TELLING = ("around", "legs", "slip", "sharpness", "fit", "print")
"""What a good verdict says first."""


def robot_report(
    calibration: Calibration,
    drives: Drives,
    target: Target,
    *,
    photographs: Mapping[str, bytes] | None = None,
    fleet: str = "",
    seen: tuple[SeenStop, ...] | None = None,
) -> bytes:
    """Return the report of one robot: one HTML file that needs nothing else.

    Parameters
    ----------
    calibration
        What was found; without ``detail`` (the closed form) the report says less.
    drives
        What the robot saw and rolled.
    target
        The landmark table that it was calibrated with.
    photographs
        A JPEG by the label of its stop; stops without one are not shown.
    fleet
        Relative address of the fleet's page, empty without one.
    seen
        The stops that the calibration used, where they are known already.

    Raises
    ------
    CalibError
        If the extra ``report`` is not installed.
    """
    drives, photos = _all(drives), photographs or {}
    seen = stops_seen(calibration, drives, target) if seen is None else seen
    legs = driven_legs(calibration, drives, seen)
    detail = calibration.detail
    projection = projection_data(calibration)
    judged = calibration.verdict or judge(calibration, drives, target)
    return page(
        "robot.html",
        scripts=SCRIPTS,
        data={
            "scene": scene_data(calibration, seen, legs, target),
            "residuals": residual_data(calibration, seen),
            "photographs": {s.label: _embedded(photos[s.label]) for s in seen if s.label in photos},
            "legs": legs_data(legs),
            "growth": growth_data(detail),
            "projection": projection,
            "heldOut": held_out_data(detail),
        },
        c=calibration,
        fleet=fleet,
        photographed=[s for s in seen if s.label in photos],
        when=readable_time(calibration.provenance.created),
        detail=detail,
        verdict=judged,
        shown=_shown(judged),
        gauges=gauges(detail),
        slip=slip_on_top(calibration),
        groups=parameter_groups(calibration),
        cameras=camera_rows(calibration),
        pairs=[] if calibration.rig is None else [pair_cells(pair) for pair in calibration.rig.pairs],
        pair_header=HEADER,
        stops=[stop_row(s) for s in seen],
        faces=[row for f in range(FACES) if (row := face_row(f, seen)) is not None],
        legs=[leg_row(leg) for leg in legs],
        residual_rms=rms(np.concatenate([s.error_px[s.used] for s in seen])) if seen else None,
        wrong=sum(int((~s.used).sum()) for s in seen),
        noise=noise_rows(detail),
        singular=singular_ratios(calibration),
        growth=growth_rows(detail),
        projection=projection,
        held_out=held_out_rows(detail),
        held_out_ratio=held_out_ratio(detail) if detail else None,
        extra=extra_rows(calibration),
        provenance=provenance_rows(calibration),
        settings=setting_rows(calibration),
    )


def _embedded(jpeg: bytes) -> str:
    """Return a JPEG as an address that holds it."""
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"


def _all(drives: Drives) -> tuple[Correspondences, ...]:
    return (drives,) if isinstance(drives, Correspondences) else tuple(drives)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Parts of a verdict: reasons shown first, and those in order, shown on demand."""

    first: tuple[Reason, ...]
    fine: tuple[Reason, ...]


def _shown(judged: Verdict) -> Shown:
    if judged.causes:
        return Shown(first=judged.causes, fine=judged.passed)
    first = tuple(r for r in judged.passed if r.rule in _TELLING)
    return Shown(first=first, fine=tuple(r for r in judged.passed if r.rule not in _TELLING))
