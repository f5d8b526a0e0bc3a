"""``fleet.csv``: one line a robot, for spreadsheets and scripts; ``fleet-columns.csv`` says what its columns are."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain

from boxcal.calib.exports.text import number
from boxcal.calib.geometry.euler import quaternion
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.results.calibration import Calibration
from boxcal.target.camera.distortion import DISTORTION_NAMES, CameraKind

_UNIT = dict(zip(ORDER, ["_px"] * 4 + [""] + ["_m"] * 3 + ["_rad"] * 3 + ["_m"] * 3, strict=True))
_FURTHER = DISTORTION_NAMES[CameraKind.RATIONAL][1:]
_FORMULA = tuple("=+-@\uff1d\uff0b\uff0d\uff20")
_JUDGED = {
    "robot": "name, as its log's",
    "verdict": "good, usable or redo; failed where the robot has no calibration",
    "why": "causes of a verdict that is not good",
    "do": "what to do about them",
    "noted": "what was solved for and taken into account, and what could not be checked",
    "stale": "why the values are out of date; empty if they are not",
    "error": "why the last log gave no calibration; empty if it did",
}
_VALUES = {
    "stops": "stops used",
    "landmarks": "corners used, over all stops",
    "reprojection_rms_px": "root mean square 2-D reprojection error, px",
    "camera_model": "radial, brown, rational or fisheye (OpenCV's models)",
    "fu_px": "focal length across, px",
    "fv_px": "focal length down, px",
    "cu_px": "principal point across, px; pixel (0, 0) is the centre of the top-left pixel",
    "cv_px": "principal point down, px",
    "kr": "first radial distortion coefficient, OpenCV's k1",
    **{name: f"distortion coefficient {name} of OpenCV's; empty where the model has none" for name in _FURTHER},
    "rR_m": "radius of the right wheel, m",
    "rL_m": "radius of the left wheel, m",
    "b_m": "wheel separation, m",
    "x_m": "camera's place: forward of the middle of the axle, m (T_body_cam maps camera points to the body)",
    "y_m": "to the left of it, m",
    "z_m": "above the floor, m",
    "qx": "orientation of the camera's optical frame (x right, y down, z forward) in the body, quaternion",
    "qy": "",
    "qz": "",
    "qw": "",
    "yaw_rad": "where the camera looks: to the left, rad",
    "pitch_rad": "down, rad",
    "roll_rad": "about its line of sight, rad",
}
_SIGMAS = {
    **{f"sigma_{n}{_UNIT[n]}": "standard deviation; empty if not estimated, inf if not determined" for n in ORDER},
    "straight_position_m": "position error after 10 m straight ahead from the calibration's uncertainty, m",
    "straight_heading_rad": "heading error after 10 m straight ahead, rad",
    "turn_heading_rad": "heading error after one turn on the spot, rad",
}
_END = {
    "notes": "what the calibration noted",
    "created": "when, ISO 8601 (UTC)",
    "version": "of boxcal",
    "cameras": "the robot's cameras where it has several; the row is of the first, fleet-cameras.csv has all",
}
COLUMNS: Mapping[str, str] = {**_JUDGED, **_VALUES, **_SIGMAS, **_END}
"""Name of each column, with its meaning and unit."""
TEXTS = frozenset({*_JUDGED, *_END, "camera_model"})
"""Columns of text; the others hold numbers."""


def fleet_rows(
    calibrations: Iterable[Calibration],
    *,
    errors: Mapping[str, str] | None = None,
    stale: Mapping[str, str] | None = None,
) -> list[dict[str, str]]:
    """Return the rows of the table of a fleet, by column; what is missing is empty, no text can be a formula.

    Parameters
    ----------
    calibrations
        Of the robots that have one.
    errors, stale
        By robot: why its last log gave none; why its values are none of today.
    """
    return list(each_row(calibrations, errors=errors or {}, stale=stale or {}))


def each_row(
    calibrations: Iterable[Calibration], *, errors: Mapping[str, str], stale: Mapping[str, str]
) -> Iterator[dict[str, str]]:
    """Yield the rows that :func:`fleet_rows` returns, of fleets too large to hold them all."""
    seen = set()
    for c in calibrations:
        seen.add(c.robot)
        yield _row(c, errors.get(c.robot, ""), stale.get(c.robot, ""))
    for robot in errors:
        if robot not in seen:
            yield {"robot": cell(robot), "verdict": "failed", "error": cell(errors[robot])}


def fleet_csv(rows: Iterable[Mapping[str, str]], columns: Mapping[str, str] = COLUMNS) -> bytes:
    """Return the table of a fleet, or one with other columns (RFC 4180, UTF-8), its header in line 1."""
    return _written(chain([list(columns)], ([row.get(name, "") for name in columns] for row in rows)))


def columns_csv(columns: Mapping[str, str] = COLUMNS) -> bytes:
    """Return the legend of a table: column, meaning."""
    return _written([["column", "meaning"], *([name, text] for name, text in columns.items())])


def cell(text: str) -> str:
    """Return text for a cell: on one line, never a formula or a comment."""
    line = "".join(c if c.isprintable() else " " for c in text)
    return f"'{line}" if line.lstrip().startswith((*_FORMULA, "#")) else line


def _written(rows: Iterable[list[str]]) -> bytes:
    out = io.StringIO()
    csv.writer(out).writerows(rows)
    return out.getvalue().encode("utf-8", "replace")


def values_of(c: Calibration) -> dict[str, str]:
    """Return the cells of a result's values and their standard deviations, by column."""
    k, w, t, R = c.camera, c.wheels, c.T_body_cam[:3, 3].tolist(), c.T_body_cam[:3, :3]
    values = [c.quality.reprojection_rms_px, k.fu, k.fv, k.cu, k.cv, k.kr, w.rR, w.rL, w.b, *t]
    values += [*quaternion(R), *c.yaw_pitch_roll]
    names = [n for n in _VALUES if n not in {"stops", "landmarks", "camera_model", *_FURTHER}]
    row = {name: number(value) for name, value in zip(names, values, strict=True)}
    row |= {"stops": str(c.quality.stops), "landmarks": str(c.quality.landmarks), "camera_model": str(k.kind)}
    row |= {name: number(value) for name, value in k.further.items()}
    if c.detail is not None:
        sigma, ground = c.detail.covariance.sigma, c.detail.ground
        sigmas = [*(sigma[name] for name in ORDER), ground.straight_position, ground.straight_heading]
        row |= {name: number(v) for name, v in zip(_SIGMAS, [*sigmas, ground.turn_heading], strict=True)}
    return row


def _row(c: Calibration, error: str, stale: str) -> dict[str, str]:
    row = values_of(c)
    row |= {"robot": cell(c.robot), "notes": cell("; ".join(c.notes)), "error": cell(error), "stale": cell(stale)}
    row |= {"cameras": "" if c.rig is None else cell(" ".join(c.rig.names))}
    return row | {"created": cell(c.provenance.created), "version": cell(c.provenance.version)} | _judged(c)


def _judged(c: Calibration) -> dict[str, str]:
    if c.verdict is None:
        return {}
    good = not c.verdict.causes
    return {
        "verdict": str(c.verdict.level),
        "why": cell(" ".join(reason.text for reason in c.verdict.causes)),
        "do": "" if good else cell(" ".join(c.verdict.next_steps)),
        "noted": cell(" ".join(reason.text for reason in (*c.verdict.notes, *c.verdict.unchecked))),
    }
