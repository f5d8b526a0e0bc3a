"""Rows of the fleet page: robots, their spread, outlier robots, what to do, and the box as each robot found it."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, pi
from urllib.parse import quote

import numpy as np

from boxcal.calib.assessment.limits import angle, length
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.unknowns import describe
from boxcal.calib.results.verdict import Level, Verdict
from boxcal.target.arrays import Array, Mask

REPORT = "report.html"
"""File name of a robot's own report, in the folder that bears its name."""
ODD = 3.5
"""A robot is an outlier where a figure lies this many robust standard deviations from the fleet's median."""
ENOUGH = 5
"""Robots from which on outliers are told."""
_ROBUST = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""
_SHAPE = re.compile(r"scale_[xy]|width|depth|seat|ink|bow\d|face\d_\w\w")


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A column: key, name, unit, what SI is multiplied with, digits after the point."""

    key: str
    name: str
    unit: str
    scale: float
    digits: int

    def text(self, value: float) -> str:
        """Return a value in SI as it is shown."""
        return f"{value * self.scale:.{self.digits}f}".replace("-", "\N{MINUS SIGN}")


PARAMETERS = tuple(
    Parameter(key=key, name=name, unit=unit, scale=scale, digits=digits)
    for key, name, unit, scale, digits in (
        ("rL", "Left radius", "mm", 1e3, 3),
        ("rR", "Right radius", "mm", 1e3, 3),
        ("b", "Wheel separation", "mm", 1e3, 2),
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
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A figure of one robot: as shown, as sorted, and whether it is an outlier."""

    text: str
    value: str
    odd: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotRow:
    """One robot of the fleet's table; lengths in m and angles in rad where they are numbers."""

    robot: str
    link: str
    level: str
    rank: int
    why: str
    stale: str
    straight: float | None
    straight_text: str
    turn: float | None
    turn_text: str
    stops: int
    rms: float
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadRow:
    """One parameter over the fleet: median, least, largest, standard deviation; the calibrations' own sigma."""

    key: str
    name: str
    unit: str
    cells: tuple[str, ...]
    sigma: str


@dataclass(frozen=True, slots=True, kw_only=True)
class OddOne:
    """A robot's figure that lies far from the fleet's."""

    robot: str
    link: str
    name: str
    text: str
    middle: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Next step of a fleet, and the robots that need it."""

    text: str
    robots: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeRow:
    """One figure of the box as each robot found it: texts in the robots' order, and whether they agree."""

    words: str
    unit: str
    cells: tuple[str, ...]
    agree: bool


def parameter_table(results: Sequence[Calibration]) -> tuple[Array, Array]:
    """Return all parameters and their standard deviations (NaN where unknown), (N, 14) each, SI."""
    values, sigmas = [], []
    for c in results:
        k, w, t = c.camera, c.wheels, c.T_body_cam[:3, 3]
        values.append([w.rL, w.rR, w.b, *t, *c.yaw_pitch_roll, k.fu, k.fv, k.cu, k.cv, k.kr])
        if c.detail is None:
            sigmas.append([np.nan] * len(PARAMETERS))
            continue
        s = c.detail.covariance.sigma
        turns = dict(zip(("yaw", "pitch", "roll"), c.yaw_pitch_roll_sigma.tolist(), strict=True))
        sigmas.append([turns[p.key] if p.key in turns else s[p.key] for p in PARAMETERS])
    shape = (len(results), len(PARAMETERS))
    return np.array(values, dtype=float).reshape(shape), np.array(sigmas, dtype=float).reshape(shape)


def odd_ones(values: Array, sigmas: Array) -> Mask:
    """Return which figures (N, n) lie far from the fleet's median, against the fleet's own spread.

    The spread is the median absolute deviation times 1.4826 (a normal distribution's standard deviation); what the
    calibration itself leaves open is allowed for. Fleets of fewer than five have no outliers.
    """
    if len(values) < ENOUGH:
        return np.zeros(np.shape(values), dtype=bool)
    off = np.abs(values - np.median(values, axis=0))
    spread = _ROBUST * np.median(off, axis=0)
    own = np.where(np.isfinite(sigmas), sigmas, 0.0)
    limit = ODD * np.sqrt(spread**2 + own**2)
    return np.asarray(off > np.maximum(limit, 1e-12))


def robot_link(robot: str) -> str:
    """Return the relative address of a robot's report; it stays below the fleet's folder whatever the name."""
    name = quote(robot, safe="")
    return f"./{name}/{REPORT}" if robot not in {"", ".", ".."} else ""


def robot_row(c: Calibration, v: Verdict, values: Array, odd: Mask, stale: str, *, linked: bool = True) -> RobotRow:
    """Return one robot's row, with a link to its report if it has one."""
    ground = c.detail.ground if c.detail else None
    return RobotRow(
        robot=c.robot,
        link=robot_link(c.robot) if linked else "",
        level=v.level.value,
        rank=v.level.rank,
        why=" ".join((*(cause.text for cause in v.causes), *_taken_into_account(c, v))),
        stale=stale,
        straight=ground.straight_position if ground and isfinite(ground.straight_position) else None,
        straight_text=length(ground.straight_position) if ground else "",
        turn=ground.turn_heading if ground and isfinite(ground.turn_heading) else None,
        turn_text=angle(ground.turn_heading * 180 / pi) if ground else "",
        stops=c.quality.stops,
        rms=c.quality.reprojection_rms_px,
        cells=tuple(
            Cell(text=p.text(value), value=repr(float(value)), odd=bool(o))
            for p, value, o in zip(PARAMETERS, values, odd, strict=True)
        ),
    )


def _taken_into_account(c: Calibration, v: Verdict) -> list[str]:
    """Return the causes of a robot's catalogue that its result allows for: an owner of many robots looks for those."""
    named = {finding.cause for finding in c.findings}
    return [f"Note: {note.text}" for note in v.notes if note.rule in named]


def spread_rows(values: Array, sigmas: Array) -> list[SpreadRow]:
    """Return the spread of every parameter over the fleet."""
    rows = []
    for k, p in enumerate(PARAMETERS):
        column, sigma = values[:, k], sigmas[:, k] * p.scale
        known = sigma[np.isfinite(sigma)]
        figures = (np.median(column), column.min(), column.max(), np.std(column, ddof=1))
        rows.append(
            SpreadRow(
                key=p.key,
                name=p.name,
                unit=p.unit,
                cells=tuple(p.text(float(v)) for v in figures),
                sigma=f"{np.median(known):.2g}" if len(known) else "",
            )
        )
    return rows


def odd_list(
    results: Sequence[Calibration], values: Array, odd: Mask, without_page: Collection[str] = ()
) -> list[OddOne]:
    """Return every outlier in words."""
    middle = np.median(values, axis=0) if len(values) else np.zeros(len(PARAMETERS))
    return [
        OddOne(
            robot=results[i].robot,
            link=robot_link(results[i].robot) if results[i].robot not in without_page else "",
            name=PARAMETERS[k].name.lower(),
            text=f"{PARAMETERS[k].text(values[i, k])} {PARAMETERS[k].unit}".strip(),
            middle=f"{PARAMETERS[k].text(middle[k])} {PARAMETERS[k].unit}".strip(),
        )
        for i, k in zip(*np.nonzero(odd), strict=True)
    ]


def steps(results: Sequence[Calibration], verdicts: Sequence[Verdict]) -> list[Step]:
    """Return what to do now, each step with the robots that need it, the worst robots' first."""
    who: dict[str, list[str]] = {}
    for c, v in sorted(zip(results, verdicts, strict=True), key=lambda pair: -pair[1].level.rank):
        if v.level is not Level.GOOD:
            for step in v.next_steps:
                who.setdefault(step, []).append(c.robot)
    return [Step(text=text, robots=tuple(robots)) for text, robots in who.items()]


def shape_rows(results: Sequence[Calibration]) -> list[ShapeRow]:
    """Return the box's figures that two robots and more solved for, side by side: all drove around one box."""
    found: list[Mapping[str, float]] = [c.detail.extra if c.detail else {} for c in results]
    names = [n for n in dict.fromkeys(n for extra in found for n in extra) if _SHAPE.fullmatch(n)]
    rows = []
    for name in names:
        pairs = [
            (c.detail.extra[name], c.detail.extra_sigma.get(name, np.inf)) if c.detail and name in extra else None
            for c, extra in zip(results, found, strict=True)
        ]
        known = np.array([p for p in pairs if p is not None and isfinite(p[1]) and p[1] > 0])
        if len(known) < 2:
            continue
        weight = known[:, 1] ** -2
        mean = float(np.sum(weight * known[:, 0]) / np.sum(weight))
        unknown = describe(name)
        rows.append(
            ShapeRow(
                words=unknown.words,
                unit=unknown.unit,
                cells=tuple(
                    "" if p is None else f"{p[0] * unknown.scale:.3g} ± {p[1] * unknown.scale:.2g}".replace("-", "−")
                    for p in pairs
                ),
                agree=bool(np.all(np.abs(known[:, 0] - mean) < ODD * known[:, 1])),
            )
        )
    return rows
