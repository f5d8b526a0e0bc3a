"""The report of a fleet: which robots can be used, how alike they are, and what became of those that failed."""

from collections.abc import Sequence
from math import isfinite, pi
from typing import Any
from urllib.parse import quote

import numpy as np

from boxcal.calib.assessment.limits import angle, length
from boxcal.calib.assessment.verdict import verdict
from boxcal.calib.report.page import page, readable_time
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level, Verdict
from boxcal.target.errors import BoxcalError

REPORT = "report.html"
"""File name of a robot's own report, in the folder that bears its name."""
ODD = 3.5
"""A robot is called odd where a figure lies this many robust standard deviations from the fleet's median."""
_ENOUGH = 5
_PARAMETERS = (
    ("rL", "Left radius", "mm", 1e3, 3),
    ("rR", "Right radius", "mm", 1e3, 3),
    ("b", "Wheelbase", "mm", 1e3, 2),
    ("tx", "Camera forward", "mm", 1e3, 1),
    ("ty", "Camera left", "mm", 1e3, 1),
    ("tz", "Camera height", "mm", 1e3, 1),
    ("yaw", "Yaw", "°", 180 / pi, 2),
    ("pitch", "Pitch", "°", 180 / pi, 2),
    ("roll", "Roll", "°", 180 / pi, 2),
    ("fu", "Focal length u", "px", 1.0, 1),
    ("fv", "Focal length v", "px", 1.0, 1),
    ("cu", "Principal point u", "px", 1.0, 1),
    ("cv", "Principal point v", "px", 1.0, 1),
    ("kr", "Distortion", "", 1.0, 4),
)


def fleet_report(
    results: Sequence[Calibration],
    failures: Sequence[BoxcalError],
) -> bytes:
    """Return the report of a fleet: one HTML file that needs nothing else.

    It links to ``<robot>/report.html`` beside it.

    Parameters
    ----------
    results
        The robots that were calibrated; one that does not carry a verdict is judged by itself.
    failures
        Why the others were not.

    Raises
    ------
    CalibError
        If the extra ``report`` is not installed.
    """
    verdicts = [c.verdict or verdict(c) for c in results]
    values, sigmas = _table(results)
    odd = odd_ones(values, sigmas)
    order = sorted(range(len(results)), key=lambda i: (-_rank(verdicts[i].level), results[i].robot))
    return page(
        "fleet.html",
        scripts=("draw.js", "fleet.js"),
        data={
            "robots": [c.robot for c in results],
            "panels": [
                {
                    "key": key,
                    "name": name,
                    "unit": unit,
                    "value": [_number(v * scale) for v in values[:, k]],
                    "sigma": [_number(s * scale) for s in sigmas[:, k]],
                    "odd": odd[:, k].tolist(),
                }
                for k, (key, name, unit, scale, _) in enumerate(_PARAMETERS)
            ],
        },
        counts={level.value: sum(v.level is level for v in verdicts) for level in Level},
        robots=[_row(results[i], verdicts[i], values[i], odd[i]) for i in order],
        headings=[(key, name, unit) for key, name, unit, _, _ in _PARAMETERS],
        failures=failures,
        spread=_spread(values, sigmas) if len(results) > 1 else [],
        odd=_odd_list(results, values, odd),
        steps=_steps(results, verdicts),
        enough=_ENOUGH,
        version=results[0].provenance.version if results else "",
        created=readable_time(max((c.provenance.created for c in results), default="")),
    )


def robot_link(robot: str) -> str:
    """Return the relative address of a robot's report; it stays below the fleet's folder whatever the name."""
    name = quote(robot, safe="")
    return f"./{name}/{REPORT}" if robot not in {"", ".", ".."} else ""


def _rank(level: Level) -> int:
    return (Level.GOOD, Level.USABLE, Level.REDO).index(level)


def _table(results: Sequence[Calibration]) -> tuple[Any, Any]:
    """Return all parameters and their standard deviations (NaN where unknown), (N, 14) each, SI."""
    values, sigmas = [], []
    for c in results:
        k, w, t = c.camera, c.wheels, c.T_body_cam[:3, 3]
        values.append([w.rL, w.rR, w.b, *t, *c.yaw_pitch_roll, k.fu, k.fv, k.cu, k.cv, k.kr])
        if c.detail is None:
            sigmas.append([np.nan] * len(_PARAMETERS))
            continue
        s = c.detail.covariance.sigma
        turns = dict(zip(("yaw", "pitch", "roll"), c.yaw_pitch_roll_sigma, strict=True))
        sigmas.append([float(turns[key]) if key in turns else s[key] for key, *_ in _PARAMETERS])
    shape = (len(results), len(_PARAMETERS))
    return np.array(values, dtype=float).reshape(shape), np.array(sigmas, dtype=float).reshape(shape)


def odd_ones(values: Any, sigmas: Any) -> Any:
    """Return which figures (N, n) lie far from the fleet's median, against the fleet's own spread.

    The spread is the median absolute deviation times 1.4826 (a normal distribution's standard deviation); what the
    calibration itself leaves open is allowed for. Fleets of fewer than five have no odd ones.
    """
    if len(values) < _ENOUGH:
        return np.zeros(np.shape(values), dtype=bool)
    off = np.abs(values - np.median(values, axis=0))
    spread = 1.4826 * np.median(off, axis=0)
    own = np.where(np.isfinite(sigmas), sigmas, 0.0)
    limit = ODD * np.sqrt(spread**2 + own**2)
    return off > np.maximum(limit, 1e-12)


def _row(c: Calibration, v: Verdict, values: Any, odd: Any) -> dict[str, Any]:
    ground = c.detail.ground if c.detail else None
    worst = v.reasons[0]
    return {
        "robot": c.robot,
        "link": robot_link(c.robot),
        "level": v.level.value,
        "rank": _rank(v.level),
        "why": worst.text if v.level is not Level.GOOD else "",
        "straight": ground.straight_position if ground and isfinite(ground.straight_position) else None,
        "straight_text": length(ground.straight_position) if ground else "",
        "turn": ground.turn_heading if ground and isfinite(ground.turn_heading) else None,
        "turn_text": angle(ground.turn_heading * 180 / pi) if ground else "",
        "stops": len(c.stops),
        "rms": c.quality.reprojection_rms_px,
        "cells": [
            {
                "text": f"{value * scale:.{digits}f}".replace("-", "\N{MINUS SIGN}"),
                "value": repr(float(value)),
                "odd": bool(o),
            }
            for (_, _, _, scale, digits), value, o in zip(_PARAMETERS, values, odd, strict=True)
        ],
    }


def _spread(values: Any, sigmas: Any) -> list[dict[str, Any]]:
    rows = []
    for k, (key, name, unit, scale, digits) in enumerate(_PARAMETERS):
        column, sigma = values[:, k] * scale, sigmas[:, k] * scale
        known = sigma[np.isfinite(sigma)]
        rows.append(
            {
                "key": key,
                "name": name,
                "unit": unit,
                "cells": [
                    f"{v:.{digits}f}".replace("-", "\N{MINUS SIGN}")
                    for v in (np.median(column), column.min(), column.max(), np.std(column, ddof=1))
                ],
                "sigma": f"{np.median(known):.2g}" if len(known) else "",
            }
        )
    return rows


def _odd_list(results: Sequence[Calibration], values: Any, odd: Any) -> list[dict[str, str]]:
    middle = np.median(values, axis=0) if len(values) else np.zeros(len(_PARAMETERS))
    return [
        {
            "robot": results[i].robot,
            "link": robot_link(results[i].robot),
            "name": _PARAMETERS[k][1].lower(),
            "text": f"{values[i, k] * _PARAMETERS[k][3]:.{_PARAMETERS[k][4]}f} {_PARAMETERS[k][2]}".strip(),
            "middle": f"{middle[k] * _PARAMETERS[k][3]:.{_PARAMETERS[k][4]}f} {_PARAMETERS[k][2]}".strip(),
        }
        for i, k in zip(*np.nonzero(odd), strict=True)
    ]


def _steps(results: Sequence[Calibration], verdicts: Sequence[Verdict]) -> list[dict[str, Any]]:
    """Return what to do now, each step with the robots that need it, the worst robots' first."""
    who: dict[str, list[str]] = {}
    pressing = sorted(zip(results, verdicts, strict=True), key=lambda pair: -_rank(pair[1].level))
    for c, v in pressing:
        if v.level is not Level.GOOD:
            for step in v.next_steps:
                who.setdefault(step, []).append(c.robot)
    return [{"text": text, "robots": robots} for text, robots in who.items()]


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if isfinite(value) else None
