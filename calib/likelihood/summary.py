"""From the solver's terms to what is reported."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.geometry.parameters import CAMERA, COUNT, TRANSLATION, WHEELS
from boxcal.calib.geometry.so3_se3 import inverse, rigid
from boxcal.calib.geometry.two_by_two import inverses, products
from boxcal.calib.likelihood.estimate import DriveEstimate, Estimate, FlaggedCorner, FlaggedLeg, NoiseLevels
from boxcal.calib.likelihood.fit import Fit, log_noise
from boxcal.calib.likelihood.jackknife import jackknife
from boxcal.calib.likelihood.leave_one_out import Jackknife
from boxcal.calib.likelihood.leg_outliers import flagged_legs
from boxcal.calib.likelihood.leg_residuals import leg_covariance
from boxcal.calib.likelihood.observability import open_directions
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.priors import shared_values
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State, camera_motions
from boxcal.calib.likelihood.target_deformation import HAND_MADE
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Mask
from boxcal.target.camera.camera_model import CameraModel
from boxcal.target.measure.size_influence import measured_scale_sigma

_PRIOR_ONLY = 0.9
_IN_WORDS = {"seat": "how high the sheets stand on the box"}
"""Unknowns whose names a stranger would not understand."""


def summarise(fit: Fit, drives: Sequence[Correspondences]) -> Estimate:
    """Return the estimate that a solution amounts to."""
    problem, state = fit.problem, fit.state
    best = int(np.argmax(fit.profile.log_weight))
    sigma_px = _rms_sigma_px(problem.stated_px2 + problem.floor_px**2 * np.eye(2))
    above_stated = sigma_px / _rms_sigma_px(problem.stated_px2)
    directions, unknown = open_directions(problem, state, fit.profile.solution.information[best])
    left_out = jackknife(fit)
    cov = reported_cov(fit.cov, state, unknown)
    cov[:COUNT, :COUNT] *= np.outer(left_out.inflation, left_out.inflation)
    cov += measured_scale_covariance(problem, state, fit.options)
    used = fit.weights.legs > 0
    legs = flagged_legs(problem, state, fit.tests, used | ~problem.leg_known, list(drives))
    return Estimate(
        camera=CameraModel.from_values(problem.lens, state.lens),
        rR=float(state.wheels[0]),
        rL=float(state.wheels[1]),
        b=float(state.wheels[2]),
        T_body_cam=state.T_body_cam,
        drives=tuple(_drive(fit, d, drive.robot, cov) for d, drive in enumerate(drives)),
        noise=NoiseLevels(
            pixel_factor=fit.components.noise_scale * above_stated,
            pixel_factor_sigma=fit.noise_scale_sigma * above_stated,
            pixel_px=fit.components.noise_scale * sigma_px,
            slip=fit.profile.mean,
            slip_sigma=fit.profile.sigma,
            encoder_step=problem.step,
        ),
        cov=cov[:COUNT, :COUNT],
        names=problem.names,
        values=values_of(problem, state),
        cov_all=cov,
        flagged_legs=legs,
        flagged_corners=_flagged_corners(fit, drives),
        directions=directions,
        notes=_notes(fit, legs, cov, left_out),
        components=fit.components,
        jackknife=left_out,
        scale_sigma=scale_sigma(fit),
        iterations=fit.iterations,
        cost=fit.cost,
        log_likelihood=_log_likelihood(fit),
    )


def measured_scale_covariance(problem: Problem, state: State, options: EstimateOptions) -> Array:
    """Return what the ruler's own error does to all lengths together, added to the covariance of the shared unknowns.

    No image shows the size of the box as a whole, and a box that is regular says nothing of the ruler: wheels and
    camera position grow with the box in one direction, known as well as the box was measured.
    """
    v = np.zeros(len(problem.names))
    if options.target is not None and options.measured_sizes:
        v[WHEELS], v[TRANSLATION] = state.wheels, state.T_body_cam[:3, 3]
        v *= measured_scale_sigma(options.target)
    return np.outer(v, v)


def scale_sigma(fit: Fit) -> float:
    """Return what the size of the target as a whole adds to every length, relative; see :class:`Estimate`."""
    target = fit.options.target
    measured = target is not None and target.measured is not None and fit.options.measured_sizes
    return 0.0 if measured or fit.options.size_sigma > 0 else HAND_MADE["print"] / float(np.sqrt(2))


def reported_cov(cov: Array, state: State, unknown: Mask) -> Array:
    """Return the covariance with the extrinsics' translation along the body's axes; the unknown is infinite."""
    M = np.eye(len(cov))
    t = TRANSLATION
    M[t, t] = state.T_body_cam[:3, :3]
    out = M @ cov @ M.T
    if np.any(unknown):
        unknown = unknown.copy()
        unknown[t] = np.any(unknown[t])
        out[unknown, :] = np.nan
        out[:, unknown] = np.nan
        out[unknown, unknown] = np.inf
    return np.asarray(out)


def values_of(problem: Problem, state: State) -> Array:
    """Return the values of all shared unknowns; 0 for the extrinsics' perturbation."""
    values = shared_values(problem, state)
    values[CAMERA], values[WHEELS], values[problem.extras] = state.lens[CAMERA], state.wheels, state.lens[5:]
    return values


def _rms_sigma_px(cov_px2: Array) -> float:
    return float(np.sqrt(np.mean(np.trace(cov_px2, axis1=1, axis2=2)) / 2))


def errors_px(fit: Fit) -> Array:
    """Return the corners' errors, (L, 2) px, seen less predicted."""
    return products(inverses(fit.problem.whiten), fit.at.residual_px)


def _drive(fit: Fit, d: int, robot: str, cov: Array) -> DriveEstimate:
    problem, state = fit.problem, fit.state
    rows = np.flatnonzero(problem.drive == d)
    legs = np.flatnonzero(problem.drive[problem.leg_stop] == d)
    own, _ = fit.profile.solution.stop_blocks()
    pose_cov = np.tensordot(fit.profile.weight, own[:, rows, :3, :3], 1)
    motions, T_cam_body = camera_motions(problem, state), inverse(state.T_body_cam)
    square = np.sum(errors_px(fit) ** 2, axis=1) * fit.weights.corners
    stop, P = problem.corner_stop, len(problem.drive)
    count = np.maximum(np.bincount(stop, weights=fit.weights.corners, minlength=P), 1)
    rms = np.sqrt(np.bincount(stop, weights=square, minlength=P) / count)
    tilts = problem.tilts.start + 2 * d + np.arange(2)
    return DriveEstimate(
        robot=robot,
        stops=tuple(int(j) for j in problem.stop[rows]),
        T_box_body=np.array(
            [rigid(motions.R_box_cam[row], motions.p_box_cam[row]) @ T_cam_body for row in rows]
        ).reshape(-1, 4, 4),
        pose_cov=pose_cov,
        tilt=state.tilt[d],
        tilt_sigma=np.sqrt(np.diag(cov)[tilts]) if problem.tilt_count else np.zeros(2),
        stop_rms_px=rms[rows],
        leg_residuals=fit.tests.whitened[legs],
        leg_p_values=fit.tests.p_value[legs],
        leg_used=fit.weights.legs[legs] > 0,
    )


def _flagged_corners(fit: Fit, drives: Sequence[Correspondences]) -> tuple[FlaggedCorner, ...]:
    problem = fit.problem
    stop, error = problem.corner_stop, errors_px(fit)
    found = []
    for row in np.flatnonzero(fit.weights.corners == 0):
        j = int(stop[row])
        d, number = int(problem.drive[j]), int(problem.stop[j])
        within = int(row - problem.corner_starts[j])
        found.append(
            FlaggedCorner(
                drive=d,
                stop=number,
                landmark_id=int(drives[d].stops[number].landmark_ids[within]),
                error_px=(float(error[row, 0]), float(error[row, 1])),
            )
        )
    return tuple(found)


def _notes(fit: Fit, legs: tuple[FlaggedLeg, ...], cov: Array, left_out: Jackknife) -> tuple[str, ...]:
    problem = fit.problem
    notes = [leg.text for leg in legs]
    for i in problem.leg_stop[~problem.leg_known].tolist():
        a, b = int(problem.stop[i]) + 1, int(problem.stop[i + 1]) + 1
        of = f" of drive {int(problem.drive[i]) + 1}" if problem.drives > 1 else ""
        notes.append(f"between stop {a} and stop {b}{of} the wheels do not cover the path: that leg was not used")
    out = int(np.sum(fit.weights.corners == 0))
    if out:
        notes.append(f"{out} of {len(problem.uv_px)} corners lie further off than noise explains and were left out")
    notes.extend(
        f"stop {int(problem.stop[j]) + 1}: more than half of its corners do not fit the rest of the drive; none was "
        "left out, look at its picture"
        for j in fit.unreliable_stops
    )
    for k in range(COUNT, len(problem.names)):
        sigma = float(np.sqrt(cov[k, k]))
        if not problem.component[k] and sigma > _PRIOR_ONLY * problem.prior[k]:
            what = _IN_WORDS.get(problem.names[k], problem.names[k])
            notes.append(f"the drive hardly determines {what}: the value assumed for it decides")
    if left_out.unexplained:
        notes.append(
            f"leaving out single stops and legs moves the answer by {left_out.ratio.max():.1f} times what noise "
            f"explains ({left_out.worst} most): something is not as the model has it; sigmas are enlarged to that"
        )
    if not fit.converged:
        notes.append("the noise levels had not settled when the rounds ended; take the sigmas with care")
    return tuple(notes)


def _log_likelihood(fit: Fit) -> float:
    """Return the log likelihood of corners and legs, their noise in it, without constants of the data."""
    problem, used = fit.problem, fit.weights.legs > 0
    corners = log_noise(fit)
    C = leg_covariance(problem, fit.at.legs.model, np.array(fit.components.slip))
    legs = 0.5 * float(np.sum(np.linalg.slogdet(C)[1][used])) if np.any(used) else 0.0
    return float(-0.5 * fit.cost - corners - legs)
