"""From what the steps and the likelihood found to the one result that is saved."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.geometry.diff_drive import Wheels, legs_between
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood import Estimate
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.results.calibration import Calibration, Provenance, Quality, StopResult
from boxcal.calib.results.diagnostics import Covariance, Detail, Ground, HeldOut, LeaveOneOut, Leg
from boxcal.calib.uncertainty.convergence_point import ConvergencePoint
from boxcal.calib.uncertainty.cross_validation import Validation
from boxcal.calib.uncertainty.propagation import camera_covariance, ground_uncertainty
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.arrays import Array

PROJECTION_DISTANCE = 1.0
"""Distance that the projection's uncertainty is given for, m."""


_EFFECT_UNIT = {"place": "_m", "turn": "_rad", "bow": "_m"}
"""Of how well the box was made, by component; the print's scale is relative."""


def closed_form(
    robot: str,
    drives: Sequence[Correspondences],
    steps: Sequence[FourSteps],
    provenance: Provenance,
    *,
    findings: tuple[Finding, ...] = (),
) -> Calibration:
    """Return the result of the four steps alone, for one drive.

    Parameters
    ----------
    robot
        Name.
    drives, steps
        The drive, and what the steps found in it; of several only the first decides camera, wheels and extrinsics.
    provenance
        How the result came about.
    findings
        Causes that the drive named before it was solved.
    """
    first = steps[0]
    return Calibration(
        robot=robot,
        image_size=drives[0].image_size,
        camera=first.camera.camera,
        wheels=Wheels(rR=first.mounting.rR, rL=first.mounting.rL, b=first.mounting.b),
        T_body_cam=first.T_body_cam,
        quality=_quality(steps, _closed_form_stops(drives, steps)),
        stops=_closed_form_stops(drives, steps),
        notes=_step_notes(steps),
        provenance=provenance,
        findings=findings,
    )


def refined(
    robot: str,
    drives: Sequence[Correspondences],
    steps: Sequence[FourSteps],
    estimate: Estimate,
    provenance: Provenance,
    *,
    validation: Validation | None = None,
    growth: tuple[ConvergencePoint, ...] = (),
) -> Calibration:
    """Return the result of the likelihood, with all that it says about itself.

    Parameters
    ----------
    robot
        Name.
    drives, steps, estimate
        The drives, what the steps found in each, and what the likelihood found in all.
    provenance
        How the result came about.
    validation
        Held-out stops, where asked for.
    growth
        Estimates over the number of stops, where asked for.
    """
    camera_names, camera_cov = camera_covariance(estimate)
    stops = tuple(
        _stop(d, drive.stops[j], float(rms), T_box_body @ estimate.T_body_cam)
        for d, (drive, found) in enumerate(zip(drives, estimate.drives, strict=True))
        for j, rms, T_box_body in zip(found.stops, found.stop_rms_px, found.T_box_body, strict=True)
    )
    return Calibration(
        robot=robot,
        image_size=drives[0].image_size,
        camera=estimate.camera,
        wheels=Wheels(rR=estimate.rR, rL=estimate.rL, b=estimate.b),
        T_body_cam=estimate.T_body_cam,
        quality=_quality(steps, stops),
        stops=stops,
        notes=_step_notes(steps) + estimate.notes,
        provenance=provenance,
        method="likelihood",
        findings=estimate.findings,
        detail=Detail(
            covariance=Covariance(matrix=estimate.cov),
            noise=estimate.noise,
            extra={
                name: float(value)
                for name, value in zip(estimate.names, estimate.values, strict=True)
                if name in estimate.extra_sigma and name not in estimate.camera.further
            },
            extra_sigma=dict(estimate.extra_sigma),
            legs=tuple(leg for d, drive in enumerate(drives) for leg in _legs(d, drive, estimate)),
            flagged_legs=estimate.flagged_legs,
            flagged_corners=estimate.flagged_corners,
            directions=estimate.directions,
            ground=_ground(estimate, drives[0].image_size),
            held_out=_held_out(validation),
            growth=growth,
            camera_covariance=Covariance(names=camera_names, matrix=camera_cov),
            leave_one_out=_leave_one_out(estimate),
            effects=_effects(estimate),
            scale_sigma=float(estimate.scale_sigma),
        ),
    )


def _leave_one_out(estimate: Estimate) -> LeaveOneOut:
    found = estimate.jackknife
    sigma, ratio = tuple(found.sigma.tolist()), tuple(found.ratio.tolist())
    return LeaveOneOut(sigma=sigma, ratio=ratio, limit=float(found.limit), unexplained=found.unexplained)


def _effects(estimate: Estimate) -> dict[str, float]:
    """Return the standard deviations of the random effects, named with their units."""
    c = estimate.components
    target = {f"{name}{_EFFECT_UNIT.get(name, '')}": float(value) for name, value in c.target.items()}
    floor = float(c.corner_floor * c.noise_scale)
    return {
        "lean_rad": float(c.lean),
        "height_m": float(c.height),
        "growth_px": float(c.growth),
        "corner_floor_px": floor,
        **target,
    }


def _legs(d: int, drive: Correspondences, estimate: Estimate) -> list[Leg]:
    found = estimate.drives[d]
    travel = legs_between(drive, found.stops)
    phi = np.stack([travel.phi_R, travel.phi_L], axis=1)
    out = []
    for k, (i, j) in enumerate(zip(found.stops[:-1], found.stops[1:], strict=True)):
        dR, dL = phi[k + 1] - phi[k]
        samples = slice(travel.ends[k], travel.ends[k + 1])
        rolled = (
            estimate.rR * np.abs(travel.dphi_R[samples]).sum() + estimate.rL * np.abs(travel.dphi_L[samples]).sum()
        ) / 2
        residual = found.leg_residuals[k]
        out.append(
            Leg(
                drive=d,
                start=i,
                end=j,
                t_start_ns=drive.stops[i].t_end_ns,
                t_end_ns=drive.stops[j].t_start_ns,
                rolled=float(rolled),
                turned=float((estimate.rR * dR - estimate.rL * dL) / estimate.b),
                residual=(float(residual[0]), float(residual[1]), float(residual[2])),
                p_value=float(found.leg_p_values[k]),
                used=bool(found.leg_used[k]),
            )
        )
    return out


def _ground(estimate: Estimate, image_size: tuple[int, int]) -> Ground:
    found = ground_uncertainty(estimate, image_size, PROJECTION_DISTANCE)
    return Ground(
        straight_heading=found.straight.heading,
        straight_position=float(np.hypot(found.straight.along, found.straight.across)),
        turn_heading=found.turn.heading,
        distance=found.projection.distance_m,
        projection_mean_px=found.projection.mean_px,
        projection_worst_px=found.projection.worst_px,
    )


def _held_out(validation: Validation | None) -> tuple[HeldOut, ...]:
    if validation is None:
        return ()
    return tuple(
        HeldOut(
            drive=s.drive,
            stop=s.stop,
            error=(float(s.error[0]), float(s.error[1]), float(s.error[2])),
            sigma=(float(s.sigma[0]), float(s.sigma[1]), float(s.sigma[2])),
        )
        for s in validation.stops
    )


def _quality(steps: Sequence[FourSteps], stops: tuple[StopResult, ...]) -> Quality:
    landmarks = sum(stop.landmarks for stop in stops)
    squares = sum(stop.landmarks * stop.reprojection_rms_px**2 for stop in stops)
    return Quality(
        stops=len(stops),
        landmarks=landmarks,
        reprojection_rms_px=float(np.sqrt(squares / landmarks)),
        heading_rms_rad=max(s.heading.rms for s in steps),
        sigma5_sigma4=max(s.mounting.null_ratio for s in steps),
        sigma4_sigma3=min(s.mounting.rank_ratio for s in steps),
        up_error_rad=max(s.axis.up_error for s in steps),
    )


def _closed_form_stops(drives: Sequence[Correspondences], steps: Sequence[FourSteps]) -> tuple[StopResult, ...]:
    return tuple(
        _stop(d, drive.stops[j], float(rms), T_box_cam)
        for d, (drive, step) in enumerate(zip(drives, steps, strict=True))
        for j, rms, T_box_cam in zip(
            step.camera.kept, step.camera.stop_rms_px, inverse(step.camera.T_cam_box), strict=True
        )
    )


def _stop(drive: int, seen: StopObservation, rms_px: float, T_box_cam: Array) -> StopResult:
    return StopResult(
        drive=drive,
        t_start_ns=seen.t_start_ns,
        t_end_ns=seen.t_end_ns,
        landmarks=len(seen.landmark_ids),
        reprojection_rms_px=rms_px,
        T_box_cam=T_box_cam,
    )


def _step_notes(steps: Sequence[FourSteps]) -> tuple[str, ...]:
    if len(steps) == 1:
        return steps[0].notes
    return tuple(f"drive {d + 1}: {note}" for d, step in enumerate(steps) for note in step.notes)
