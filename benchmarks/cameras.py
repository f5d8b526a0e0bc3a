"""Two cameras on one robot: the transform between them and the wheels, against the Cramer-Rao bound.

Simulated robots with 20 stops (slip .3 mm/sqrt(m), corners with .1 px of noise, no pictures), each drive solved from
both cameras together and from each camera alone. Three kinds of robots: a camera ahead and one behind, which never see
the box at the same stop; a stereo pair of 60 mm; a lens of 30 deg beside a fisheye lens of 120 deg. Printed for each:
errors of the pair's transform over their sigmas (largest) and over the bound (root mean square over all six of all
robots), errors of the wheels over those from the better camera alone, and how long the common solution takes.

With --moving each camera also takes frames on the move, both at the same moments, with a clock of its own (stamps 30 ms
late and 20 ms early, jitter .5 ms); printed are errors of wheels and cameras' places over their sigmas and over the
bound (known noise levels), what frames do to the sigmas of the stops, and the clocks' errors over their sigmas.

    python benchmarks/cameras.py              40 robots of each kind, some 4 minutes on one core
    python benchmarks/cameras.py --moving     the same with frames on the move, some 8 minutes
    python benchmarks/cameras.py --quick      4 robots of each kind
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import atan2, radians, tan

import numpy as np

from boxcal.calib.geometry.camera_pair import between, pair_jacobian
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood import CameraKind, EstimateOptions
from boxcal.calib.likelihood.cameras.estimates import Cameras, solve_cameras
from boxcal.calib.likelihood.cameras.moving.joint import covariance_at
from boxcal.calib.likelihood.cameras.moving.merge import with_frames_of_all
from boxcal.calib.likelihood.cameras.moving.row import Seen
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import LATE, one_time
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import joined, solved
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.more_cameras import seen_by, with_camera_at
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.calib.simulate.robot import Robot, mount, random_robot
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.calib.uncertainty.cramer_rao import Truth
from boxcal.calib.uncertainty.cramer_rao_cameras import cramer_rao_cameras
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel
from boxcal.target.errors import BoxcalError

STOPS, SIGMA_PX, SLIP, CLEARANCE = 20, 0.1, 3e-4, 0.15
LEAST_TAGS = 4
GOAL_SIGMAS, GOAL_RATIO = 3.0, 1.1
Kind = Callable[[np.random.Generator], tuple[Robot, Robot]]


def ahead_and_behind(rng: np.random.Generator) -> tuple[Robot, Robot]:
    """Return a robot with its camera ahead, and with one of another lens behind."""
    first = _looking_ahead(rng)
    z = rng.uniform(0.08, 0.25)
    place = mount(
        yaw=radians(180 + rng.uniform(-8, 8)),
        pitch=atan2(z - 0.1, 0.6) + radians(rng.uniform(-4, 4)),
        x=-rng.uniform(0.02, 0.08),
        y=rng.uniform(-0.02, 0.02),
        z=z,
    )
    return first, with_camera_at(first, place, replace(first.camera, fu=480.0, fv=482.0, kr=-0.1))


def stereo(rng: np.random.Generator) -> tuple[Robot, Robot]:
    """Return a robot with its left and with its right camera, 60 mm apart."""
    first = _looking_ahead(rng)
    offset = np.eye(4)
    offset[:3, 3] = 0.06, *rng.normal(0, 5e-4, 2)
    other = replace(first.camera, fu=first.camera.fu * 1.01, fv=first.camera.fv * 1.01, kr=first.camera.kr - 0.02)
    return first, with_camera_at(first, first.T_body_cam @ offset, other)


def narrow_and_wide(rng: np.random.Generator) -> tuple[Robot, Robot]:
    """Return a robot with a lens of 30 deg across, and with a fisheye lens of 120 deg beside it."""
    first = _looking_ahead(rng)
    f = (first.image_size[0] / 2) / tan(radians(15))
    first = replace(first, camera=replace(first.camera, fu=f, fv=f * 1.002, kr=-0.05))
    f = (first.image_size[0] / 2) / radians(60)
    wide = CameraModel(
        fu=f, fv=f * 1.003, cu=321.0, cv=238.0, kr=0.02, k2=-0.008, k3=0.002, k4=-4e-4, kind=CameraKind.FISHEYE
    )
    offset = np.eye(4)
    offset[:3, 3] = rng.uniform(0.02, 0.05), 0.0, 0.0
    return first, with_camera_at(first, first.T_body_cam @ offset, wide)


def _looking_ahead(rng: np.random.Generator) -> Robot:
    while True:
        robot = random_robot("robot", rng)
        if robot.T_body_cam[0, 2] > 0.8:
            return robot


KINDS: dict[str, Kind] = {
    "ahead and behind": ahead_and_behind,
    "stereo, 60 mm": stereo,
    "30 and 120 deg": narrow_and_wide,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One robot: errors (6,), sigmas and bounds of the pair's transform, and of the wheels (3,).

    Then errors and sigmas of the wheels by the better camera alone, seconds of each camera alone and of both together,
    the number of stops that both saw, and what was said.
    """

    pair: Array
    pair_sigma: Array
    pair_bound: Array
    wheels: Array
    wheels_sigma: Array
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
        drive = _driven(robots, rng)
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
    return Outcome(
        pair=np.concatenate([log_so3(true[:3, :3].T @ is_[:3, :3]), is_[:3, 3] - true[:3, 3]]),
        pair_sigma=np.sqrt(np.diag(J @ both.mountings @ J.T)),
        pair_bound=np.sqrt(np.diag(J @ bound[3:, 3:] @ J.T)),
        wheels=_wheels(a) - _wheels_of(robots[0]),
        wheels_sigma=np.sqrt(np.diag(a.cov)[5:8]),
        wheels_bound=np.sqrt(np.diag(bound)[:3]),
        alone=_wheels(better) - _wheels_of(robots[0]),
        alone_sigma=np.sqrt(np.diag(better.cov)[5:8]),
        seconds=seconds,
        shared_stops=len(set(kept[0]) & set(kept[1])),
        said=both.apart or both.doubt,
    )


def _driven(robots: tuple[Robot, Robot], rng: np.random.Generator) -> Drive:
    """Return a drive whose stops show the box to the one camera and to the other by turns."""
    target, gap = make_target(), CLEARANCE + max(robot.reach for robot in robots)
    stops = np.empty((STOPS, 3))
    for k, robot in enumerate(robots):
        stops[k::2] = choose_stops(robot, target, STOPS // 2, gap, rng)
    return simulate_drive(robots[0], target, DriveOptions(stops=STOPS, slip=SLIP), rng, stops=stops)


def _wheels(found: Estimate) -> Array:
    return np.array([found.rR, found.rL, found.b])


def _wheels_of(robot: Robot) -> Array:
    return np.array([robot.rR, robot.rL, robot.b])


def _relative(found: Estimate) -> Array:
    return np.asarray(np.sqrt(np.diag(found.cov)[5:8]) / _wheels(found))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


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
        f"the bound, rms {_rms(pair / bound):.3f} (goal {GOAL_RATIO}; rx {ratios[0]:.2f} ry {ratios[1]:.2f} "
        f"rz {ratios[2]:.2f} tx {ratios[3]:.2f} ty {ratios[4]:.2f} tz {ratios[5]:.2f})"
    )
    print(
        f"  sigma of the pair's place: {1e3 * np.median(np.linalg.norm(sigma[:, 3:], axis=1)):.2f} mm, of its rotation "
        f"{np.degrees(np.median(np.linalg.norm(sigma[:, :3], axis=1))):.3f} deg (median robot)"
    )
    less = np.median([o.wheels_sigma / o.alone_sigma for o in done])
    of_bound = _rms(wheels / np.array([o.wheels_bound for o in done]))
    print(
        f"  wheels: error over the better camera's, rms {_rms(wheels / wheels_scale(done)):.2f} to "
        f"{_rms(alone / wheels_scale(done)):.2f}; sigma over its {less:.2f} (median); error over the bound "
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moved:
    """One robot with frames on the move: both cameras' ``ERRORS``, (2, 5) each, in SI.

    ``late`` are the errors of both clocks over their sigmas, (2,), NaN for a camera whose frames were not used.
    """

    error: Array
    sigma: Array
    stops_sigma: Array
    bound: Array
    late: Array
    frames: int
    seconds: tuple[float, float]
    notes: tuple[str, ...]


ERRORS = ("rR", "rL", "b", "tx", "ty")
LATE_S, JITTER_S = (0.03, -0.02), 5e-4


def moved(kind: Kind, number: int, seed: int) -> Moved | None:
    """Return what one robot's drive with frames on the move gives; None as of :func:`outcome`."""
    rng = np.random.default_rng([seed, number])
    robots, options = kind(rng), EstimateOptions(systematic_share=0.0)
    try:
        drive = _driven(robots, rng)
        drives = (drive, seen_by(drive, *robots))
        views = [_with_frames(r, d, t, rng) for r, d, t in zip(robots, drives, LATE_S, strict=True)]
        fits = [fit([v], None, replace(options, lens=r.camera.kind)) for v, r in zip(views, robots, strict=True)]
        found = [reported(f, [v], options) for f, v in zip(fits, views, strict=True)]
    except BoxcalError:
        return None
    begun = time.process_time()
    stops = solve_cameras(found, fits, [[v] for v in views])
    middle = time.process_time()
    both = with_frames_of_all(stops, [(e, f, [v]) for e, f, v in zip(found, fits, views, strict=True)])
    seconds = (middle - begun, time.process_time() - middle)
    columns = [5, 6, 7, 11, 12]
    late = [
        (e.values[e.names.index(LATE)] - t) / np.sqrt(e.cov_all[e.names.index(LATE), e.names.index(LATE)])
        if LATE in e.names
        else np.nan
        for e, t in zip(both.estimates, LATE_S, strict=True)
    ]
    return Moved(
        error=np.array([_errors(e, r) for e, r in zip(both.estimates, robots, strict=True)]),
        sigma=np.array([np.sqrt(np.diag(e.cov)[columns]) for e in both.estimates]),
        stops_sigma=np.array([np.sqrt(np.diag(e.cov)[columns]) for e in stops.estimates]),
        bound=_bound_with_frames(stops, fits, views),
        late=np.array(late),
        frames=sum(len(v.moving) for v in views),
        seconds=seconds,
        notes=both.notes,
    )


def _with_frames(robot: Robot, drive: Drive, late_s: float, rng: np.random.Generator) -> Correspondences:
    """Return a drive as one camera saw it: stops where it sees four tags or more, and frames between stops."""
    target = make_target()
    view = exact_correspondences(robot, target, drive, SIGMA_PX, rng)
    kept = [j for j, s in enumerate(view.stops) if len(s.landmark_ids) >= 4 * LEAST_TAGS]
    shutter = ShutterOptions(late_s=late_s, jitter_s=JITTER_S, sigma_px=SIGMA_PX, period_s=0.5)
    frames = moving_frames(robot, target, drive, shutter, rng)
    return replace(view, stops=tuple(view.stops[j] for j in kept), moving=frames)


def _errors(found: Estimate, robot: Robot) -> Array:
    return np.concatenate([_wheels(found) - _wheels_of(robot), (found.T_body_cam - robot.T_body_cam)[:2, 3]])


def _bound_with_frames(stops: Cameras, fits: Sequence[Fit], views: Sequence[Correspondences]) -> Array:
    """Return the Cramer-Rao bound of both cameras' ``ERRORS`` for known noise levels, (2, 5)."""
    if stops.fit is None:
        return np.full((2, len(ERRORS)), np.nan)
    noise = FrameNoise(slip=SLIP, jitter_s=JITTER_S, sway=0.03, scale=1.0)
    seen = []
    for f, view, late_s in zip(fits, views, LATE_S, strict=True):
        clocks = one_time(1).plus(np.array([late_s]), np.zeros(1))
        joint = joined(f, [view], np.arange(len(view.moving)), clocks, noise)
        at = solved(f, joint, noise, np.array([SLIP]), np.array([JITTER_S]))
        seen.append(Seen(fit=f, drive=view, settled=Settled(joint=joint, noise=noise, levels=at, weight=np.ones(1))))
    cov, joint_of_all = covariance_at(stops.fit, stops.drives[0], seen, SLIP)
    out = []
    for part, camera in zip(joint_of_all.row.robot.parts, joint_of_all.state.cameras, strict=True):
        own = cov[np.ix_(part.columns[:14], part.columns[:14])]
        R = camera.T_body_cam[:3, :3]
        out.append(np.sqrt(np.concatenate([np.diag(own)[5:8], np.diag(R @ own[11:14, 11:14] @ R.T)[:2]])))
    return np.array(out)


def report_moved(title: str, outcomes: list[Moved | None]) -> None:
    """Print the lines of one kind of robots with frames on the move."""
    done = [o for o in outcomes if o is not None]
    z, of_bound = np.array([o.error / o.sigma for o in done]), np.array([o.error / o.bound for o in done])
    used = sum("were used" in " ".join(o.notes) for o in done)
    print(f"{title}: {len(done)} of {len(outcomes)} robots, frames used of {used}")
    print(
        f"  errors: largest {np.abs(z).max():.2f} sigma, rms {_rms(z):.3f} sigma, within 95 % intervals "
        f"{100 * np.mean(np.abs(z) < 1.96):.1f} %"
    )
    each = np.sqrt(np.mean(of_bound**2, axis=(0, 1)))
    print(f"  error over the bound, rms {_rms(of_bound):.3f} ({_listed(each)})")
    less = np.median(np.array([o.sigma / o.stops_sigma for o in done]), axis=(0, 1))
    print(f"  sigma over that of the stops of both cameras (median): {_listed(less)}")
    late = np.array([o.late for o in done])
    late = late[np.isfinite(late)]
    print(f"  clocks: largest error {np.abs(late).max():.2f} sigma, rms {_rms(late):.2f}, of {len(late)}")
    seconds = np.array([o.seconds for o in done])
    print(f"  {np.median(seconds[:, 0]):.2f} s for stops together, {np.median(seconds[:, 1]):.2f} s more for frames")
    odd = [note for o in done for note in o.notes if "left out" in note or "none that can be used" in note]
    print(f"  said: {len(odd)}{f' ({odd[0]})' if odd else ''}", flush=True)


def _listed(values: Array) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(ERRORS, values, strict=True))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--moving", action="store_true")
    parser.add_argument("--robots", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2026)
    args = parser.parse_args()
    numbers = range(1, 1 + (4 if args.quick else args.robots))
    for title, kind in KINDS.items():
        if args.moving:
            report_moved(title, [moved(kind, k, args.seed) for k in numbers])
        else:
            report(title, [outcome(kind, k, args.seed) for k in numbers])


if __name__ == "__main__":
    main()
