"""Pages of a fleet's history: one of the fleet, one a robot."""

import hashlib
import os
from collections.abc import Iterator, Sequence
from math import isfinite, sqrt
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from boxcal.calib.console.history import drift_text, due_text, event_text, pending_text, short_event
from boxcal.calib.history.channels import CHANNELS, KEYS
from boxcal.calib.history.fleet_history import FleetHistory, RobotHistory
from boxcal.calib.report.fleet_tables import REPORT
from boxcal.calib.report.page import ROWS, page
from boxcal.version import installed_version

PAGE = "history.html"
_SHOWN = ("rL", "rR", "b", "ry", "rx", "rz", "tx", "ty", "tz", "f", "cu", "cv")
_LONGEST = 150


def history_pages(
    history: FleetHistory, wanted: Sequence[str] = (), *, results: Path | None = None, out: Path = Path()
) -> Iterator[tuple[str, bytes]]:
    """Yield the pages of a history, each with the path below their folder: the fleet's, then the robots'.

    Parameters
    ----------
    history
        Of the fleet.
    wanted
        Robots that get a page; all if none is named.
    results, out
        Folder of results, to whose reports pages link where there are any; folder that the pages go to.

    Raises
    ------
    CalibError
        If the extra ``report`` is not installed.
    """
    own = [r for r in history.robots if not wanted or r.robot in wanted]
    linked = {r.robot for r in own}
    yield PAGE, _fleet_page(history, linked)
    for robot in own:
        yield f"robots/{file_name(robot.robot)}", _robot_page(history, robot, _report_link(robot.robot, results, out))


def file_name(robot: str) -> str:
    """Return the name of a robot's page: no name leaves the folder, or is too long for it."""
    name = quote(robot, safe=" ")
    if len(name) > _LONGEST or name.startswith("."):
        name = hashlib.sha256(robot.encode()).hexdigest()
    return f"{name}.html"


def _report_link(robot: str, results: Path | None, out: Path) -> str:
    parts = robot.split("/")  # a further camera of a robot: robot/camera
    if results is None or len(parts) > 2 or {"", ".", ".."} & set(parts) or not (results / robot / REPORT).is_file():
        return ""
    return quote(os.path.relpath(results / robot / REPORT, out / "robots").replace(os.sep, "/"))


def _fleet_page(history: FleetHistory, linked: set[str]) -> bytes:
    robots = history.robots
    changes = [(r, e) for r in robots for e in r.events]
    changes.sort(key=lambda pair: pair[1].found, reverse=True)
    rows = [_row(r, linked) for r in robots]
    order = sorted(range(len(robots)), key=lambda i: (not robots[i].watched.pending, not robots[i].events, i))
    return page(
        "history.html",
        scripts=("draw.js", "table.js", "history_table.js"),
        data={"robots": [r.robot for r in robots], "rows": rows, "order": order},
        count=len(robots),
        drives=sum(len(r.sessions) for r in robots),
        changed=sum(bool(r.events) for r in robots),
        pending=[(r.robot, pending_text(group)) for r in robots for group in r.watched.pending],
        due=sum(r.due_now for r in robots),
        changes=[(r.robot, _link(r.robot, linked), event_text(e)) for r, e in changes],
        rows=[rows[i] for i in order[:ROWS]],
        shown=ROWS,
        scatter=_scatter_rows(history),
        level=history.level,
        judged=history.judged,
        version=installed_version(),
        last=max(r.sessions[-1].date for r in robots),
    )


def _link(robot: str, linked: set[str]) -> str:
    return f"./robots/{quote(file_name(robot))}" if robot in linked else ""


def _row(r: RobotHistory, linked: set[str]) -> dict[str, Any]:
    def rate(key: str) -> float | None:
        t = r.trends[key]
        return float(f"{100 * t.rate:.4g}") if isfinite(t.rate) and isfinite(t.sigma) else None

    changes = [short_event(e) for e in r.events[-2:]] + (["drive again"] if r.watched.pending else [])
    scatter = r.scatter[KEYS.index("rL")] * 100
    return {
        "robot": r.robot,
        "link": _link(r.robot, linked),
        "hardware": r.hardware,
        "drives": len(r.sessions),
        "last": r.sessions[-1].date,
        "left": rate("rL"),
        "left_said": drift_text(r.trends["rL"]),
        "right": rate("rR"),
        "right_said": drift_text(r.trends["rR"]),
        "scatter": float(f"{scatter:.2g}") if isfinite(scatter) else None,
        "due": due_text(r),
        "due_key": "" if r.due_now else r.due or "9999",
        "changes": "; ".join(changes),
    }


def _scatter_rows(history: FleetHistory) -> list[tuple[str, ...]]:
    """Return, by value: name, unit, what calibrations claim, what lies between drives, its fraction in percent."""
    rows: list[tuple[str, ...]] = []
    for j, c in enumerate(CHANNELS):
        claimed = np.concatenate([r.series.variances[:, j] for r in history.robots])
        claimed = claimed[np.isfinite(claimed)]
        component, sigma = float(history.scatter.component[j]), float(history.scatter.sigma[j])
        if not isfinite(component) or not len(claimed):
            continue
        own, between = sqrt(float(np.median(claimed))), sqrt(component)
        apart = sigma / (2 * between) if between > 0 else sqrt(sigma) if isfinite(sigma) else 0.0
        rows.append(
            (
                c.name,
                c.unit,
                f"{own * c.scale:.2g}",
                f"{between * c.scale:.2g} ± {apart * c.scale:.1g}",
                f"{100 * component / (component + own**2):.0f}" if component + own**2 > 0 else "",
            )
        )
    return rows


def _robot_page(history: FleetHistory, r: RobotHistory, report: str) -> bytes:
    return page(
        "robot_history.html",
        scripts=("draw.js", "history.js"),
        data={"dates": [s.date for s in r.sessions], "years": r.series.years.tolist(), "panels": _panels(r)},
        robot=r.robot,
        report=report,
        hardware=r.hardware,
        drives=len(r.sessions),
        last=r.sessions[-1].date,
        events=[event_text(e) for e in r.events],
        pending=[pending_text(group) for group in r.watched.pending],
        notes=[(s.key[:8], note) for s in r.sessions for note in s.notes],
        left=drift_text(r.trends["rL"]),
        right=drift_text(r.trends["rR"]),
        due=due_text(r),
        sessions=[
            (
                s.date,
                s.verdict or "not told",
                *(f"{1e3 * v:.3f}" for v in (s.wheels[1], s.wheels[0])),
                f"{1e3 * s.wheels[2]:.2f}",
                *(f"{1e3 * v:.1f}" for v in s.T_body_cam[:3, 3]),
                f"{s.camera[0]:.2f}",
                s.key[:8],
            )
            for s in reversed(r.sessions)
        ],
        level=history.level,
        judged=history.judged,
        version=installed_version(),
    )


def _panels(r: RobotHistory) -> list[dict[str, Any]]:
    panels = []
    for key in _SHOWN:
        j = KEYS.index(key)
        c = CHANNELS[j]
        variances = r.series.variances[:, j]
        cuts = [e.change.onset for e in r.events if e.change.group == c.group and not e.change.drift]
        panels.append(
            {
                "name": c.name[0].upper() + c.name[1:],
                "unit": c.unit,
                "value": [
                    float(f"{v * c.scale:.5g}") if isfinite(var) else None
                    for v, var in zip(r.series.values[:, j], variances, strict=True)
                ],
                "sigma": [float(f"{sqrt(v) * c.scale:.3g}") if isfinite(v) else 0 for v in variances],
                "scatter": float(f"{r.scatter[j] * c.scale:.3g}") if isfinite(r.scatter[j]) else 0,
                "odd": np.flatnonzero(r.watched.odd[:, j]).tolist(),
                "cuts": sorted(set(cuts)),
                "lines": _lines(r, j, sorted(set(cuts))),
            }
        )
    return panels


def _lines(r: RobotHistory, j: int, cuts: Sequence[int]) -> list[list[float]]:
    """Return the level of each stretch between changes, and the trend where it drifts: x0, y0, x1, y1."""
    c, s, lines = CHANNELS[j], r.series, []
    start, trend = r.watched.start[j], r.trends.get(c.key)
    drifts = trend is not None and bool(r.watched.sloped[j]) and isfinite(trend.sigma)
    for a, b in zip([0, *cuts], [*cuts, start + 1 if drifts else len(s.years)], strict=True):
        w = np.where(
            np.isfinite(s.variances[a:b, j]) & ~r.watched.odd[a:b, j],
            1 / np.maximum(s.variances[a:b, j] + r.scatter[j] ** 2, 1e-300) if isfinite(r.scatter[j]) else 1.0,
            0.0,
        )
        if np.sum(w > 0) < 1:
            continue
        level = float(np.average(s.values[a:b, j], weights=w))
        lines.append(_line(s.years[a], s.years[b - 1], level, level, c.scale))
    if trend is not None and drifts:
        known = np.isfinite(s.variances[:, j]) & ~r.watched.odd[:, j]
        last = float(s.years[known][-1])
        begun, end = float(s.years[start]), float(s.years[-1])
        y0, y1 = (trend.level + trend.rate * (x - last) for x in (begun, end))
        lines.append(_line(begun, end, y0, y1, c.scale))
    return lines


def _line(x0: float, x1: float, y0: float, y1: float, scale: float) -> list[float]:
    return [float(x0), float(f"{y0 * scale:.5g}"), float(x1), float(f"{y1 * scale:.5g}")]
