"""How much each error source moves each parameter: the paper's future work, as one table.

    python benchmarks/sensitivity.py --quick

The robot of section 4 on random routes of 15 stops, with one source at work at a time. The likelihood's noise levels
are held at 0.25 px, 0.1302 deg and 0.3 mm/sqrt(m), so that it answers each source as it would where all are present.
A signed entry is the mean over the routes (it exceeds their spread); one without a sign is a root mean square.
"""

import argparse
from collections.abc import Sequence
from math import radians
from pathlib import Path

import numpy as np
from blocks import fill, table
from runs import PARAMETERS, difference, estimate_values, step_values, true_values
from sources import Sources, observe, weaving_drive

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.simulate.robot import Robot, paper
from boxcal.target.arrays import Array
from boxcal.target.box import Target, make_target

ROOT = Path(__file__).resolve().parents[1]
STOPS = 15
SOURCES = {
    "pixel noise, 0.1 px": (Sources(pixel=0.1), 1.0),
    "encoder step, 0.1 deg": (Sources(encoder=radians(0.1)), 1.0),
    "sampling time, 0.1 s": (Sources(period=0.12), 1.0),
    "slip, 0.1 mm/sqrt(m)": (Sources(slip=1e-4), 1.0),
    "box too large by 0.1 %": (Sources(scale=1e-3), 1.0),
    "box wider in x by 1 mm": (Sources(width=2e-4), 5.0),
    "prints 1 mm higher": (Sources(lift=2e-4), 5.0),
    "right wheel toed in by 1 deg": (Sources(toe=radians(0.1)), 10.0),
    "right wheel 0.1 mm off centre": (Sources(eccentric=1e-4), 1.0),
}
"""Each source as it is simulated, and what the effect is multiplied by (linear: small enough to be)."""


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=40, help="routes (40)")
    parser.add_argument("--quick", action="store_true", help="3 routes")
    parser.add_argument("--out", type=Path, help="folder of paper.md (docs; with --quick none)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    out = args.out or (None if args.quick else ROOT / "docs")
    robot, target = paper(), make_target()
    effects = [_effects(robot, target, [args.seed, 6, k]) for k in range(3 if args.quick else args.runs)]
    text = _table(np.array(effects))
    print(f"{len(effects)} routes of {STOPS} stops\n{text}")
    if out:
        fill(out / "paper.md", "sensitivity", text)
    return 0


def _effects(robot: Robot, target: Target, seed: list[int]) -> Array:
    """Return what each source changes on one route, (sources, 2, 14), paper's procedure and likelihood."""
    drive = weaving_drive(robot, target, STOPS, np.random.default_rng(seed))

    def solve(sources: Sources) -> Array:
        seen = observe(robot, target, drive, sources, np.random.default_rng([*seed, 1]))
        options = EstimateOptions(noise_scale=1.0, slip=3e-4, encoder_step=radians(0.1302), find_faults=False)
        values = np.full((2, 14), np.nan)
        try:
            steps = solve_four_steps(seen)
            values[0] = step_values(steps)
            values[1] = estimate_values(estimate([seen], steps, options))
        except CalibError as error:
            print(f"route {seed[-1]}: {error}")
        return difference(values, true_values(robot))

    none = solve(Sources())
    return np.array([factor * (solve(sources) - none) for sources, factor in SOURCES.values()])


def _table(effects: Array) -> str:
    scale, heads = zip(*(_unit(name) for name in PARAMETERS), strict=True)
    rows = []
    for s, source in enumerate(SOURCES):
        for p, procedure in enumerate(("paper's", "likelihood")):
            rows.append([f"{source}: {procedure}", *map(_cell, (effects[:, s, p] * scale).T)])
    return table(["source: procedure", *heads], rows)


def _cell(values: Array) -> str:
    mean, rms = float(np.nanmean(values)), float(np.sqrt(np.nanmean(values**2)))
    if rms < 5e-5:
        return "0"
    return f"{mean:+.2g}" if abs(mean) > np.nanstd(values) else f"{rms:.2g}"


def _unit(name: str) -> tuple[float, str]:
    true = true_values(paper())[PARAMETERS.index(name)]
    if name in {"fu", "fv", "rR", "rL", "b"}:
        return 100 / true, f"{name} (%)"
    if name.startswith("a"):
        return float(np.degrees(1)), f"{name} (deg)"
    return (1e3, f"{name} (mm)") if name.startswith("t") else (1.0, name if name == "kr" else f"{name} (px)")


if __name__ == "__main__":
    raise SystemExit(main())
