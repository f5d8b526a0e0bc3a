"""Does compare-calibrations keep its level, and does it find a camera that turned? Pairs of simulated drives.

    python benchmarks/compare.py --pairs 20

Each pair is one random robot and two independent drives of it (routes, pixel noise, slip and encoder phases drawn
anew), calibrated by the estimator as fleet-calibrate does. At a level of 5 % about 5 % of the pairs should differ. Then
the camera is turned by 0.3 deg about a random axis before a third drive, which should be found.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
from scipy import stats

from boxcal.calib.compare.difference import Difference, difference
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.results.build import refined
from boxcal.calib.results.calibration import Calibration, Provenance
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import Robot, random_robot
from boxcal.target.box import make_target

LEVEL = 0.05
TURN = np.radians(0.3)
SIGMA_PX = 0.1
TARGET = make_target()
NOWHERE = Provenance(version="", command="", created="")


def calibrated(robot: Robot, stops: int, rng: np.random.Generator) -> Calibration:
    """Return the calibration that one drive of a robot gives."""
    driven = simulate_drive(robot, TARGET, DriveOptions(stops=stops), rng)
    drives = [exact_correspondences(robot, TARGET, driven, SIGMA_PX, rng)]
    steps = [solve_four_steps(drives[0], CameraMode.JOINT)]
    found = estimate(drives, steps, EstimateOptions(target=TARGET, ink_sigma=1e-4))
    return refined(robot.name, drives, steps, found, NOWHERE)


def pair(seed: int, stops: int) -> tuple[Difference, Difference] | str:
    """Return the differences of one robot that did not change, and of one whose camera turned; or why there is none."""
    rng = np.random.default_rng([1, seed])
    robot = random_robot(f"r{seed}", rng)
    axis = rng.normal(size=3)
    turn = rigid(exp_so3(TURN * axis / np.linalg.norm(axis)), np.zeros(3))
    try:
        a, b = calibrated(robot, stops, rng), calibrated(robot, stops, rng)
        c = calibrated(replace(robot, T_body_cam=robot.T_body_cam @ turn), stops, rng)
        return difference(a, b), difference(a, c)
    except CalibError as error:
        return str(error)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--stops", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    args = parser.parse_args()
    begun = time.monotonic()
    seeds = range(args.first_seed, args.first_seed + args.pairs)
    with ProcessPoolExecutor(args.jobs) as pool:
        outcomes = list(pool.map(pair, seeds, [args.stops] * args.pairs))
    failed = [o for o in outcomes if isinstance(o, str)]
    same = [o[0] for o in outcomes if not isinstance(o, str)]
    turned = [o[1] for o in outcomes if not isinstance(o, str)]
    for reason in failed:
        print(f"no calibration: {reason}")
    count = len(same)
    p = np.array([d.p_value for d in same], dtype=float)
    hits = int(np.sum(p < LEVEL))
    low, high = stats.binomtest(hits, count).proportion_ci()
    chi2 = np.array([d.chi2 for d in same], dtype=float)
    dof = np.array([d.dof for d in same])
    z = np.array([d.values / d.sigma for d in same if d.sigma is not None])
    found = np.array([d.p_value for d in turned], dtype=float) < LEVEL
    print(f"{count} pairs of drives of {args.stops} stops, {time.monotonic() - begun:.0f} s")
    print(
        f"differ beyond chance at {LEVEL:g}: {hits} ({100 * hits / count:.1f} %, 95 % interval "
        f"{100 * low:.1f} to {100 * high:.1f} %)"
    )
    print(
        f"chi-square over degrees of freedom: mean {np.mean(chi2 / dof):.3f}; p uniform with probability "
        f"{stats.kstest(p, 'uniform').pvalue:.2f}"
    )
    print("rms of differences over their sigma:", " ".join(f"{v:.2f}" for v in np.sqrt(np.nanmean(z**2, axis=0))))
    print(f"camera turned by 0.3 deg: found in {found.sum()} of {len(found)} ({100 * found.mean():.1f} %)")


if __name__ == "__main__":
    main()
