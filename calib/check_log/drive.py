"""Findings on what the drive determines: solved quickly, judged as a calibration, with what is missing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from boxcal.calib.assessment.verdict import judge
from boxcal.calib.check_log.findings import Grade, LogFinding, look, wrong
from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.diagnosis.first_look import FirstLook, first_look
from boxcal.calib.diagnosis.last_look import last_look
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood import Estimate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.planning.floor import Floor
from boxcal.calib.planning.goal import Goal, bars_of_estimate
from boxcal.calib.planning.next_stops import said, what_next
from boxcal.calib.results.build import refined
from boxcal.calib.results.calibration import Provenance
from boxcal.calib.results.verdict import Kind, Level, Reason
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraKind

_GRADE = {Level.GOOD: Grade.FINE, Level.USABLE: Grade.LOOK, Level.REDO: Grade.WRONG}
_MISFIT_PX = 1.0
"""Reprojection error of the closed form from which on the camera model is looked for."""
_SAID_BY_BARS = ("straight", "heading", "turn", "camera-angle", "camera-place")
"""Rules on the same figures as the bars."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """Findings of a drive, and whether they call for more stops.

    Attributes
    ----------
    findings
        One a line.
    solved
        Whether the drive determines a calibration at all.
    """

    findings: tuple[LogFinding, ...]
    solved: bool


def drive_findings(
    drive: Correspondences, target: Target, goal: Goal | None = None, floor: Floor | None = None
) -> Look:
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
        return Look(findings=(wrong("drive", _sentence(error.found), _sentence(error.remedy or "")),), solved=False)
    origin = Provenance(version="", command="check-log", created="")
    calibration = refined(drive.robot, at.drives, at.steps, found, origin)
    verdict = judge(calibration, list(at.drives), at.target)
    reasons = [
        _of_reason(r)
        for r in verdict.reasons
        if (r.level is not Level.GOOD or r.kind is Kind.NOTE) and r.rule not in _SAID_BY_BARS
    ]
    bars = bars_of_estimate(found, goal, drive.image_size)
    findings = [
        LogFinding(grade=Grade.FINE, topic="known", text=f"{bar.label}: {said(bar)}.") for bar in bars if bar.reached
    ]
    short = [bar for bar in bars if not bar.reached]
    findings += [
        look("missing", f"{bar.label}: {said(bar)}, {said(replace(bar, value=bar.goal))} is wanted.") for bar in short
    ]
    if short:
        findings += _next(found, at.drives, at.target, goal, floor)
    return Look(findings=(*reasons, *findings), solved=True)


def _solved(at: FirstLook) -> Estimate:
    """Return the estimate with its explanations; Brown's camera model unless the closed form fits badly."""
    rms = max(step.camera.rms_px for step in at.steps)
    lens = CameraKind.BROWN if rms < _MISFIT_PX else None
    found, _ = estimate_explained(at.drives, at.steps, EstimateOptions(lens=lens, target=at.target))
    return replace(found, findings=(*at.findings, *found.findings, *last_look(at, found)))


def _of_reason(reason: Reason) -> LogFinding:
    """Return a reason of the verdict as a finding: what was taken into account is still worth a look in the field."""
    caused = reason.kind is Kind.NOTE and reason.rule != "ruler"
    grade = Grade.LOOK if caused else _GRADE[reason.level]
    return LogFinding(grade=grade, topic="drive", text=reason.text, advice=reason.advice)


def _next(
    found: Estimate, drives: Sequence[Correspondences], target: Target, goal: Goal, floor: Floor | None
) -> list[LogFinding]:
    try:
        stops = what_next(found, drives, target, goal=goal, floor=floor, count=2)
    except CalibError as error:
        return [look("missing", _sentence(error.found), _sentence(error.remedy or ""))]
    return [look("missing", stop.text) for stop in stops]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if not text or text.endswith(".") else ".")
