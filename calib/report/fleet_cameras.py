"""Cameras of a fleet's robots, and the transforms between them, as the fleet page shows them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any
from urllib.parse import quote

import numpy as np

from boxcal.calib.report.fleet_data import once, panels
from boxcal.calib.report.fleet_spread import SpreadRow, spread_rows
from boxcal.calib.report.fleet_tables import (
    PARAMETERS,
    REPORT,
    Cell,
    OddOne,
    Parameter,
    hardware_of,
    outlying,
    parameter_table,
    robot_link,
)
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.each_camera import each_camera
from boxcal.calib.results.rig import CameraPair, RigCamera
from boxcal.calib.results.verdict import Level
from boxcal.target.arrays import Array, Mask

OF_CAMERA = PARAMETERS[3:]
"""Parameters of a camera: all but the wheels'."""
OF_PAIR = tuple(
    Parameter(key=key, name=name, unit=unit, scale=scale, digits=digits)
    for key, name, unit, scale, digits in (
        ("tx", "Right", "mm", 1e3, 2),
        ("ty", "Below", "mm", 1e3, 2),
        ("tz", "In front", "mm", 1e3, 2),
        ("distance", "Apart", "mm", 1e3, 2),
        ("angle", "Turned", "\u00b0", 180 / pi, 3),
    )
)
"""Values of a pair: place of the second camera in the first one's frame, distance, angle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One camera, or one pair of cameras, of one robot.

    Attributes
    ----------
    robot, link
        The robot, and the relative address of the report of this camera; empty without one.
    words
        Camera, verdict's level and causes; or both cameras.
    level
        good, usable, redo; empty where there is none.
    counts
        Stops and reprojection error, of a camera.
    cells
        Values.
    """

    robot: str
    link: str
    words: tuple[str, ...]
    level: str
    counts: tuple[int | float, ...]
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTable:
    """A table of the fleet page.

    Attributes
    ----------
    lines
        Its rows.
    headings
        Of the values.
    data
        The same for the page's script, which sorts and filters.
    odd
        Outliers in words.
    spread
        Spread of each camera's values, or each pair's, over the fleet, by name.
    """

    lines: tuple[Line, ...]
    headings: tuple[Parameter, ...]
    data: dict[str, Any]
    odd: tuple[OddOne, ...]
    spread: tuple[tuple[str, tuple[SpreadRow, ...]], ...]


def camera_table(results: Sequence[Calibration], without_page: Collection[str] = ()) -> CameraTable | None:
    """Return all cameras of robots with several, each compared with those of its name; None without such robots."""
    several = [c for c in results if c.rig is not None and len(c.rig.cameras) > 1]
    found = [(c, one, camera) for c in several for one, camera in _cameras(c)]
    if not found:
        return None
    values, sigmas = (table[:, 3:] for table in parameter_table([one for _, one, _ in found]))
    names = [camera.name for _, _, camera in found]
    groups = _groups([c for c, _, _ in found], names)
    odd = outlying(values, sigmas, groups)
    lines = [
        Line(
            robot=c.robot,
            link="" if c.robot in without_page else _link(c, camera),
            words=(camera.name, camera.why),
            level=camera.verdict,
            counts=(camera.stops, camera.reprojection_rms_px),
            cells=_cells(OF_CAMERA, values[k], odd[k]),
        )
        for k, (c, _, camera) in enumerate(found)
    ]
    return _table(lines, OF_CAMERA, names, groups, (values, sigmas, odd))


def pair_table(results: Sequence[Calibration]) -> CameraTable | None:
    """Return all pairs of cameras, each compared with those of its names; None without any."""
    found = [(c, pair) for c in results if c.rig is not None for pair in c.rig.pairs]
    if not found:
        return None
    estimates = [_values(pair) for _, pair in found]
    values, sigmas = (np.array([f[k] for f in estimates], dtype=float) for k in (0, 1))
    names = [f"{pair.a} to {pair.b}" for _, pair in found]
    groups = _groups([c for c, _ in found], names)
    odd = outlying(values, sigmas, groups)
    lines = [
        Line(
            robot=c.robot,
            link="",
            words=(pair.a, pair.b),
            level="",
            counts=(),
            cells=_cells(OF_PAIR, values[k], odd[k]),
        )
        for k, (c, pair) in enumerate(found)
    ]
    return _table(lines, OF_PAIR, names, groups, (values, sigmas, odd))


def _cameras(c: Calibration) -> list[tuple[Calibration, RigCamera]]:
    return [] if c.rig is None else list(zip(each_camera(c), c.rig.cameras, strict=True))


def _groups(robots: Sequence[Calibration], names: Sequence[str]) -> list[str]:
    """Return what is to be alike: cameras, or pairs, of one name on robots of one hardware revision."""
    return [f"{hardware}\n{name}" for hardware, name in zip(hardware_of(robots), names, strict=True)]


def _link(c: Calibration, camera: RigCamera) -> str:
    """Return the relative address of a camera's report: the first's is the robot's."""
    own = robot_link(c.robot)
    if not own or c.rig is None or camera.name == c.rig.names[0]:
        return own
    return f"{own.removesuffix(REPORT)}{quote(camera.name, safe='')}/{REPORT}"


def _values(pair: CameraPair) -> tuple[list[float], list[float]]:
    (apart, along), (turned, about) = pair.distance, pair.angle
    place = pair.T_a_b[:3, 3].tolist()
    return [*place, apart, turned], [*(pair.sigma[k] for k in ("tx", "ty", "tz")), along, about]


def _cells(parameters: Sequence[Parameter], values: Array, odd: Mask) -> tuple[Cell, ...]:
    return tuple(
        Cell(text=p.text(float(v)), value=repr(float(v)), odd=bool(o))
        for p, v, o in zip(parameters, values, odd, strict=True)
    )


def _table(
    lines: Sequence[Line],
    parameters: tuple[Parameter, ...],
    names: Sequence[str],
    groups: Sequence[str],
    estimates: tuple[Array, Array, Mask],
) -> CameraTable:
    values, sigmas, odd = estimates
    kinds, named = np.array(groups, dtype=object), np.array(names, dtype=object)
    found = [
        OddOne(
            robot=lines[i].robot,
            link=lines[i].link,
            name=f"{names[i]}, {parameters[k].name.lower()}",
            text=_text(parameters[k], values[i, k]),
            middle=_text(parameters[k], float(np.median(values[kinds == kinds[i], k]))),
        )
        for i, k in zip(*np.nonzero(odd), strict=True)
    ]
    spread = [
        (name, tuple(spread_rows(values[named == name], sigmas[named == name], parameters=parameters)))
        for name in dict.fromkeys(names)
        if np.sum(named == name) > 1
    ]
    data = {
        "robots": [line.robot for line in lines],
        "links": [line.link for line in lines],
        "words": [once(column) for column in zip(*(line.words for line in lines), strict=True)],
        "level": [Level(line.level).rank if line.level else None for line in lines],
        "counts": [list(column) for column in zip(*(line.counts for line in lines), strict=True)],
        "panels": panels(parameters, values, sigmas, odd),
    }
    return CameraTable(lines=tuple(lines), headings=parameters, data=data, odd=tuple(found), spread=tuple(spread))


def _text(p: Parameter, value: float) -> str:
    return f"{p.text(value)} {p.unit}".strip()
