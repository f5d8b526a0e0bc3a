"""Rows of the fleet page: robots, outlier robots, what to do."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import isfinite, pi
from urllib.parse import quote

import numpy as np

from boxcal.calib.assessment.limits import angle, length
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level, Verdict
from boxcal.target.arrays import Array, Mask

REPORT = "report.html"
"""File name of a robot's own report, in the folder that bears its name."""
ODD = 3.5
"""A robot is an outlier where a value lies this many robust standard deviations from the fleet's median."""
ENOUGH = 5
"""Number of robots from which on outliers are reported."""
_ROBUST = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""


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
    """A value of one robot: as shown, as sorted, and whether it is an outlier."""

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
    hardware: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class OddOne:
    """A robot's value that lies far from the fleet's."""

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


def hardware_of(results: Sequence[Calibration]) -> tuple[str, ...]:
    """Return the robots' hardware revisions, as the manifest or ``--hardware`` had them; empty where neither said."""
    return tuple(str(c.provenance.settings.get("hardware") or "") for c in results)


def outlying(values: Array, sigmas: Array, groups: Sequence[str] = ()) -> Mask:
    """Return which values (N, n) lie far from the median of their group, against the group's own spread.

    The spread is the median absolute deviation times 1.4826 (a normal distribution's standard deviation); what the
    calibration itself leaves open is allowed for. Fleets and groups of fewer than five have no outliers.

    Parameters
    ----------
    values, sigmas : (N, n)
        Values, and their standard deviations.
    groups
        The robots' hardware revisions; one group if not given.
    """
    out = np.zeros(np.shape(values), dtype=bool)
    kinds = np.array(groups or [""] * len(values), dtype=object)
    for kind in dict.fromkeys(kinds.tolist()):
        own = np.flatnonzero(kinds == kind)
        if len(own) < ENOUGH:
            continue
        off = np.abs(values[own] - np.median(values[own], axis=0))
        spread = _ROBUST * np.median(off, axis=0)
        known = np.where(np.isfinite(sigmas[own]), sigmas[own], 0.0)
        limit = ODD * np.sqrt(spread**2 + known**2)
        out[own] = off > np.maximum(limit, 1e-12)
    return out


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
        hardware=hardware_of([c])[0],
        cells=tuple(
            Cell(text=p.text(value), value=repr(float(value)), odd=bool(o))
            for p, value, o in zip(PARAMETERS, values, odd, strict=True)
        ),
    )


def _taken_into_account(c: Calibration, v: Verdict) -> list[str]:
    """Return the causes of a robot's catalogue that its result allows for: an owner of many robots looks for those."""
    named = {finding.cause for finding in c.findings}
    return [f"Note: {note.text}" for note in v.notes if note.rule in named]


def odd_list(
    results: Sequence[Calibration], values: Array, odd: Mask, groups: Sequence[str], without_page: Collection[str] = ()
) -> list[OddOne]:
    """Return every outlier in words, with the median of its group."""
    kinds = np.array(groups, dtype=object)
    middles = {kind: np.median(values[kinds == kind], axis=0) for kind in set(kinds.tolist())}
    return [
        OddOne(
            robot=results[i].robot,
            link=robot_link(results[i].robot) if results[i].robot not in without_page else "",
            name=PARAMETERS[k].name.lower(),
            text=f"{PARAMETERS[k].text(values[i, k])} {PARAMETERS[k].unit}".strip(),
            middle=f"{PARAMETERS[k].text(middles[kinds[i]][k])} {PARAMETERS[k].unit}".strip(),
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
