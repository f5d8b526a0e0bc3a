"""Verdict on a calibration with reasons and next steps, in words that need no mathematics.

Each rule judges one thing against two limits, derived in docs/report.md from what matters on the ground. The verdict is
the worst that any rule says.
"""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.assessment.causes import arrange
from boxcal.calib.assessment.drive_rules import DRIVE_RULES, direction_unchecked
from boxcal.calib.assessment.estimate_rules import DETAIL_RULES
from boxcal.calib.assessment.findings import finding_reason
from boxcal.calib.assessment.limits import LIMITS, graded, percent
from boxcal.calib.assessment.more_stops import advised, calls_for_stops, more_stops
from boxcal.calib.assessment.print_scale import PrintScale, find_print_scale
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Detail
from boxcal.calib.results.stop_residuals import SeenStop, stops_seen
from boxcal.calib.results.verdict import Kind, Level, Reason, Verdict
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target

_HEADLINES = {
    Level.GOOD: "Put it on the robot.",
    Level.USABLE: "It works, but not as well as it could. Read the reasons before you rely on it.",
    Level.REDO: "Do not put it on the robot.",
}
_RULER = 5e-4
"""What the print leaves open in all lengths is noted from here on: half of what a careful user's print has."""
_KEEP = "Put it on the robot. Calibrate again after a new tyre, a knock on the camera or a change of its focus."


Drives = Correspondences | Sequence[Correspondences]
"""One drive, or all that were solved together, in their order."""


def judge(calibration: Calibration, drives: Drives, target: Target, *, compute_stops: bool = True) -> Verdict:
    """Return whether a calibration can be used, with what the corners of its drives say about the print.

    Parameters
    ----------
    calibration
        Of one robot.
    drives
        What it was made from.
    target
        The landmark table that it was made with.
    compute_stops
        Whether advice on the next stops is computed where more of them help; else the rules' own advice stands.
    """
    all_drives = (drives,) if isinstance(drives, Correspondences) else tuple(drives)
    seen = stops_seen(calibration, all_drives, target)
    scale = find_print_scale(calibration, seen, target)
    known = scale is not None or target.measured is not None
    unchecked = () if known else (_print_unchecked(seen),)
    if not any(drive.source.nominal_T_base_cam for drive in all_drives):
        unchecked = (*unchecked, *direction_unchecked(calibration))
    found = verdict(calibration, scale, unchecked=unchecked)
    if not (compute_stops and calls_for_stops(found.reasons)):
        return found
    return verdict(calibration, scale, unchecked=unchecked, more_stops=more_stops(calibration, all_drives, target))


def verdict(
    calibration: Calibration,
    print_scale: PrintScale | None = None,
    *,
    unchecked: Sequence[Reason] = (),
    more_stops: str = "",
) -> Verdict:
    """Return whether a calibration can be used, why, and what to do next.

    Parameters
    ----------
    calibration
        Of one robot.
    print_scale
        What the corners say about the print (:func:`boxcal.calib.assessment.print_scale.find_print_scale`), where that
        was asked.
    unchecked
        What could not be checked, and why.
    more_stops
        Advice on the next stops, computed from the drives; without it the rules' own advice stands.
    """
    found = [reason for rule in DRIVE_RULES for reason in rule(calibration)]
    detail = calibration.detail
    if detail is None:
        found.append(_uncertainty(calibration))
    else:
        found += [reason for rule in DETAIL_RULES for reason in rule(calibration, detail)]
    found += [finding_reason(finding) for finding in calibration.findings]
    found += _ruler(detail)
    no_size = any(reason.rule == "print" for reason in unchecked)
    found += [reason for reason in _print(detail, print_scale) if reason.kind is not Kind.CHECK or not no_size]
    reasons = arrange([*advised(found, more_stops), *unchecked])
    level = max((r.level for r in reasons), key=lambda level: level.rank)
    steps = dict.fromkeys(r.advice for r in reasons if r.advice and not r.because)
    return Verdict(level=level, headline=_HEADLINES[level], reasons=reasons, next_steps=tuple(steps) or (_KEEP,))


def _uncertainty(c: Calibration) -> Reason:
    text = (
        "This is the closed form alone: nothing says how certain its values are, "
        f"and corners differ by {c.quality.reprojection_rms_px:.2f} px from where it expects them."
    )
    return Reason(
        rule="uncertainty", level=Level.USABLE, text=text, advice="Calibrate the same log with maximum likelihood."
    )


def _ruler(detail: Detail | None) -> list[Reason]:
    """Return how certain all lengths are by the print alone, where that matters."""
    if detail is None or detail.scale_sigma is None or detail.scale_sigma < _RULER:
        return []
    text = (
        f"All lengths are as certain as the print's own size: {detail.scale_sigma:.2%}, on top of their sigmas; "
        "measure-target makes it less."
    )
    return [Reason(rule="ruler", level=Level.GOOD, text=text, kind=Kind.NOTE)]


def _print_unchecked(seen: Sequence[SeenStop]) -> Reason:
    """Return why the corners do not determine the print's size, even if it was solved for with a prior."""
    alone = not any(len(np.unique(stop.face[stop.used])) > 1 for stop in seen)
    why = "each stop sees one face of the box only" if alone else "the corners leave it open by more than 0.3 %"
    text = f"The print's size could not be checked: {why}; check its 100 mm bars with a ruler."
    return Reason(rule="print", level=Level.GOOD, text=text, kind=Kind.UNCHECKED)


def _print(detail: Detail | None, found: PrintScale | None) -> list[Reason]:
    if detail is not None and {"scale_x", "scale_y"} <= detail.extra.keys():
        x, y = detail.extra["scale_x"], detail.extra["scale_y"]
        sigma_x, sigma_y = detail.extra_sigma["scale_x"], detail.extra_sigma["scale_y"]
        estimated = True
    elif found is not None:
        x, y, sigma_x, sigma_y = found.x, found.y, found.sigma_x, found.sigma_y
        estimated = False
    else:
        return []
    significant = [abs(v) for v, s in ((x, sigma_x), (y, sigma_y)) if abs(v) > 5 * s]
    worst = max(significant, default=0.0)
    if worst <= LIMITS["print"].good:
        return graded("print", worst, "The print has the size that it was designed with.", "")
    text = f"The print is not of the size designed: {percent(x)} across and {percent(y)} up the sheet."
    if estimated:
        text = f"{text} The calibration takes it into account."
        return [Reason(rule="print", level=Level.GOOD, text=text, kind=Kind.NOTE), *_box_or_print(x, y)]
    return graded(
        "print",
        worst,
        text,
        "Measure the print with a ruler (measure-target) and calibrate the same log again; no new drive is needed. "
        "Next time print at 100 %.",
    )


def _box_or_print(x: float, y: float) -> list[Reason]:
    """Return what scales of the print that are alike leave open: the box may be of another size instead."""
    alike = min(abs(x), abs(y)) if x * y > 0 else 0.0
    if alike <= LIMITS["print"].usable:
        return []
    box = percent(1 / (1 + 0.5 * (x + y)) - 1)
    text = f"Instead of the print the box may be of another size ({box}): pictures show only one against the other, "
    return [
        Reason(
            rule="box-size",
            level=Level.USABLE,
            text=f"{text}and all lengths hang on it.",
            advice="Measure the box and its print with a ruler (measure-target) and calibrate the same log again; "
            "no new drive is needed.",
        )
    ]
