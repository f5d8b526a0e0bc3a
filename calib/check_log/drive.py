"""Findings on what the drive determines: solved quickly, judged as a calibration, with what is missing."""

from collections.abc import Sequence
from dataclasses import replace

from boxcal.calib.assessment.more_stops import calls_for_stops
from boxcal.calib.assessment.verdict import judge
from boxcal.calib.check_log.findings import LogFinding, fine, look, refused, sentence
from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.diagnosis.first_look import FirstLook, first_look
from boxcal.calib.diagnosis.last_look import last_look
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood import Estimate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.planning.floor import Floor
from boxcal.calib.planning.goal import Bar, Goal, bars_of_estimate
from boxcal.calib.planning.next_stops import said, what_next
from boxcal.calib.results.build import refined
from boxcal.calib.results.calibration import Provenance
from boxcal.calib.results.verdict import Kind, Level, Reason
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraKind

_MISFIT_PX = 1.0
"""Reprojection error of the closed form from which on the camera model is looked for."""
_BAR_OF = {
    "straight": "straight",
    "heading": "heading",
    "turn": "turn",
    "camera-angle": "camera",
    "camera-place": "place",
}
"""Bars that say the same as a rule."""


def drive_findings(
    drive: Correspondences, target: Target, goal: Goal | None = None, floor: Floor | None = None
) -> list[LogFinding]:
    """Return what a drive determines already and what is missing, and what is wrong with it.

    Parameters
    ----------
    drive, target
        What was seen and rolled so far, and the box.
    goal, floor
        What is wanted, and where the robot may drive, for the next stops.
    """
    goal = goal or Goal()
    try:
        at = first_look([drive], target)
        found = _solved(at)
    except CalibError as error:
        return [refused("drive", error)]
    origin = Provenance(version="", command="check-log", created="")
    calibration = refined(drive.robot, at.drives, at.steps, found, origin)
    reasons = judge(calibration, list(at.drives), at.target, compute_stops=False).reasons
    findings = [
        _of_reason(r) for r in reasons if (r.level is not Level.GOOD or r.kind is Kind.NOTE) and r.rule not in _BAR_OF
    ]
    useless = {_BAR_OF[r.rule] for r in reasons if r.level is Level.REDO and r.rule in _BAR_OF}
    bars = bars_of_estimate(found, goal, drive.image_size)
    findings += [fine("known", f"{bar.label}: {said(bar)}.") for bar in bars if bar.reached]
    short = [bar for bar in bars if not bar.reached]
    findings += [_missing(bar, useless=bar.name in useless) for bar in short]
    if short or calls_for_stops(reasons):
        findings += _next(found, at.drives, at.target, goal, floor)
    return findings


def _solved(at: FirstLook) -> Estimate:
    """Return the estimate with its explanations; Brown's camera model unless the closed form fits badly."""
    rms = max(step.camera.rms_px for step in at.steps)
    lens = CameraKind.BROWN if rms < _MISFIT_PX else None
    found, _ = estimate_explained(at.drives, at.steps, EstimateOptions(lens=lens, target=at.target))
    return replace(found, findings=(*at.findings, *found.findings, *last_look(at, found)))


def _missing(bar: Bar, *, useless: bool) -> LogFinding:
    """Return a goal that is not reached; it is wrong where the verdict calls the drive useless for it."""
    text = f"{bar.label}: {said(bar)}, {said(replace(bar, value=bar.goal))} is wanted."
    return LogFinding(level=Level.REDO if useless else Level.USABLE, topic="missing", text=text)


def _of_reason(reason: Reason) -> LogFinding:
    """Return a reason of the verdict as a finding: what was taken into account still deserves a look in the field."""
    caused = reason.kind is Kind.NOTE and reason.rule != "ruler"
    level = Level.USABLE if caused else reason.level
    return LogFinding(level=level, topic="drive", text=reason.text, advice=reason.advice)


def _next(
    found: Estimate, drives: Sequence[Correspondences], target: Target, goal: Goal, floor: Floor | None
) -> list[LogFinding]:
    try:
        stops = what_next(found, drives, target, goal=goal, floor=floor, count=2)
    except CalibError as error:
        return [look("missing", sentence(error.found), sentence(error.remedy))]
    return [look("missing", stop.text) for stop in stops]
