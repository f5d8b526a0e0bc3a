"""The four steps with a look at what is decided before any likelihood: the box as it stands, signs and clocks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from boxcal.calib.diagnosis.clock import clock_finding, find_offset, moving_pictures
from boxcal.calib.diagnosis.corner_order import with_corners_in_order
from boxcal.calib.diagnosis.counters import counter_finding
from boxcal.calib.diagnosis.frozen import without_frozen
from boxcal.calib.diagnosis.layout import other_layout
from boxcal.calib.diagnosis.losses import loss_findings
from boxcal.calib.diagnosis.odd_corners import said_with_odd_corners, without_odd_corners
from boxcal.calib.diagnosis.odd_prints import with_odd_prints
from boxcal.calib.diagnosis.scrambled_stops import ALIKE, without_scrambled
from boxcal.calib.diagnosis.sheets import Gluing, find_gluing
from boxcal.calib.diagnosis.sheets_by_wheels import gluing_by_wheels
from boxcal.calib.diagnosis.silent_wheels import refuse_silent_wheels
from boxcal.calib.diagnosis.standing import Standing, how_it_stands, side_finding
from boxcal.calib.diagnosis.turned_pictures import (
    Turned,
    find_turned,
    refuse_turned,
    said_with_turned,
    turned_stops,
    without_turned,
)
from boxcal.calib.diagnosis.wheel_signs import LEAST_STOPS, Explained, agree, explain_signs, places
from boxcal.calib.diagnosis.without_stops import said_without_stops, with_frames_for_stops
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.procedure import FourSteps, solve_motion
from boxcal.calib.four_steps.step1_camera import CameraStep, calibrate_camera
from boxcal.calib.geometry.diff_drive import legs_between
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.robust_steps import robust_steps
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.stops import MIN_STOPS
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.target.box import FACES, Target

LAYOUT_RMS_PX = 1.0
"""Reprojection errors of step 1 (root mean square) from which on the prints' layout is looked at."""
_UPSIDE_DOWN = Gluing(face=(0, 3, 2, 1), turned=(True,) * FACES)
"""A box upside down is a box upright whose sheets run round it in reverse order, each upside down."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FirstLook:
    """Drives ready for the likelihood.

    Attributes
    ----------
    drives, target
        With the landmarks where they are.
    steps
        The four steps of each drive.
    findings
        What was found and taken into account.
    """

    drives: tuple[Correspondences, ...]
    target: Target
    steps: tuple[FourSteps, ...]
    findings: tuple[Finding, ...]


_NO_WHEELS = "rotations by the images and by the wheels fit no wheels that roll forward"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Relaid:
    """Landmarks elsewhere than described, with which the four steps work, and what is said of that."""

    gluing: Gluing
    finding: Finding


def first_look(drives: Sequence[Correspondences], target: Target, mode: CameraMode = CameraMode.JOINT) -> FirstLook:
    """Return the four steps of each drive, with sheets and box as they are glued and stand.

    Raises
    ------
    CalibError
        If the drives do not determine the calibration: the cause, where one explains that.
    """
    findings = list(loss_findings(drives))
    ordered = [with_corners_in_order(drive) for drive in drives]
    findings += [finding for _, found in ordered for finding in found]
    drives = [drive for drive, _ in ordered]
    drives, without_stops = with_frames_for_stops(drives)
    drives, odd = without_odd_corners(drives, ALIKE)
    findings += [*without_stops, *odd]
    try:
        look = _looked(drives, target, mode, findings)
    except CalibError as error:
        other = _without_odd(drives, target, mode, findings)
        if other is not None:
            return other
        turned = [find_turned(drive, mode) for drive in drives]
        other = _without_turned(drives, turned, target, mode, findings)
        if other is not None:
            return other
        said = said_with_odd_corners(said_without_stops(error, drives), findings)
        raise said_with_turned(said, drives, turned) from error
    turned = [turned_stops(steps.camera) for steps in look.steps]
    if not any(found.stops for found in turned):
        return look
    other = _without_turned(look.drives, turned, look.target, mode, look.findings)
    if other is None:
        refuse_turned(look.drives, turned)
    return other or look


def _without_odd(
    drives: Sequence[Correspondences], target: Target, mode: CameraMode, findings: list[Finding]
) -> FirstLook | None:
    """Return the look at drives without corners that are odd in any stop; None if there are none, or it does not do."""
    sound, odd = without_odd_corners(drives)
    try:
        return _looked(sound, target, mode, [*findings, *odd]) if odd else None
    except CalibError:
        return None


def _without_turned(
    drives: Sequence[Correspondences],
    turned: Sequence[Turned],
    target: Target,
    mode: CameraMode,
    findings: Sequence[Finding],
) -> FirstLook | None:
    """Return the look at drives without images that were turned; None if none were, or it does not do."""
    sound, said = without_turned(drives, turned)
    try:
        return _looked(sound, target, mode, [*findings, *said]) if said else None
    except CalibError:
        return None


def _looked(
    drives: Sequence[Correspondences], target: Target, mode: CameraMode, findings: Sequence[Finding]
) -> FirstLook:
    """Return the four steps of drives that have stops, and all findings, those from before first."""
    findings = list(findings)
    thawed = [without_frozen(drive) for drive in drives]
    unscrambled = [without_scrambled(drive) for drive, _ in thawed]
    drives = [drive for drive, _ in unscrambled]
    findings += [finding for _, finding in (*thawed, *unscrambled) if finding is not None]
    odd = with_odd_prints(drives, target)
    if odd is not None:
        target = odd[0]
        drives = [_placed(drive, target) for drive in drives]
        findings.append(odd[1])
    stops = [stop for drive in drives for stop in drive.stops]
    gluing = find_gluing(stops, drives[0].image_size, target)
    if gluing is not None and not gluing.as_described:
        target = gluing.target(target)
        drives = [_placed(drive, target) for drive in drives]
        findings.append(gluing.finding())
    steps = []
    for drive in drives:
        found = _steps(drive, target, mode)
        if isinstance(found, _Relaid):
            return _relaid(drives, target, mode, found, findings)
        steps.append(found)
    return FirstLook(drives=tuple(drives), target=target, steps=tuple(steps), findings=tuple(findings))


def _relaid(
    drives: Sequence[Correspondences], target: Target, mode: CameraMode, why: _Relaid, findings: list[Finding]
) -> FirstLook:
    """Return the look at a box whose landmarks are elsewhere than described, with them where they are."""
    target = why.gluing.target(target)
    drives = [_placed(drive, target) for drive in drives]
    steps = []
    for drive in drives:
        found = _steps(drive, target, mode)
        if isinstance(found, _Relaid):
            raise CalibError(
                f"{why.finding.text.partition(':')[0]} in some of the drives and not in others",
                remedy="calibrate them apart",
            )
        steps.append(found)
    return FirstLook(drives=tuple(drives), target=target, steps=tuple(steps), findings=(*findings, why.finding))


def _placed(drive: Correspondences, target: Target) -> Correspondences:
    return replace(
        drive,
        stops=tuple(_on_it(stop, target) for stop in drive.stops),
        moving=tuple(_on_it(frame, target) for frame in drive.moving),
    )


_Seen = TypeVar("_Seen", StopObservation, MovingFrame)


def _on_it(seen: _Seen, target: Target) -> _Seen:
    """Return landmarks where a target has them."""
    rows = np.array([target.row_of(int(i) // 4) for i in seen.landmark_ids], dtype=np.int64)
    return replace(seen, p_box=target.p_box(seen.landmark_ids), faces=target.tag_faces[rows])


def _steps(drive: Correspondences, target: Target, mode: CameraMode) -> FourSteps | _Relaid:
    """Return the four steps of a drive, or where its landmarks are instead of where they should be."""
    if len(drive.stops) < MIN_STOPS:
        raise _too_few(drive)
    camera = calibrate_camera(drive.stops, drive.image_size, mode)
    if len(camera.kept) < MIN_STOPS:
        raise CalibError(
            f"{len(camera.kept)} of {len(drive.stops)} stops can be used",
            needed=f"at least {MIN_STOPS} are needed ({'; '.join(camera.notes)})",
        )
    if how_it_stands(camera.T_cam_box) is Standing.ON_SIDE:
        raise _error(side_finding(camera.T_cam_box, target))
    legs = legs_between(drive, camera.kept)
    refuse_silent_wheels(legs)
    try:
        steps = solve_motion(camera, legs)
        return steps if agree(steps) else _sheets_elsewhere(drive, target, mode, steps) or steps
    except CalibError as error:
        cause = _cause(drive, camera, target, mode)
        if isinstance(cause, _Relaid):
            return cause
        if cause is not None:
            raise cause from error
        return _from_consecutive_stops(drive, camera, error)


def _too_few(drive: Correspondences) -> CalibError:
    """Return the error that says that there are too few stops.

    Where images of those that are left move while the wheels stand, it speaks of the clocks: under a wrong time most
    frames fall into the robot's motion, and stops without a still frame are lost.
    """
    count = len(drive.stops)
    moving = clock_finding(None, moving_pictures(drive), count)
    if moving is None:
        return CalibError(f"{count} usable stops", needed=f"at least {MIN_STOPS} are needed", remedy="add stops")
    return CalibError(
        f"{count} usable stops, and {moving.text}",
        needed=f"at least {MIN_STOPS} are needed",
        remedy=moving.remedy,
    )


def _from_consecutive_stops(drive: Correspondences, camera: CameraStep, error: CalibError) -> FourSteps:
    """Return the four steps from consecutive stops alone, where they fail over all pairs of stops."""
    signs = "swapped" in error.found or "reversed" in error.found
    if len(camera.kept) < LEAST_STOPS:
        raise _no_wheels(camera, "") if signs else error
    try:
        steps = robust_steps(drive, camera, _NO_WHEELS if signs else error.found)
    except CalibError as other:
        tried = f"; consecutive stops alone were tried too: {other.found}"
        if signs:
            raise _no_wheels(camera, tried) from error
        if other.found == error.found:
            raise error from None
        raise CalibError(
            f"{error.found}{tried}", source=error.source, needed=error.needed, remedy=error.remedy
        ) from error
    if places(camera) < LEAST_STOPS:  # some wheels fit whatever is wrong
        raise _no_wheels(camera, "") if signs else error
    return steps


def _cause(drive: Correspondences, camera: CameraStep, target: Target, mode: CameraMode) -> _Relaid | CalibError | None:
    """Return why the steps fail, as an error; or where the landmarks are instead."""
    explained = explain_signs(camera, legs_between(drive, camera.kept), target)
    if explained is not None and explained.key == "box-upside-down":
        return _Relaid(gluing=_UPSIDE_DOWN, finding=_turned_over(explained))
    if explained is not None:
        return CalibError(
            f"{explained.text}: {explained.quality}, as recorded they fit no wheels that roll forward",
            remedy=explained.advice,
        )
    elsewhere = _sheets_elsewhere(drive, target, mode)
    if elsewhere is not None:
        return elsewhere
    causes = (
        other_layout(drive.stops, target) if camera.rms_px > LAYOUT_RMS_PX else None,
        counter_finding(drive.wheels),
        clock_finding(find_offset(drive, camera), moving_pictures(drive), len(drive.stops)),
    )
    named = next((cause for cause in causes if cause is not None), None)
    return None if named is None else _error(named)


def _no_wheels(camera: CameraStep, tried: str) -> CalibError:
    """Return that no wheels fit, where nothing explains that."""
    text, apart = _NO_WHEELS, places(camera)
    if apart < LEAST_STOPS:
        stops = len(camera.kept)
        return CalibError(
            f"{text}, and {f'{stops} stops' if apart == stops else f'{apart} places'} are too few to tell why "
            f"({'; '.join(camera.notes) or 'exchanged or reversed wheels, slip, a box moved'}){tried}",
            needed=f"at least {LEAST_STOPS} are needed",
            remedy="add stops, and check which joint is left and which right",
        )
    return CalibError(
        f"{text}: neither exchanged nor reversed wheels, nor a box upside down, nor sheets exchanged, nor another "
        f"stamp of the pictures explains it (strong slip, a robot lifted, or a box moved){tried}",
        remedy="drive slower, on a dry floor, and fasten the box",
    )


def _sheets_elsewhere(
    drive: Correspondences, target: Target, mode: CameraMode, described: FourSteps | None = None
) -> _Relaid | None:
    """Return sheets exchanged or upside down if wheels and images agree with them; as described they do not."""
    elsewhere = gluing_by_wheels(drive, target, mode, _placed, described)
    if elsewhere is None:
        return None
    gluing, fit = elsewhere
    return _Relaid(gluing=gluing, finding=gluing.finding(f"{fit}, as described they fit no usual wheels"))


def _turned_over(why: Explained) -> Finding:
    return Finding(
        cause=why.key,
        text=f"{why.text}: {why.quality}, as described they fit no wheels that roll forward; the landmarks were taken "
        "where they are",
        advice=why.advice,
        adopted=True,
    )


def _error(finding: Finding) -> CalibError:
    return CalibError(finding.text, remedy=finding.remedy)
