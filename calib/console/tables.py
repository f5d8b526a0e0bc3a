"""Results as plain tables that fit a terminal of 80 columns."""

from collections.abc import Sequence
from math import isfinite, pi
from unicodedata import east_asian_width

import numpy as np

from boxcal.calib.assessment.limits import angle, length
from boxcal.calib.console.judgement import WIDTH
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.each_camera import each_camera

MANY = 20
"""Robots that have a line each in a table; a larger fleet is summed up."""
_LONGEST_NAME = 24
"""Columns that a robot's name takes at most; a longer one is cut in its middle."""
_MM, _DEG = 1e3, 180 / pi


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a text table: the first column to the left, the others to the right; wide characters count as two."""
    widths = [max(columns(line[k]) for line in [header, *rows]) for k in range(len(header))]
    lines = [
        "  ".join(_padded(cell, w, left=k == 0) for k, (cell, w) in enumerate(zip(line, widths, strict=True)))
        for line in [header, ["-" * w for w in widths], *rows]
    ]
    return "\n".join(line.rstrip() for line in lines)


def columns(text: str) -> int:
    """Return how many columns of a terminal a text takes."""
    return sum(2 if east_asian_width(c) in "WF" else 1 for c in text)


def shortened(name: str, most: int = _LONGEST_NAME) -> str:
    """Return a name that takes at most a number of columns: the middle of a longer one is left out."""
    if columns(name) <= most:
        return name
    head, tail = "", ""
    for front, back in zip(name, reversed(name), strict=True):
        if columns(head + front + tail + back) + 1 > most:
            break
        head, tail = head + front, back + tail
    return f"{head}…{tail}"


def verdict_table(results: Sequence[Calibration], *, failed: Sequence[str] = ()) -> str:
    """Return the fleet at a glance: verdict, stops, fit, and what the uncertainty means on the ground."""
    header = ["robot", "verdict", "stops", "corners", "reproj px", "after 10 m", "after a turn"]
    rows = []
    for c in results:
        ground = c.detail.ground if c.detail else None
        rows.append(
            [
                shortened(c.robot),
                str(c.verdict.level) if c.verdict else "",
                str(c.quality.stops),
                str(c.quality.landmarks),
                f"{c.quality.reprojection_rms_px:.3f}",
                length(ground.straight_position) if ground and isfinite(ground.straight_position) else "",
                angle(ground.turn_heading * _DEG) if ground and isfinite(ground.turn_heading) else "",
            ]
        )
        rows += _further_cameras(c)
    rows += [[shortened(robot), "FAILED", *[""] * 5] for robot in failed]
    return table(header, rows)


def _further_cameras(c: Calibration) -> list[list[str]]:
    """Return a row for each camera of a robot after its first: verdict, stops and fit; the ground is the robot's."""
    of_each = zip(each_camera(c), c.rig.cameras if c.rig is not None else (), strict=False)
    return [
        [
            shortened(one.robot),
            camera.verdict,
            str(camera.stops),
            str(camera.landmarks),
            f"{camera.reprojection_rms_px:.3f}",
            "",
            "",
        ]
        for one, camera in list(of_each)[1:]
    ]


def results_tables(results: Sequence[Calibration]) -> str:
    """Return wheels of every robot, and place, direction and focal lengths of its cameras, with standard deviations."""
    cameras = [one for c in results for one in each_camera(c)]
    groups = (
        ("wheels", ("rL mm", "rR mm", "b mm"), _wheels, results),
        ("camera at", ("x mm", "y mm", "z mm"), _place, cameras),
        ("camera looks", ("yaw deg", "pitch deg", "roll deg"), _direction, cameras),
        ("camera", ("fu px", "fv px", "cu px", "cv px"), _camera, cameras),
    )
    out = []
    for title, names, cells, rows in groups:
        found = table([title, *names], [[shortened(c.robot), *cells(c)] for c in rows])
        if max(len(line) for line in found.splitlines()) > WIDTH:  # long names and many digits
            found = table([title, *names], [[shortened(c.robot, 12), *cells(c)] for c in rows])
        out.append(found)
    return "\n\n".join(out)


def _wheels(c: Calibration) -> list[str]:
    return [_cell(c, name, value * _MM, _MM, 3) for name, value in zip(("rL", "rR", "b"), _radii(c), strict=True)]


def _radii(c: Calibration) -> tuple[float, float, float]:
    return c.wheels.rL, c.wheels.rR, c.wheels.b


def _place(c: Calibration) -> list[str]:
    place = c.T_body_cam[:3, 3].tolist()
    return [_cell(c, name, value * _MM, _MM, 2) for name, value in zip(("tx", "ty", "tz"), place, strict=True)]


def _direction(c: Calibration) -> list[str]:
    values, sigmas = np.degrees(c.yaw_pitch_roll), np.degrees(c.yaw_pitch_roll_sigma)
    return [_with_sigma(float(v), float(s), 3) for v, s in zip(values, sigmas, strict=True)]


def _camera(c: Calibration) -> list[str]:
    return [_cell(c, name, getattr(c.camera, name), 1.0, 2) for name in ("fu", "fv", "cu", "cv")]


def _cell(c: Calibration, name: str, value: float, scale: float, digits: int) -> str:
    sigma = c.detail.covariance.sigma[name] * scale if c.detail else np.nan
    return _with_sigma(value, sigma, digits)


def _with_sigma(value: float, sigma: float, digits: int) -> str:
    if np.isnan(sigma):
        return f"{value:.{digits}f}"
    if not isfinite(sigma):
        return f"{value:.{digits}f} ± ?"
    needed = -int(np.floor(np.log10(sigma))) if sigma > 0 else digits
    digits = min(max(digits, needed), digits + 2)  # a sigma is never shown as zero for want of a digit
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def _padded(text: str, width: int, *, left: bool) -> str:
    space = " " * (width - columns(text))
    return text + space if left else space + text
