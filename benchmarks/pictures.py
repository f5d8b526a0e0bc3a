"""The paper's figures: histograms of the errors (5, 6) and estimates over the number of stops (8, 9)."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from growth import Growth
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from runs import PARAMETERS, Runs, rms
from scipy import stats

from boxcal.target.arrays import Array

mpl.use("Agg")
OURS, PAPER, TRUTH = "#1f5fa8", "#9a9a9a", "#c0392b"
_COLOURS = ("#1f5fa8", "#d2691e", "#2e8b57")
_DPI = 130
_SCALE = {"m": (1e3, "mm"), "rad": (float(np.degrees(1)), "deg")}


def unit_of(name: str) -> str:
    """Return the unit of a parameter inside the library."""
    if name in {"fu", "fv", "cu", "cv"}:
        return "px"
    return "" if name == "kr" else "rad" if name.startswith("a") else "m"


def histograms(path: Path, names: tuple[str, ...], truth: Array, runs: Runs, title: str) -> None:
    """Draw the distribution of parameters over the runs, as figures 5 and 6 do, with the predicted one."""
    figure = Figure(figsize=(8.2, 3.4), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names)), names, strict=True):
        k = PARAMETERS.index(name)
        factor, unit = _SCALE[unit_of(name)]
        value = truth[k] * factor
        closed, ours = ((e[:, k][np.isfinite(e[:, k])]) * factor + value for e in (runs.closed, runs.likelihood))
        sigma = runs.sigma[:, k][np.isfinite(runs.sigma[:, k])] * factor
        spread = float(rms(runs.closed)[k]) * factor
        x = np.linspace(value - 3.2 * spread, value + 3.2 * spread, 400)
        bins = np.linspace(x[0], x[-1], 61)
        axes.hist(closed, bins.tolist(), density=True, color=PAPER, alpha=0.6, label="paper's procedure")
        axes.plot(x, stats.norm.pdf(x, closed.mean(), closed.std()), "--", color="#555555", label="normal fitted to it")
        axes.hist(ours, bins.tolist(), density=True, color=OURS, alpha=0.45, label="likelihood")
        predicted = stats.norm.pdf(x[:, None], value, sigma).mean(axis=1)
        axes.plot(x, predicted, color=OURS, label="predicted by its sigma")
        axes.axvline(value, color=TRUTH, lw=0.9, label="true")
        axes.set_xlim(x[0], x[-1])
        axes.set_xlabel(f"{_symbol(name)} ({unit})")
        axes.set_ylabel(f"density (1/{unit})")
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), frameon=False, fontsize=8, ncols=5, loc="outside lower center"
    )
    figure.suptitle(title, fontsize=10)
    _save(figure, path)


def growths(path: Path, drives: list[Growth], groups: tuple[tuple[str, ...], ...], *, errors: bool) -> None:
    """Draw estimates over the number of stops with 95 % bands, a column for each drive, a row for each group.

    Parameters
    ----------
    errors
        Whether values are drawn less the truth (as figure 9 subtracts its mean) or as they are.
    """
    figure = Figure(figsize=(4.4 * len(drives) + 0.4, 2.7 * len(groups) + 0.3), layout="constrained")
    grid = figure.subplots(len(groups), len(drives), squeeze=False, sharey="row", sharex=True)
    for row, group in enumerate(groups):
        low, high = zip(*(_limits(drive, group, errors=errors) for drive in drives), strict=True)
        limits = min(low), max(high)
        grid[row][0].set_ylim(*limits)
        for column, drive in enumerate(drives):
            _growth(grid[row][column], drive, group, limits, errors=errors)
            if row == 0:
                grid[row][column].set_title(drive.title, fontsize=10)
            if row == len(groups) - 1:
                grid[row][column].set_xlabel("number of stops P")
        unit = _SCALE[unit_of(group[0])][1]
        what = ", ".join(_symbol(name) for name in group)
        grid[row][0].set_ylabel(f"error of {what} ({unit})" if errors else f"{what} ({unit})")
        grid[row][-1].legend(frameon=False, fontsize=7.5, ncols=2, loc="best")
    _save(figure, path)


def _growth(axes: Axes, drive: Growth, group: tuple[str, ...], limits: tuple[float, float], *, errors: bool) -> None:
    for name, colour in zip(group, _COLOURS, strict=False):
        k = PARAMETERS.index(name)
        factor = _SCALE[unit_of(name)][0]
        base = 0.0 if errors else drive.truth[k] * factor
        ours, closed, band = (a[:, k] * factor for a in (drive.likelihood, drive.closed, 1.96 * drive.sigma))
        axes.axhline(base, color=TRUTH, lw=0.8)
        axes.fill_between(drive.stops, base + ours - band, base + ours + band, color=colour, alpha=0.2, lw=0)
        ours, closed = (np.where((base + a > limits[0]) & (base + a < limits[1]), a, np.nan) for a in (ours, closed))
        axes.plot(drive.stops, base + ours, color=colour, lw=1.4, label=f"{_symbol(name)} likelihood, 95 %")
        axes.plot(drive.stops, base + closed, "o:", color=colour, ms=3, lw=0.8, label=f"{_symbol(name)} paper's")
    axes.set_xticks(np.arange(4, drive.stops[-1] + 1, 4))
    axes.grid(alpha=0.25)


def _limits(drive: Growth, group: tuple[str, ...], *, errors: bool) -> tuple[float, float]:
    """Return limits that show all values from five stops on; with fewer, bands may be many times wider."""
    factor = _SCALE[unit_of(group[0])][0]
    ks = [PARAMETERS.index(name) for name in group]
    rows = drive.stops >= min(5, drive.stops[-1])
    size = np.nanmax(np.abs(np.stack([drive.closed[rows][:, ks], drive.likelihood[rows][:, ks]])))
    base = 0 * drive.truth[ks] if errors else drive.truth[ks]
    return float((base.min() - 1.5 * size) * factor), float((base.max() + 1.5 * size) * factor)


def _symbol(name: str) -> str:
    if name in {"rR", "rL", "tx", "ty", "tz"}:
        return f"${name[0]}_{name[1]}$"
    return f"$\\alpha_{name[1]}$" if name.startswith("a") else f"${name}$"


def _save(figure: Figure, path: Path) -> None:
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=_DPI, metadata={"Software": None})
