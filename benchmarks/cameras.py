"""Two cameras on one robot: the transform between them and the wheels, against the Cramer-Rao bound.

Simulated robots with 20 stops (slip .3 mm/sqrt(m), corners with .1 px of noise, no images), each drive solved from
both cameras together and from each camera alone. Three kinds of robots: a camera ahead and one behind, which never see
the box at the same stop; a stereo pair of 60 mm; a lens of 30 deg beside a fisheye lens of 120 deg. Printed for each:
errors of the pair's transform over their sigmas (largest) and over the bound (root mean square over all six of all
robots), errors of the wheels over those from the better camera alone, and how long the common solution takes.

With --moving each camera also takes frames on the move, both at the same moments, with a clock of its own (stamps 30 ms
late and 20 ms early, jitter .5 ms); printed are errors of wheels and cameras' places over their sigmas and over the
bound (known noise levels), what frames do to the sigmas of the stops, and the clocks' errors over their sigmas.

With --pictures a few robots are driven with rendered images, by two cameras of unlike sizes, clocks and rates of
images, and calibrated from their logs by the whole line.

    python benchmarks/cameras.py              40 robots of each kind, some 4 minutes on one core
    python benchmarks/cameras.py --moving     the same with frames on the move, some 8 minutes
    python benchmarks/cameras.py --pictures --rig rear --robots 4    some 5 minutes; stereo and wide likewise
    python benchmarks/cameras.py --quick      4 robots of each kind
    python benchmarks/cameras.py --kind "stereo, 60 mm" --robots 120 --seed 3
"""

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from camera_robots import (
    KINDS,
    LEAST_TAGS,
    SIGMA_PX,
    SLIP,
    Kind,
    driven,
    found_wheels,
    of_one,
    rms,
    true_wheels,
    whitened,
)
from cameras_moving import moved, report_moved
from cameras_pictures import pictured, report_pictured

from boxcal.calib.geometry.camera_pair import between, pair_jacobian
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.cameras.estimates import solve_cameras
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences
from boxcal.calib.simulate.more_cameras import RIGS, seen_by
from boxcal.calib.uncertainty.cramer_rao import Truth
from boxcal.calib.uncertainty.cramer_rao_cameras import cramer_rao_cameras
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

GOAL_SIGMAS, GOAL_RATIO = 3.0, 1.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One robot: errors (6,), sigmas and bounds of the pair's transform, and of the wheels (3,).

    ``pair_whitened`` (6,) and ``wheels_whitened`` (3,) are errors in units of their covariance: independent, of one.

    Then errors and sigmas of the wheels by the better camera alone, seconds of each camera alone and of both together,
    the number of stops that both saw, and what was said.
    """

    pair: Array
    pair_sigma: Array
    pair_whitened: Array
    pair_bound: Array
    wheels: Array
    wheels_sigma: Array
    wheels_whitened: Array
    wheels_bound: Array
    alone: Array
    alone_sigma: Array
    seconds: tuple[float, float]
    shared_stops: int
    said: str


def outcome(kind: Kind, number: int, seed: int) -> Outcome | None:
    """Return what one robot's drive gives; None if it has no place to drive or its stops do not determine it."""
    rng = np.random.default_rng([seed, number])
    target = make_target()
    robots = kind(rng)
    options = EstimateOptions(systematic_share=0.0)
    try:
        drive = driven(robots, rng)
        drives = (drive, seen_by(drive, *robots))
        views = [
            exact_correspondences(robot, target, d, SIGMA_PX, rng) for robot, d in zip(robots, drives, strict=True)
        ]
        kept = [[j for j, s in enumerate(view.stops) if len(s.landmark_ids) >= 4 * LEAST_TAGS] for view in views]
        views = [replace(v, stops=tuple(v.stops[j] for j in k)) for v, k in zip(views, kept, strict=True)]
        begun = time.process_time()
        fits = [
            fit([v], None, replace(options, lens=robot.camera.kind)) for v, robot in zip(views, robots, strict=True)
        ]
        found = [reported(f, [v], options) for f, v in zip(fits, views, strict=True)]
    except BoxcalError:
        return None
    middle = time.process_time()
    both = solve_cameras(found, fits, [[v] for v in views])
    seconds = (middle - begun, time.process_time() - middle)
    truths = [
        Truth(
            camera=robot.camera, rR=robot.rR, rL=robot.rL, b=robot.b, T_body_cam=robot.T_body_cam, slip=SLIP,
            stop_poses=(drive.stop_poses[k],), encoder_step=DriveOptions().encoder_step,
        )
        for robot, k in zip(robots, kept, strict=True)
    ]  # fmt: skip
    bound = cramer_rao_cameras(views, truths, options)
    a, b = both.estimates
    J = pair_jacobian(a.T_body_cam, b.T_body_cam)
    true = between(robots[0].T_body_cam, robots[1].T_body_cam)
    is_ = between(a.T_body_cam, b.T_body_cam)
    better = min(found, key=lambda e: float(np.sum(_relative(e) ** 2)))
    error = np.concatenate([log_so3(true[:3, :3].T @ is_[:3, :3]), is_[:3, 3] - true[:3, 3]])
    return Outcome(
        pair=error,
        pair_sigma=np.sqrt(np.diag(J @ both.mountings @ J.T)),
        pair_whitened=whitened(error, J @ both.mountings @ J.T),
        pair_bound=np.sqrt(np.diag(J @ bound[3:, 3:] @ J.T)),
        wheels=found_wheels(a) - true_wheels(robots[0]),
        wheels_sigma=np.sqrt(np.diag(a.cov)[5:8]),
        wheels_whitened=whitened(found_wheels(a) - true_wheels(robots[0]), a.cov[5:8, 5:8]),
        wheels_bound=np.sqrt(np.diag(bound)[:3]),
        alone=found_wheels(better) - true_wheels(robots[0]),
        alone_sigma=np.sqrt(np.diag(better.cov)[5:8]),
        seconds=seconds,
        shared_stops=len(set(kept[0]) & set(kept[1])),
        said=both.apart or both.doubt,
    )


def _relative(found: Estimate) -> Array:
    return np.asarray(np.sqrt(np.diag(found.cov)[5:8]) / found_wheels(found))


def report(title: str, outcomes: list[Outcome | None]) -> None:
    """Print the lines of one kind of robots."""
    done = [o for o in outcomes if o is not None]
    pair, sigma = np.array([o.pair for o in done]), np.array([o.pair_sigma for o in done])
    bound = np.array([o.pair_bound for o in done])
    wheels, alone = np.array([o.wheels for o in done]), np.array([o.alone for o in done])
    ratios = np.sqrt(np.mean((pair / bound) ** 2, axis=0))
    print(f"{title}: {len(done)} of {len(outcomes)} robots, {np.mean([o.shared_stops for o in done]):.1f} stops shared")
    print(
        f"  pair's transform: largest error {np.abs(pair / sigma).max():.2f} sigma (goal {GOAL_SIGMAS:g}), error over "
        f"the bound, rms {rms(pair / bound):.3f} (goal {GOAL_RATIO}; rx {ratios[0]:.2f} ry {ratios[1]:.2f} "
        f"rz {ratios[2]:.2f} tx {ratios[3]:.2f} ty {ratios[4]:.2f} tz {ratios[5]:.2f})"
    )
    print(
        f"  errors in units of their covariance: pair {of_one([o.pair_whitened for o in done])}, wheels "
        f"{of_one([o.wheels_whitened for o in done])}"
    )
    print(
        f"  sigma of the pair's place: {1e3 * np.median(np.linalg.norm(sigma[:, 3:], axis=1)):.2f} mm, of its rotation "
        f"{np.degrees(np.median(np.linalg.norm(sigma[:, :3], axis=1))):.3f} deg (median robot)"
    )
    less = np.median([o.wheels_sigma / o.alone_sigma for o in done])
    of_bound = rms(wheels / np.array([o.wheels_bound for o in done]))
    print(
        f"  wheels: error over the better camera's, rms {rms(wheels / wheels_scale(done)):.2f} to "
        f"{rms(alone / wheels_scale(done)):.2f}; sigma over its {less:.2f} (median); error over the bound "
        f"{of_bound:.3f}"
    )
    said = [o.said for o in done if o.said]
    print(f"  said to disagree or not solved together: {len(said)}{f' ({said[0]})' if said else ''}")
    seconds = np.array([o.seconds for o in done])
    print(
        f"  {np.median(seconds[:, 0]):.2f} s for each camera alone, {np.median(seconds[:, 1]):.2f} s together",
        flush=True,
    )


def wheels_scale(done: list[Outcome]) -> Array:
    """Return the sigmas of the better camera alone, (n, 3): the unit of the wheels' errors."""
    return np.array([o.alone_sigma for o in done])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--moving", action="store_true")
    parser.add_argument("--pictures", action="store_true")
    parser.add_argument("--rig", nargs="+", choices=RIGS, default=RIGS)
    parser.add_argument("--robots", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--kind", nargs="+", choices=tuple(KINDS), default=tuple(KINDS))
    args = parser.parse_args()
    numbers = range(1, 1 + (4 if args.quick else args.robots))
    for rig in args.rig if args.pictures else ():
        report_pictured(rig, [pictured(rig, k, args.seed) for k in numbers])
    for title in () if args.pictures else args.kind:
        kind = KINDS[title]
        if args.moving:
            report_moved(title, [moved(kind, k, args.seed) for k in numbers])
        else:
            report(title, [outcome(kind, k, args.seed) for k in numbers])


if __name__ == "__main__":
    main()
