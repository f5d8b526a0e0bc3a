"""The estimate with its explanations: solved, diagnosed, reported."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.diagnosis.camera_doubt import camera_doubt
from boxcal.calib.diagnosis.cause import Cause
from boxcal.calib.diagnosis.choose import Explained, explain
from boxcal.calib.diagnosis.doubts import Doubt
from boxcal.calib.diagnosis.leg_causes import leg_findings
from boxcal.calib.diagnosis.target_causes import target_findings
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.merge import with_moving_frames
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.likelihood.moving.without_stops import from_frames_alone, refuse_unused
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.summary import reported_cov
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_PROBABLE = 0.2
"""From this probability on what a cause may do unseen is in the standard deviations: of less probable ones it would be
most of them, and true of few."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExplainedEstimate:
    """Estimate from the stops with whatever explains its drives.

    Attributes
    ----------
    found
        The estimate, with its findings.
    but_wheels
        The same without what is found and doubted of the wheels, which cameras of one robot determine together.
    wheels
        Causes in the wheels that are part of the solution.
    fit
        The solution that it reports.
    options
        As :func:`estimate_explained` returns them.
    """

    found: Estimate
    but_wheels: Estimate
    wheels: tuple[Cause, ...]
    fit: Fit
    options: EstimateOptions


def estimate_explained(
    drives: Sequence[Correspondences],
    start: Sequence[FourSteps] | FourSteps | None,
    options: EstimateOptions,
    moving: Moving = Moving.OFF,
) -> tuple[Estimate, EstimateOptions]:
    """Return the estimate with whatever explains its drives, and options to solve parts of them alike.

    The options name the camera model that was chosen, and the explanations that hold for any part of the drives: those
    that begin at a stop do not.

    Parameters
    ----------
    drives, start, options
        As for :func:`boxcal.calib.likelihood.estimate`.
    moving
        Whether frames on the move are used.

    Raises
    ------
    CalibError
        If the drives do not determine the calibration: what is missing.
    """
    if drives[0].on_the_move and moving is Moving.OFF:
        refuse_unused()
    explained = explained_estimate(drives, start, options)
    found = explained.found
    if drives[0].on_the_move:
        found = from_frames_alone(found, explained.fit, drives[0])
    elif moving is not Moving.OFF:
        found = with_moving_frames(found, explained.fit, drives, moving)
    return found, explained.options


def explained_estimate(
    drives: Sequence[Correspondences], start: Sequence[FourSteps] | FourSteps | None, options: EstimateOptions
) -> ExplainedEstimate:
    """Return the estimate from the stops alone, with its solution; as :func:`estimate_explained`."""
    first = fit(drives, start, options)
    explained = explain(first)
    solved = replace(explained.fit, camera_scores=first.camera_scores)
    bare = reported(solved, drives, options)
    explained = replace(explained, fit=solved)
    of_camera = camera_doubt(solved) if solved.camera_scores else None
    found = _with_unseen(bare, explained, of_camera)
    of_legs_and_target = (*leg_findings(solved, found, drives), *target_findings(solved), *found.findings)
    pictures = replace(
        explained,
        adopted=tuple(a for a in explained.adopted if a[0].in_pictures),
        doubts=tuple(doubt for doubt in explained.doubts if doubt.cause.in_pictures),
    )
    wheels = tuple(cause for cause, _ in explained.adopted if not cause.in_pictures)
    options = replace(options, lens=found.camera.kind, explanations=(*options.explanations, *wheels))
    return ExplainedEstimate(
        found=replace(found, findings=(*explained.findings, *of_legs_and_target)),
        but_wheels=replace(_with_unseen(bare, pictures, of_camera), findings=(*pictures.findings, *of_legs_and_target)),
        wheels=wheels,
        fit=solved,
        options=options,
    )


def _with_unseen(found: Estimate, explained: Explained, of_camera: Array | None) -> Estimate:
    """Return the estimate with what its explanations and other likely ones may do unseen added to its covariance.

    The former leaves the odometry as good as it is.
    """
    wider = found.cov_all.copy()
    for widening in (*(doubt.widening for doubt in explained.doubts), *(() if of_camera is None else (of_camera,))):
        wider += reported_cov(widening, explained.fit.state, np.zeros(len(widening), dtype=bool))
    odometry = wider.copy()
    causes = probable_causes([cause for cause, _ in explained.adopted], explained.doubts)
    for cause, probability in causes:
        for name, sigma in cause.unseen.items():
            k = found.names.index(name)
            wider[k, k] += probability * sigma**2
    count = len(found.cov)
    unseen = any(cause.unseen for cause, _ in causes)
    return replace(
        found,
        cov=wider[:count, :count],
        cov_all=wider,
        odometry_cov=odometry[:count, :count] if unseen else found.odometry_cov,
    )


def probable_causes(adopted: Sequence[Cause], doubts: Sequence[Doubt]) -> list[tuple[Cause, float]]:
    """Return the causes whose unseen effects count, adopted ones and likely others, and how probable each is."""
    return [(cause, 1.0) for cause in adopted] + [(d.cause, d.probability) for d in doubts if d.probability > _PROBABLE]
