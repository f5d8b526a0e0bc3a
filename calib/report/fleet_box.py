"""The box as each robot of a fleet found it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from boxcal.calib.report.fleet_tables import ODD
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.unknowns import describe

MOST_COLUMNS = 24
"""Robots up to which each has a column of the table of the box; of more those that disagree are named."""
_NAMED = 8
_SHAPE = re.compile(r"scale_[xy]|width|depth|seat|ink|bow\d|face\d_\w\w")


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeRow:
    """One value of the box as the robots found it.

    Attributes
    ----------
    words, unit
        The value.
    cells
        As each robot found it, in their order; of large fleets mean, robots that solved for it, and who disagrees.
    agree
        Whether they agree within their standard deviations.
    """

    words: str
    unit: str
    cells: tuple[str, ...]
    agree: bool


def shape_rows(results: Sequence[Calibration]) -> list[ShapeRow]:
    """Return the box's values that two robots and more solved for, side by side: all drove around one box."""
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
        others = [
            c.robot for c, p in zip(results, pairs, strict=True) if p is not None and abs(p[0] - mean) >= ODD * p[1] > 0
        ]
        rows.append(
            ShapeRow(
                words=unknown.words,
                unit=unknown.unit,
                cells=tuple("" if p is None else _said(*p, unknown.scale) for p in pairs)
                if len(results) <= MOST_COLUMNS
                else (_said(mean, float(np.sum(weight)) ** -0.5, unknown.scale), str(len(known)), _who(others)),
                agree=not others,
            )
        )
    return rows


def _said(value: float, sigma: float, scale: float) -> str:
    return f"{value * scale:.3g} ± {sigma * scale:.2g}".replace("-", "−")


def _who(robots: Sequence[str]) -> str:
    more = f" and {len(robots) - _NAMED} more" if len(robots) > _NAMED else ""
    return ", ".join(robots[:_NAMED]) + more
