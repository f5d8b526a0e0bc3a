"""Frames on the move of two cameras, each with a clock of its own: the table of ``cameras.py --moving``."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from camera_robots import LEAST_TAGS, SIGMA_PX, SLIP, Kind, driven, found_wheels, of_one, rms, true_wheels, whitened

from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.cameras.estimates import Cameras, solve_cameras
from boxcal.calib.likelihood.cameras.moving.joint import covariance_at
from boxcal.calib.likelihood.cameras.moving.merge import with_frames_of_all
from boxcal.calib.likelihood.cameras.moving.row import Seen
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import LATE, one_time
from boxcal.calib.likelihood.moving.grid import Probable
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import joined, solved
from boxcal.calib.simulate.drive import Drive, exact_correspondences
from boxcal.calib.simulate.more_cameras import seen_by
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.calib.simulate.robot import Robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.errors import BoxcalError

ERRORS = ("rR", "rL", "b", "tx", "ty")
LATE_S, JITTER_S = (0.03, -0.02), 5e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moved:
    """One robot with frames on the move: both cameras' ``ERRORS``, (2, 5) each, in SI.

    ``whitened`` (2, 5) are a camera's errors in units of their covariance: independent, of one.
    ``late`` are the errors of both clocks over their sigmas, (2,), NaN for a camera whose frames were not used.
    """

    error: Array
    sigma: Array
    whitened: Array
    stops_sigma: Array
    bound: Array
    late: Array
    frames: int
    seconds: tuple[float, float]
    notes: tuple[str, ...]


def moved(kind: Kind, number: int, seed: int) -> Moved | None:
    """Return what one robot's drive with frames on the move gives; None as of :func:`outcome`."""
    rng = np.random.default_rng([seed, number])
    robots, options = kind(rng), EstimateOptions(systematic_share=0.0)
    try:
        drive = driven(robots, rng)
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
    error = np.array([_errors(e, r) for e, r in zip(both.estimates, robots, strict=True)])
    covs = [e.cov[np.ix_(columns, columns)] for e in both.estimates]
    return Moved(
        error=error,
        whitened=np.array([whitened(e, cov) for e, cov in zip(error, covs, strict=True)]),
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
    return np.concatenate([found_wheels(found) - true_wheels(robot), (found.T_body_cam - robot.T_body_cam)[:2, 3]])


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
        known = Probable(
            levels=at,
            weight=np.ones(1),
            slip=np.array([SLIP]),
            jitter_s=np.array([JITTER_S]),
            log_likelihood=np.zeros(1),
        )
        seen.append(Seen(fit=f, drive=view, settled=Settled(joint=joint, noise=noise, probable=known)))
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
        "  errors in units of their covariance: "
        + ", ".join(f"camera {c + 1} {of_one([o.whitened[c] for o in done])}" for c in range(2))
    )
    print(
        f"  errors: largest {np.abs(z).max():.2f} sigma, rms {rms(z):.3f} sigma, within 95 % intervals "
        f"{100 * np.mean(np.abs(z) < 1.96):.1f} %"
    )
    each = np.sqrt(np.mean(of_bound**2, axis=(0, 1)))
    print(f"  error over the bound, rms {rms(of_bound):.3f} ({_listed(each)})")
    less = np.median(np.array([o.sigma / o.stops_sigma for o in done]), axis=(0, 1))
    print(f"  sigma over that of the stops of both cameras (median): {_listed(less)}")
    late = np.array([o.late for o in done])
    late = late[np.isfinite(late)]
    print(f"  clocks: largest error {np.abs(late).max():.2f} sigma, rms {rms(late):.2f}, of {len(late)}")
    seconds = np.array([o.seconds for o in done])
    print(f"  {np.median(seconds[:, 0]):.2f} s for stops together, {np.median(seconds[:, 1]):.2f} s more for frames")
    odd = [note for o in done for note in o.notes if "left out" in note or "none that can be used" in note]
    print(f"  said: {len(odd)}{f' ({odd[0]})' if odd else ''}", flush=True)


def _listed(values: Array) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(ERRORS, values, strict=True))
