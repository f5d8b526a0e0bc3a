"""Does the estimator reach the Cramer-Rao bound, and do its sigmas hold? Monte Carlo on the paper's simulation.

    python benchmarks/estimator.py --quick

Wheels, extrinsics and settings of Antonelli et al. 2010, section 4: rL = rR = 0.03 m, b = 0.08 m, R = Ry(1.396),
640 x 480, 0.25 px, encoder step 0.1302 deg, T = 0.02 s, 140 landmarks a face. One route for each number of stops, its
stops shifted by up to 1 cm and 1 deg in every run (or the encoders' roundings would be the same each time); every run
draws pixel noise, slip and the encoders' phases anew.
"""

import argparse
import time
from dataclasses import dataclass, replace
from math import radians

import numpy as np
from scipy import stats

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import Robot, paper
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.calib.uncertainty.cramer_rao import Truth, cramer_rao, errors
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import Target, make_target

SIGMA_PX = 0.25
STEP = radians(0.1302)
SLIPS_MM = (0.0, 1.0, 5.0)
STOPS = (5, 15, 20)
ROUTE_SEED = {5: 34}
"""Of 60 random routes of 5 stops the one with the best bound; 4 legs leave b and the yaw nearly open on many."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """Errors, predicted sigmas and bounds of all runs of one setting, (n, 14) each; and squared normalised errors."""

    errors: Array
    sigma: Array
    bound: Array
    square: Array
    slip: Array
    flagged: int
    failed: int
    seconds: float

    @property
    def ratio(self) -> Array:
        """Root mean square error over the bound."""
        return np.asarray(np.sqrt(np.mean((self.errors / self.bound) ** 2, axis=0)))

    @property
    def cover(self) -> Array:
        """Fraction of 95 % intervals that hold the truth."""
        return np.asarray(np.mean(np.abs(self.errors) <= 1.959964 * self.sigma, axis=0))


def route(robot: Robot, target: Target, stops: int) -> Array:
    return choose_stops(
        robot, target, stops, 0.15 + robot.reach, np.random.default_rng([ROUTE_SEED.get(stops, 1), stops])
    )


def drive(
    robot: Robot, target: Target, stops: Array, slip: float, rng: np.random.Generator
) -> tuple[Correspondences, Truth]:
    options = DriveOptions(stops=len(stops), slip=slip, steps_per_sample=4, encoder_step=STEP, clearance=0.13)
    shifted = stops + rng.uniform(-1, 1, stops.shape) * (0.01, 0.01, radians(1.0))
    driven = simulate_drive(robot, target, options, rng, stops=shifted)
    seen = exact_correspondences(robot, target, driven, SIGMA_PX, rng)
    truth = Truth.of(robot, driven.stop_poses, slip=slip, encoder_step=STEP)
    return seen, truth


def run_case(stops: int, slip_mm: float, runs: int, options: EstimateOptions, seed: int = 0) -> Case:
    robot, target = paper(), make_target()
    plan = route(robot, target, stops)
    rows: list[tuple[Array, Array, Array, float, float]] = []
    flagged, failed, seconds = 0, 0, 0.0
    for run in range(runs):
        rng = np.random.default_rng([seed, stops, round(slip_mm * 1000), run])
        seen, truth = drive(robot, target, plan, slip_mm * 1e-3, rng)
        begin = time.perf_counter()
        try:
            found = estimate([seen], None, options)
        except CalibError as error:
            print(f"  run {run}: {error}")
            failed += 1
            continue
        seconds += time.perf_counter() - begin
        error = errors(found, truth)
        bound = np.sqrt(np.diag(cramer_rao([seen], truth, options)))
        flagged += bool(found.flagged_legs)
        square = float(error @ np.linalg.solve(found.cov, error))
        rows.append((error, np.sqrt(np.diag(found.cov)), bound, square, found.noise.slip))
    e, s, c, q, slip = (np.array(column) for column in zip(*rows, strict=True))
    return Case(
        errors=e,
        sigma=s,
        bound=c,
        square=q,
        slip=slip,
        flagged=flagged,
        failed=failed,
        seconds=seconds / max(len(e), 1),
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=200, help="runs of each setting (200)")
    parser.add_argument("--quick", action="store_true", help="20 runs of each setting")
    parser.add_argument("--stops", type=int, nargs="+", default=list(STOPS), help="numbers of stops (5 15 20)")
    parser.add_argument("--slip-mm", type=float, nargs="+", default=list(SLIPS_MM), help="mm/sqrt(m) (0 1 5)")
    parser.add_argument("--no-tilt", action="store_true", help="take the floor as parallel to the box' base")
    parser.add_argument("--rigid", action="store_true", help="all stops on one plane exactly, as in the paper")
    parser.add_argument("--slip-known", action="store_true", help="give the estimator the true slip")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    runs = 20 if arguments.quick else arguments.runs
    options = EstimateOptions(rigid_floor=arguments.rigid, systematic_share=0.0)
    if arguments.no_tilt:
        options = replace(options, tilt_sigma=0.0)
    print(f"{runs} runs each. ratio: rms error / Cramer-Rao bound; cover: share of 95 % intervals that hold the truth;")
    print("NEES: sum of squared normalised errors over all runs, and its two-sided 99 % chi-square interval")
    for stops in arguments.stops:
        for slip_mm in arguments.slip_mm:
            told = replace(options, slip=slip_mm * 1e-3) if arguments.slip_known else options
            case = run_case(stops, slip_mm, runs, told, arguments.seed)
            report(stops, slip_mm, case)
    return 0


def report(stops: int, slip_mm: float, case: Case) -> None:
    n = len(case.errors)
    low, high = stats.chi2.ppf([0.005, 0.995], 14 * n)
    total = float(case.square.sum())
    print(
        f"\nP = {stops}, slip {slip_mm:g} mm/sqrt(m): {n} runs, {case.failed} failed, {case.flagged} with a leg named, "
        f"{case.seconds * 1e3:.0f} ms each (camera step included), slip found {np.median(case.slip) * 1e3:.2f}"
    )
    print("        " + " ".join(f"{name:>6}" for name in ORDER))
    print("  ratio " + " ".join(f"{v:6.3f}" for v in case.ratio) + f"   worst {case.ratio.max():.3f}")
    print(
        "  cover "
        + " ".join(f"{v:6.3f}" for v in case.cover)
        + f"   all {case.cover.mean():.3f}, least {case.cover.min():.3f}"
    )
    print(f"  NEES  {total:.0f} in [{low:.0f}, {high:.0f}]: {'yes' if low < total < high else 'NO'}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
