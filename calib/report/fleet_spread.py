"""Spread of every parameter over a fleet: which part is real difference, which the hardware's, which noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from scipy import special

from boxcal.calib.report.fleet_tables import PARAMETERS, Parameter
from boxcal.calib.uncertainty.random_effects import RandomEffects, random_effects
from boxcal.target.arrays import Array

MOST_GROUPS = 8
"""Hardware revisions that get a column each; of more those with most robots do."""
_CHANCE = 0.05
"""Chance that revisions which do not differ are said to explain some parameter, over all parameters together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadRow:
    """One parameter over the fleet.

    Attributes
    ----------
    key, name, unit
        Of the parameter.
    cells
        Median, least, largest, standard deviation.
    sigma
        The calibrations' own standard deviation, typically.
    differ
        Standard deviation of the true values among each other, with its own; what is real of the spread.
    share
        Its fraction of the spread's variance, in percent.
    hardware
        Fraction of the real variance that the hardware revisions explain, in percent, where they differ by more than
        chance (a dash where they do not); empty with fewer than two.
    """

    key: str
    name: str
    unit: str
    cells: tuple[str, ...]
    sigma: str
    differ: str
    share: str
    hardware: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupTable:
    """Hardware revisions beside each other: names, numbers of robots, and rows of mean and real spread."""

    names: tuple[str, ...]
    counts: tuple[int, ...]
    rows: tuple[tuple[str, str, tuple[str, ...]], ...]


def spread_rows(
    values: Array, sigmas: Array, groups: Sequence[str] = (), parameters: Sequence[Parameter] = PARAMETERS
) -> list[SpreadRow]:
    """Return the spread of every parameter (N, n) over the fleet, by hardware revision where robots have one."""
    rows = []
    for k, p in enumerate(parameters):
        column, sigma = values[:, k], sigmas[:, k]
        summary = (np.median(column), column.min(), column.max(), np.std(column, ddof=1))
        known = sigma[np.isfinite(sigma)]
        real = random_effects(column, sigma)
        rows.append(
            SpreadRow(
                key=p.key,
                name=p.name,
                unit=p.unit,
                cells=tuple(p.text(float(v)) for v in summary),
                sigma=f"{np.median(known) * p.scale:.2g}" if len(known) else "",
                differ=_plus_minus(real, p.scale),
                share=_share(real),
                hardware=_explained(column, sigma, groups, real),
            )
        )
    return rows


def group_table(values: Array, sigmas: Array, groups: Sequence[str]) -> GroupTable | None:
    """Return mean and real spread of every parameter by hardware revision; None with fewer than two of them."""
    kinds = np.array(groups, dtype=object)
    names = sorted({g for g in groups if g}, key=lambda g: (-int(np.sum(kinds == g)), g))
    if len(names) < 2:
        return None
    names = names[:MOST_GROUPS]
    rows = []
    for k, p in enumerate(PARAMETERS):
        cells = []
        for name in names:
            own = kinds == name
            found = random_effects(values[own, k], sigmas[own, k])
            middle = found.mean if isfinite(found.mean) else float(np.median(values[own, k]))
            wide = f" ({found.between * p.scale:.2g})" if isfinite(found.between) else ""
            cells.append(p.text(middle) + wide)
        rows.append((p.name, p.unit, tuple(cells)))
    return GroupTable(names=tuple(names), counts=tuple(int(np.sum(kinds == n)) for n in names), rows=tuple(rows))


def _plus_minus(real: RandomEffects, scale: float) -> str:
    if not isfinite(real.between):
        return ""
    if real.between == 0:
        return f"0 (< {2 * real.between_sigma * scale:.2g})" if isfinite(real.between_sigma) else "0"
    return f"{real.between * scale:.3g} \N{PLUS-MINUS SIGN} {real.between_sigma * scale:.1g}"


def _share(real: RandomEffects) -> str:
    total = real.between**2 + real.within**2
    return f"{100 * real.between**2 / total:.0f}" if isfinite(total) and total > 0 else ""


def _explained(column: Array, sigma: Array, groups: Sequence[str], real: RandomEffects) -> str:
    """Return the fraction of the real variance that lies between hardware revisions, in percent."""
    kinds = np.array(groups, dtype=object)
    names = [name for name in dict.fromkeys(groups) if name and np.sum(kinds == name) > 2]
    if len(names) < 2 or not real.between > 0:
        return ""
    counted = np.isin(kinds, names)  # robots of no revision would count as spread that none explains, or as all of it
    real = random_effects(column[counted], sigma[counted])
    if not real.between > 0:
        return ""
    parts = [(int(np.sum(kinds == n)), random_effects(column[kinds == n], sigma[kinds == n]).between) for n in names]
    known = [(count, between) for count, between in parts if isfinite(between)]
    total = sum(count for count, _ in known)
    if not total:
        return ""
    within = sum(count * between**2 for count, between in known) / total
    if not _differ(column, sigma, kinds, names, within):
        return "\N{EN DASH}"
    return f"{100 * max(0.0, 1 - within / real.between**2):.0f}"


def _differ(column: Array, sigma: Array, kinds: Array, names: Sequence[str], within: float) -> bool:
    """Return whether the means of hardware revisions differ beyond chance (Fisher's F of weighted means)."""
    known = np.isfinite(column) & np.isfinite(sigma) & np.isin(kinds, names)
    y, of = column[known], np.array([names.index(kind) for kind in kinds[known]])
    w = 1 / (np.square(sigma[known]) + within + 1e-300)
    total = np.bincount(of, w, len(names))
    means = np.bincount(of, w * y, len(names)) / np.maximum(total, 1e-300)
    whole = np.sum(total * means) / np.sum(total)
    between, freedom = np.sum(total * np.square(means - whole)), len(names) - 1
    inside, rest = np.sum(w * np.square(y - means[of])), len(y) - len(names)
    if rest < 1:
        return False
    ratio = (between / freedom) / max(inside / rest, 1e-300)
    return bool(special.fdtrc(freedom, rest, ratio) < _CHANCE / len(PARAMETERS))
