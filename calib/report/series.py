"""Estimates over the number of stops (the paper's figures 8 and 9), and stops predicted from the others."""

from dataclasses import dataclass
from math import isfinite, pi
from typing import Any

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.results.diagnostics import Detail
from boxcal.calib.results.stop_residuals import stop_label

_GROWTH = (
    ("rL", "left radius", "mm", 1e3),
    ("rR", "right radius", "mm", 1e3),
    ("b", "wheel separation", "mm", 1e3),
    ("tx", "forward", "mm", 1e3),
    ("ty", "left", "mm", 1e3),
    ("tz", "height", "mm", 1e3),
    ("rx", "turn about the image's x", "°", 180 / pi),
    ("ry", "turn about the image's y", "°", 180 / pi),
    ("rz", "turn about the line of sight", "°", 180 / pi),
    ("fu", "focal length", "px", 1.0),
    ("cu", "principal point, across", "px", 1.0),
    ("cv", "principal point, down", "px", 1.0),
)


def growth_data(detail: Detail | None) -> dict[str, Any] | None:
    """Return the panels to draw, values and sigmas in the units shown; None where there are not two points."""
    if detail is None or len(detail.growth) < 2:
        return None
    return {
        "stops": [g.stops for g in detail.growth],
        "panels": [
            {
                "key": key,
                "name": name,
                "unit": unit,
                "value": [_number(g.values[ORDER.index(key)] * scale) for g in detail.growth],
                "sigma": [_number(g.sigma[ORDER.index(key)] * scale) for g in detail.growth],
            }
            for key, name, unit, scale in _GROWTH
        ],
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthRow:
    """Values and sigmas over the number of stops for the first six panels, in their units; None where infinite."""

    stops: int
    cells: tuple[tuple[float | None, float | None], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutRow:
    """A stop predicted from the others: error and claimed sigma (mm, mm, deg), and their ratio.

    ``faulty`` says that the stop stands at the end of a leg that was rejected.
    """

    stop: str
    error: tuple[float, float, float]
    sigma: tuple[float, float, float]
    faulty: bool
    ratio: float


def growth_rows(detail: Detail | None) -> list[GrowthRow]:
    """Return the first six panels as rows of a table, one for each number of stops."""
    data = growth_data(detail)
    if data is None:
        return []
    return [
        GrowthRow(stops=n, cells=tuple((p["value"][i], p["sigma"][i]) for p in data["panels"][:6]))
        for i, n in enumerate(data["stops"])
    ]


def held_out_rows(detail: Detail | None) -> list[HeldOutRow]:
    """Return the stops that were predicted from the others."""
    if detail is None:
        return []
    faulty = {(leg.drive, leg.next_stop) for leg in detail.flagged_legs}
    several = any(leg.drive for leg in detail.legs)
    return [
        HeldOutRow(
            stop=stop_label(h.drive, h.stop, several=several),
            error=_shown(h.error),
            sigma=_shown(h.sigma),
            faulty=(h.drive, h.stop) in faulty,
            ratio=float(np.sqrt(np.mean((np.array(h.error) / np.array(h.sigma)) ** 2))),
        )
        for h in detail.held_out
    ]


def _shown(pose: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return forward, left and heading (m, m, rad) in mm, mm and degrees."""
    return pose[0] * 1e3, pose[1] * 1e3, pose[2] * 180 / pi


def held_out_data(detail: Detail | None) -> dict[str, Any] | None:
    """Return the same for the chart, by component; None where no stop was held out."""
    rows = held_out_rows(detail)
    if not rows:
        return None
    return {
        "stops": [r.stop for r in rows],
        "faulty": [r.faulty for r in rows],
        "error": [[_number(r.error[k]) for r in rows] for k in range(3)],
        "sigma": [[_number(r.sigma[k]) for r in rows] for k in range(3)],
    }


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if isfinite(value) else None
