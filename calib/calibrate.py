"""One robot: from what it saw and rolled to its calibration."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps, solve_four_steps
from boxcal.calib.likelihood import CameraKind, EstimateOptions, choose_lens, estimate
from boxcal.calib.results.build import closed_form, refined
from boxcal.calib.results.calibration import Calibration, Provenance
from boxcal.calib.settings import Job
from boxcal.calib.uncertainty.convergence import grow
from boxcal.calib.uncertainty.cross_validation import validate
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256
from boxcal.target.measure.measured_size import SIZES
from boxcal.target.measure.size_influence import scale_influence

_ONE_LENS, _ONE_BASE = 0.03, 0.4
"""How far focal length and wheelbase of one robot's drives may differ; slip makes the closed form's wheels rough."""


def solve(job: Job, drives: list[Correspondences]) -> Calibration:
    """Return the calibration that drives of one robot give: the four steps, then the likelihood.

    Raises
    ------
    CalibError
        If they do not determine it.
    """
    settings = job.settings
    steps = [solve_four_steps(drive, settings.camera_mode) for drive in drives]
    _check_one_robot(job, steps)
    provenance = Provenance(
        version=boxcal_version(),
        command=job.command,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        inputs={
            **{drive.source.log: drive.source.sha256 for drive in drives},
            "target": drives[0].source.target_sha256,
        },
        settings={name: _plain(value) for name, value in asdict(settings).items()},
    )
    if settings.closed_form:
        return closed_form(job.robot, drives, steps, provenance)
    options = EstimateOptions(
        lens=settings.lens or CameraKind.RADIAL,
        tilt_sigma=settings.tilt_prior,
        ink_sigma=settings.ink_prior,
        scale_sigma=settings.scale_prior,
        size_sigma=settings.size_prior,
        face_sigma=settings.face_prior,
        encoder_step=settings.encoder_step,
        slip=settings.slip,
        target=job.target,
    )
    if settings.lens is None:
        choice = choose_lens(drives, steps, options)
        found, options = choice.best, replace(options, lens=choice.best.camera.kind)
        scores = ", ".join(f"{score.lens} {score.bic - choice.scores[0].bic:+.1f}" for score in choice.scores)
        found = replace(found, notes=(*found.notes, f"lens chosen by BIC (difference to the best): {scores}"))
    else:
        found = estimate(drives, steps, options)
    found = replace(found, notes=found.notes + box_notes(job.target))
    held_out = validate(drives, steps, options) if settings.validate else None
    grown = grow(drives[0], steps[0], found, options) if settings.report and len(drives) == 1 else ()
    return refined(job.robot, drives, steps, found, provenance, validation=held_out, growth=grown)


def _plain(value: object) -> object:
    """Return a setting as JSON has it; of a path only its name."""
    return value.name if isinstance(value, Path) else value


def _check_one_robot(job: Job, steps: Sequence[FourSteps]) -> None:
    """Refuse drives of different robots: what the four steps find in each is too far apart for one."""
    for log, step in zip(job.logs[1:], steps[1:], strict=True):
        for what, found, first, limit in (
            ("focal length", step.camera.camera.fu, steps[0].camera.camera.fu, _ONE_LENS),
            ("wheelbase", step.mounting.b, steps[0].mounting.b, _ONE_BASE),
        ):
            if abs(found / first - 1) > limit:
                raise CalibError(
                    f"not drives of one robot with one lens setting: {what} {found:.4g}, "
                    f"{job.logs[0].name} has {first:.4g}",
                    source=log.name,
                    remedy="leave it out or calibrate each by itself",
                )


def box_notes(target: Target) -> tuple[str, ...]:
    """Return what a measured box's own uncertainty adds to every length, and which of its sizes to measure better."""
    if target.measured is None:
        return ()
    cov = target.measured.cov
    influence = scale_influence(target)
    total = float(np.sqrt(influence @ cov @ influence))
    share = np.abs(influence) * np.sqrt(np.diag(cov))
    names = {"sx": "the print across (--tags-x)", "sy": "the print up (--tags-y)"}
    worst = SIZES[int(np.argmax(share))]
    return (
        f"the box's measured size adds {total:.2%} to all lengths (wheels, wheelbase, mounting); measuring "
        f"{names.get(worst, f'its {worst} (--{worst})')} better would help most",
    )


def placed(drive: Correspondences, target: Target) -> Correspondences:
    """Return a drive with its landmarks where the target has them: as measured, say, after the log was read.

    Raises
    ------
    CalibError
        If the drive saw tags that the target does not carry.
    """
    try:
        stops = tuple(replace(stop, p_box=target.p_box(stop.landmark_ids)) for stop in drive.stops)
    except KeyError as error:
        raise CalibError(
            f"tag {error} was seen, the target does not carry it",
            remedy="give the target.json that the log was read with",
        ) from error
    return replace(drive, stops=stops, source=replace(drive.source, target_sha256=target_sha256(target)))


def boxcal_version() -> str:
    """Return the installed version."""
    try:
        return version("boxcal")
    except PackageNotFoundError:
        return "not installed"
