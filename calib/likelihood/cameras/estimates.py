"""Estimates of the cameras of one robot, as their common solution has them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from boxcal.calib.geometry.parameters import COUNT, MOUNTING, TRANSLATION, WHEELS
from boxcal.calib.geometry.so3_se3 import inverse, rigid
from boxcal.calib.likelihood.cameras.agreement import disagreement
from boxcal.calib.likelihood.cameras.solve import RobotFit, solved
from boxcal.calib.likelihood.cameras.start import beginning
from boxcal.calib.likelihood.estimate import DriveEstimate, Estimate
from boxcal.calib.likelihood.estimator import ASSUMED_SLIP, LEGS_FOR_SLIP
from boxcal.calib.likelihood.explanation import Explanation, in_pictures
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_outliers import flagged_legs
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State, camera_motions
from boxcal.calib.likelihood.summary import reported_cov
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.measure.size_influence import measured_scale_sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cameras:
    """Estimates of all cameras of a robot, and the covariance between them.

    Attributes
    ----------
    estimates
        Of each camera: its own lens and extrinsics, wheels and stops of all.
    mountings : (6 C, 6 C)
        Covariance of all extrinsics: rotation (right perturbation, rad) and translation (m, along the body's axes) of
        one camera after the other.
    apart
        Why the cameras could not be solved together, and the covariance is an upper bound only; else empty.
    doubt
        What speaks against the cameras' belonging to one robot and one drive; empty if nothing does.
    notes
        What the user should know of the common solution.
    fit, drives
        That solution, and the drives with the stops of all cameras; None, and none, where there is no such solution.
    inflation : (n,)
        Factors on the standard deviations of the solution's unknowns, by how stops and legs of a camera disagree.
    """

    estimates: tuple[Estimate, ...]
    mountings: Array
    apart: str = ""
    doubt: str = ""
    notes: tuple[str, ...] = ()
    fit: RobotFit | None = None
    drives: tuple[Correspondences, ...] = ()
    inflation: Array = field(default_factory=lambda: np.ones(0))


def solve_cameras(
    found: Sequence[Estimate],
    fits: Sequence[Fit],
    drives: Sequence[Sequence[Correspondences]],
    slip: float | None = None,
    causes: tuple[Explanation, ...] | None = None,
) -> Cameras:
    """Return the estimates of a robot's cameras from all of them together.

    Parameters
    ----------
    found, fits
        Each camera's own estimate, and the solution that it reports.
    drives
        For each camera the same drives, as it saw them.
    slip : m/sqrt(m)
        As it was given; estimated from the legs of all if None, also where one camera saw too few for that.
    causes
        Causes in the wheels to solve for; if None, all that any camera's own solution has.
    """
    why = _unsuitable(fits)
    if not why:
        try:
            begin = beginning(fits, drives, causes)
            few = 0 < len(begin.legs) < LEGS_FOR_SLIP
            options = replace(fits[0].options, slip=ASSUMED_SLIP if slip is None and few else slip)
            fit = solved(begin.robot, begin.state, begin.levels, begin.legs, options)
        except np.linalg.LinAlgError:
            why = "their common equations cannot be solved"
    if why:
        return apart(found, why)
    return _reported(found, fits, begin.drives, fit)


def apart(found: Sequence[Estimate], why: str) -> Cameras:
    """Return each camera's own estimate, with a covariance that holds however their errors go together.

    Twice the sum of two covariances is no less than that of the difference, whatever the two share.
    """
    size = 6 * len(found)
    mountings = np.zeros((size, size))
    for c, estimate in enumerate(found):
        rows = slice(6 * c, 6 * c + 6)
        mountings[rows, rows] = 2 * estimate.cov[MOUNTING, MOUNTING]
    return Cameras(estimates=tuple(found), mountings=mountings, apart=why)


def _unsuitable(fits: Sequence[Fit]) -> str:
    """Return why cameras cannot be solved together; empty if they can."""
    if any(in_pictures(cause) for fit in fits for cause in fit.problem.explanations):
        return "something happened to a camera or to the box between stops"
    if len({fit.problem.target.names for fit in fits}) > 1:
        return "their box has different unknowns"
    return ""


def _reported(
    found: Sequence[Estimate], fits: Sequence[Fit], drives: Sequence[Correspondences], fit: RobotFit
) -> Cameras:
    robot = fit.robot
    names = list(robot.problem.names)
    cov, R = fit.cov.copy(), np.eye(len(names))
    for part, camera in zip(robot.parts, fit.found.state.cameras, strict=True):
        at = part.columns[TRANSLATION]
        R[np.ix_(at, at)] = camera.T_body_cam[:3, :3]
    cov = R @ cov @ R.T
    factor, more = np.ones(len(names)), np.zeros_like(cov)
    for part, own in zip(robot.parts, found, strict=True):
        at = part.columns[:COUNT]
        factor[at] = np.maximum(factor[at], own.jackknife.inflation)
    options = fits[0].options
    size = measured_scale_sigma(options.target) if options.target is not None and options.measured_sizes else 0.0
    v = np.zeros(len(names))
    for part, camera in zip(robot.parts, fit.found.state.cameras, strict=True):
        v[part.columns[WHEELS]] = fit.found.state.body.wheels * size
        v[part.columns[TRANSLATION]] = camera.T_body_cam[:3, 3] * size
    for part, own, alone in zip(robot.parts, found, fits, strict=True):
        at = part.columns
        more[np.ix_(at, at)] += _besides(own, alone, cov[np.ix_(at, at)], v[at])
    cov = cov * np.outer(factor, factor) + np.outer(v, v) + more
    mounted = np.concatenate([part.columns[MOUNTING] for part in robot.parts])
    estimates = tuple(_estimate(own, fit, c, cov) for c, own in enumerate(found))
    used = (fit.legs > 0) | ~robot.problem.leg_known
    legs = flagged_legs(robot.problem, fit.found.at.state, fit.tests, used, list(drives))
    notes = tuple(f"all cameras together: {leg.text}" for leg in legs)
    if not fit.converged:
        notes = (*notes, "all cameras together: the noise levels had not settled; take the sigmas with care")
    return Cameras(
        estimates=estimates,
        mountings=cov[np.ix_(mounted, mounted)],
        doubt=disagreement(fits, fit),
        notes=notes,
        fit=fit,
        drives=tuple(drives),
        inflation=factor,
    )


def _besides(own: Estimate, alone: Fit, together: Array, v: Array) -> Array:
    """Return what a camera's covariance has besides the likelihood's and the ruler's: doubts, (n_c, n_c).

    A doubt widens what the camera by itself says of its unknowns; as much, in proportion, it widens what all cameras
    say of them (``together``, the likelihood's): of wheels that others determine well, a camera's few stops cast
    little.
    """
    count = len(together)
    likelihood = reported_cov(alone.cov, alone.state, np.zeros(len(alone.cov), dtype=np.bool_))
    likelihood[:COUNT, :COUNT] *= np.outer(own.jackknife.inflation, own.jackknife.inflation)
    likelihood = likelihood[:count, :count]
    rest = own.cov_all[:count, :count] - likelihood - np.outer(v, v)
    sigma = np.sqrt(np.diag(likelihood))
    if not (np.all(np.isfinite(rest)) and np.all(sigma > 0)):  # what one camera leaves open, all may determine
        return np.zeros((count, count))
    values, vectors = np.linalg.eigh(likelihood / np.outer(sigma, sigma))
    root = sigma[:, None] * vectors * np.sqrt(np.maximum(values, _LEAST))
    white = (vectors / np.sqrt(np.maximum(values, _LEAST))).T / sigma
    less = _root(white @ together @ white.T)
    doubt, axes = np.linalg.eigh(white @ rest @ white.T)
    widened = root @ less @ axes * np.sqrt(np.maximum(doubt, 0.0))
    return np.asarray(widened @ widened.T)


_LEAST = 1e-10
"""Eigenvalues of correlations below this are rounding."""


def _root(matrix: Array) -> Array:
    """Return the symmetric root of a covariance."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _estimate(own: Estimate, fit: RobotFit, number: int, cov: Array) -> Estimate:
    """Return one camera's estimate with the values and the covariance of the common solution."""
    part, state = fit.robot.parts[number], fit.found.state
    here, n = state.of(part, number), len(part.columns)
    of_causes = fit.robot.problem.names[fit.robot.problem.explained][: fit.robot.causes]
    causes = dict(zip(of_causes, state.body.explained[: fit.robot.causes].tolist(), strict=True))
    own = replace(own, names=(*own.names[:n], *causes), values=np.concatenate([own.values[:n], [*causes.values()]]))
    columns = columns_of(fit, number)
    cov_all = cov[np.ix_(columns, columns)]
    profile = fit.profile
    found = with_values(own, part.problem, here, causes, cov_all)
    return replace(
        found,
        drives=tuple(_drive(own.drives[d], d, fit, number, cov_all) for d in range(part.problem.drives)),
        noise=replace(own.noise, slip=profile.mean, slip_sigma=profile.sigma),
    )


def columns_of(fit: RobotFit, number: int) -> list[int]:
    """Return where what a camera's estimate names stands among all: its own unknowns, then the causes in the wheels."""
    first = int(fit.robot.problem.explained.start)
    return [*fit.robot.parts[number].columns.tolist(), *range(first, first + fit.robot.causes)]


def with_values(own: Estimate, problem: Problem, here: State, causes: Mapping[str, float], cov_all: Array) -> Estimate:
    """Return one camera's estimate with the values of a state of its own, and another covariance of its unknowns.

    Parameters
    ----------
    own
        The estimate.
    problem
        The camera's, without explanations.
    here
        The state.
    causes
        Values of the explanations' unknowns, by name.
    cov_all : (n, n)
        Covariance of all that the estimate names.
    """
    values = own.values.copy()
    values[:5], values[5:8], values[problem.extras] = here.lens[:5], here.wheels, here.lens[5:]
    values[problem.tilts] = here.tilt.ravel() if problem.tilt_count else 0.0
    values[problem.shapes], values[problem.growth] = here.shape, here.common_growth
    first = int(problem.explained.start)
    values[first:] = [causes[name] for name in own.names[first:]]
    change = cov_all[:COUNT, :COUNT] - own.cov
    return replace(
        own,
        camera=own.camera.from_values(problem.lens, here.lens),
        rR=float(here.wheels[0]),
        rL=float(here.wheels[1]),
        b=float(here.wheels[2]),
        T_body_cam=here.T_body_cam,
        cov=cov_all[:COUNT, :COUNT],
        cov_all=cov_all,
        values=values,
        odometry_cov=None if own.odometry_cov is None else own.odometry_cov + change,
    )


def _drive(own: DriveEstimate, d: int, fit: RobotFit, number: int, cov: Array) -> DriveEstimate:
    """Return one camera's stops of a drive where all cameras put them."""
    part = fit.robot.parts[number]
    problem, state = part.problem, fit.found.state.of(part, number)
    rows = np.flatnonzero(problem.drive == d)
    motions, T_cam_body = camera_motions(problem, state), inverse(state.T_body_cam)
    blocks, _ = fit.profile.solution.stop_blocks()
    pose_cov = np.tensordot(fit.profile.weight, blocks[:, part.places[rows], :3, :3], 1)
    error = np.linalg.solve(problem.whiten, fit.found.cameras[number].corners.residual[:, :, None])[:, :, 0]
    stop, P = problem.corner_stop, len(problem.drive)
    square = np.bincount(stop, weights=np.sum(error**2, axis=1) * part.corners, minlength=P)
    count = np.maximum(np.bincount(stop, weights=part.corners, minlength=P), 1)
    tilts = problem.tilts.start + 2 * d + np.arange(2)
    return replace(
        own,
        T_box_body=np.array([rigid(motions.R_box_cam[k], motions.p_box_cam[k]) @ T_cam_body for k in rows]).reshape(
            -1, 4, 4
        ),
        pose_cov=pose_cov,
        tilt=state.tilt[d],
        tilt_sigma=np.sqrt(np.diag(cov)[tilts]) if problem.tilt_count else own.tilt_sigma,
        stop_rms_px=np.sqrt(square / count)[rows],
    )
