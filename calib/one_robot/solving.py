"""The calibration that the drives of one robot give: by the likelihood, or by the closed form alone."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace

import numpy as np

from boxcal.calib.diagnosis.counters import WRAPS, counter_finding
from boxcal.calib.diagnosis.explained_estimate import ExplainedEstimate, estimate_explained, explained_estimate
from boxcal.calib.diagnosis.first_look import FirstLook
from boxcal.calib.diagnosis.last_look import last_look
from boxcal.calib.diagnosis.without_stops import said_without_stops
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import LEGS_FOR_SLIP, negative_wheels, unsolvable
from boxcal.calib.results.build import closed_form, refined
from boxcal.calib.results.calibration import Calibration, Provenance
from boxcal.calib.results.provenance import provenance
from boxcal.calib.settings import Job, listed
from boxcal.calib.uncertainty.box_size import box_notes
from boxcal.calib.uncertainty.convergence import grow
from boxcal.calib.uncertainty.cross_validation import validate
from boxcal.detect.correspondences import Correspondences

_SAME_FOCAL, _SAME_SEPARATION = 0.03, 0.4
"""How far focal length and wheel separation of one robot's drives may differ, relative; slip makes the closed form's
wheels rough."""

_SAME_DRIVE = 0.5
"""Fraction of the shorter drive's wheel samples that agree in time and angles from which on two are one drive."""
_UNDETERMINED = 0.3
"""Relative standard deviation of a wheel's size from which on an estimate carries no information about the wheels."""


def solve(job: Job, look: FirstLook) -> Calibration:
    """Return the calibration that drives of one robot give after the four steps: by the likelihood, unless it is off.

    Raises
    ------
    CalibError
        If they do not determine it.
    """
    check_drives_differ(job, look.drives)
    check_one_robot(job, look.steps)
    if job.settings.closed_form:
        return closed_form(job.robot, look.drives, look.steps, _origin(job, look), findings=look.findings)
    job = replace(job, target=look.target)
    with _reasons_said(look):
        found, options = estimate_explained(look.drives, look.steps, options_of(job), job.settings.moving)
    return concluded(job, look, found, options)


def solve_stops(job: Job, look: FirstLook) -> ExplainedEstimate:
    """Return the estimate that the stops alone give, with its solution; errors as of :func:`solve`."""
    check_one_robot(job, look.steps)
    with _reasons_said(look):
        if any(drive.on_the_move for drive in look.drives):
            raise CalibError(
                "the box was seen on the move only, several cameras are calibrated together from stops",
                remedy="stop where each camera sees the box, or name one camera",
            )
        return explained_estimate(look.drives, look.steps, options_of(replace(job, target=look.target)))


def concluded(job: Job, look: FirstLook, found: Estimate, options: EstimateOptions) -> Calibration:
    """Return the calibration that an estimate amounts to, looked at once more; errors as of :func:`solve`."""
    settings, drives, steps = job.settings, look.drives, look.steps
    found = replace(found, notes=found.notes + box_notes(look.target, drives))
    _check_told(found, look)
    found = replace(found, findings=(*look.findings, *found.findings, *last_look(look, found)))
    held_out = validate(drives, steps, options, found) if settings.validate else None
    grown = grow(drives[0], steps[0], found, options) if settings.report and len(drives) == 1 else ()
    return refined(job.robot, drives, steps, found, _origin(job, look), validation=held_out, growth=grown)


def _origin(job: Job, look: FirstLook) -> Provenance:
    return provenance(job.command, look.drives, asdict(job.settings), job.fingerprint)


@contextmanager
def _reasons_said(look: FirstLook) -> Iterator[None]:
    """Say with why the likelihood fails what else is known of the drives."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise unsolvable(sum(len(drive.stops) for drive in look.drives)) from error
    except CalibError as error:
        said = _said_with_jumps(_said_with_start(error, look.steps), look.drives)
        raise said_without_stops(said, look.drives) from error


def _said_with_start(error: CalibError, steps: Sequence[FourSteps]) -> CalibError:
    """Return why the likelihood fails, after why the four steps did where they found no answer either."""
    why = _why_replaced(steps)
    if not why:
        return error
    return CalibError(
        f"{why}; the likelihood, started from consecutive stops instead: {error.found}",
        source=error.source,
        needed=error.needed,
        remedy=error.remedy,
    )


def _said_with_jumps(error: CalibError, drives: Sequence[Correspondences]) -> CalibError:
    """Return why the likelihood fails, after how often the wheels' readings jump where no leg can be trusted."""
    jumping = next((f for f in (counter_finding(drive.wheels, WRAPS) for drive in drives) if f is not None), None)
    if jumping is None:
        return error
    return CalibError(f"{jumping.text}: {error.found}", source=error.source, remedy=jumping.remedy)


def _why_replaced(steps: Sequence[FourSteps]) -> str:
    return next((step.replaced for step in steps if step.replaced), "")


def _check_told(found: Estimate, look: FirstLook) -> None:
    """Refuse wheels of no size, and those of which the data say nothing.

    That is where the four steps found no answer before, or where few legs are left of which the wheels' travel is
    known: these fit any wheels.
    """
    why = _why_replaced(look.steps)
    wheels = {"rR": found.rR, "rL": found.rL, "b": found.b}
    known = np.concatenate([drive.legs_covered for drive in look.drives])
    stops = sum(len(drive.stops) for drive in found.drives)
    if min(wheels.values()) <= 0:
        raise _said_with_start(negative_wheels(stops, known), look.steps)
    sigma = max(found.sigma[name] / value for name, value in wheels.items())
    if known.sum() < min(LEGS_FOR_SLIP, len(known)) and not sigma < _UNDETERMINED:
        raise _said_with_start(
            CalibError(
                f"{stops} stops, and the wheels' travel between them is known {known.sum()} times: that determines the "
                f"wheels to {min(sigma, 1e3):.0%} only",
                remedy="add stops",
            ),
            look.steps,
        )
    if why and not sigma < _UNDETERMINED:
        raise CalibError(
            f"{why}; the likelihood, started from consecutive stops instead, determines the wheels to "
            f"{min(sigma, 1e3):.0%} only",
            remedy="check that wheels and pictures are of the same drive, that the box stood still, and drive again",
        )


def options_of(job: Job) -> EstimateOptions:
    """Return the options of the likelihood that a job's settings ask for."""
    settings = job.settings
    return EstimateOptions(
        lens=settings.lens,
        rigid_floor=settings.rigid_floor,
        tilt_sigma=settings.tilt_prior,
        ink_sigma=settings.ink_prior,
        scale_sigma=settings.scale_prior,
        size_sigma=settings.size_prior,
        face_sigma=settings.face_prior,
        bow_sigma=settings.bow_prior,
        encoder_step=settings.encoder_step,
        slip=settings.slip,
        target=job.target,
    )


def check_drives_differ(job: Job, drives: Sequence[Correspondences]) -> None:
    """Refuse a drive that is given twice, whole or in part: counted twice it makes all sigmas too small."""
    for j, drive in enumerate(drives):
        for i, before in enumerate(drives[:j]):
            a, b = before.wheels, drive.wheels
            _, at_a, at_b = np.intersect1d(a.t_ns, b.t_ns, assume_unique=True, return_indices=True)
            same = np.sum((a.phi_R[at_a] == b.phi_R[at_b]) & (a.phi_L[at_a] == b.phi_L[at_b]))
            if same > _SAME_DRIVE * min(len(a), len(b)):
                raise CalibError(
                    f"the same drive as {listed([job.logs[i]])}",
                    source=listed([job.logs[j]]),
                    remedy="give each drive once",
                )


def check_one_robot(job: Job, steps: Sequence[FourSteps]) -> None:
    """Refuse drives of different robots: what the four steps find in each is too far apart for one."""
    for log, step in zip(job.logs[1:], steps[1:], strict=True):
        for what, found, first, limit in (
            ("focal length", step.camera.camera.fu, steps[0].camera.camera.fu, _SAME_FOCAL),
            ("wheel separation", step.mounting.b, steps[0].mounting.b, _SAME_SEPARATION),
        ):
            if abs(found / first - 1) > limit:
                raise CalibError(
                    f"not drives of one robot with one lens setting: {what} {found:.4g}, "
                    f"{listed(job.logs[:1])} has {first:.4g}",
                    source=listed([log]),
                    remedy="leave it out or calibrate each by itself",
                )
