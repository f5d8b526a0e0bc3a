"""The four steps with a look at what is decided before any likelihood: the box as it stands, signs and clocks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.diagnosis.clock import clock_finding, find_offset, moving_pictures
from boxcal.calib.diagnosis.layout import other_layout
from boxcal.calib.diagnosis.sheets import Gluing, find_gluing
from boxcal.calib.diagnosis.standing import Standing, how_it_stands, side_finding
from boxcal.calib.diagnosis.wheel_signs import LEAST_STOPS, Explained, explain_signs
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import MIN_STOPS, FourSteps, solve_motion
from boxcal.calib.four_steps.step1_camera import CameraMode, CameraStep, calibrate_camera
from boxcal.calib.geometry.diff_drive import legs_between
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import FACES, Target

LAYOUT_RMS_PX = 1.0
"""Reprojection errors of step 1 (root mean square) from which on the prints' layout is looked at."""
_UPSIDE_DOWN = Gluing(face=(0, 3, 2, 1), turned=(True,) * FACES, misfit_deg=0.0, described_deg=0.0, views=0)
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


def first_look(drives: Sequence[Correspondences], target: Target, mode: CameraMode = CameraMode.JOINT) -> FirstLook:
    """Return the four steps of each drive, with sheets and box as they are glued and stand.

    Raises
    ------
    CalibError
        If the drives do not determine the calibration: the cause, where one explains that.
    """
    findings: list[Finding] = []
    stops = [stop for drive in drives for stop in drive.stops]
    gluing = find_gluing(stops, drives[0].image_size, target)
    if gluing is not None and not gluing.as_described:
        target = gluing.target(target)
        drives = [_placed(drive, target) for drive in drives]
        findings.append(gluing.finding())
    steps = []
    for drive in drives:
        found = _steps(drive, target, mode)
        if isinstance(found, Explained):
            return _turned_over(drives, target, mode, found, findings)
        steps.append(found)
    return FirstLook(drives=tuple(drives), target=target, steps=tuple(steps), findings=tuple(findings))


def _turned_over(
    drives: Sequence[Correspondences], target: Target, mode: CameraMode, why: Explained, findings: list[Finding]
) -> FirstLook:
    """Return the look at a box upside down, its landmarks where they are."""
    target = _UPSIDE_DOWN.target(target)
    drives = [_placed(drive, target) for drive in drives]
    steps = []
    for drive in drives:
        found = _steps(drive, target, mode)
        if isinstance(found, Explained):
            raise CalibError(
                "the box stands upside down in some of the drives and upright in others",
                remedy="calibrate them apart",
            )
        steps.append(found)
    finding = Finding(
        cause=why.key,
        text=f"{why.text}: {why.figures}, as described they fit no wheels that roll forward; the landmarks were taken "
        "where they are",
        advice=why.advice,
        adopted=True,
    )
    return FirstLook(drives=tuple(drives), target=target, steps=tuple(steps), findings=(*findings, finding))


def _placed(drive: Correspondences, target: Target) -> Correspondences:
    stops = []
    for stop in drive.stops:
        rows = np.array([target.row_of(int(i) // 4) for i in stop.landmark_ids], dtype=np.int64)
        stops.append(replace(stop, p_box=target.p_box(stop.landmark_ids), faces=target.tag_faces[rows]))
    return replace(drive, stops=tuple(stops))


def _steps(drive: Correspondences, target: Target, mode: CameraMode) -> FourSteps | Explained:
    """Return the four steps of a drive, or that its box stands upside down."""
    if len(drive.stops) < MIN_STOPS:
        raise CalibError(
            f"{len(drive.stops)} usable stops", needed=f"at least {MIN_STOPS} are needed", remedy="add stops"
        )
    camera = calibrate_camera(drive.stops, drive.image_size, mode)
    if len(camera.kept) < MIN_STOPS:
        raise CalibError(
            f"{len(camera.kept)} of {len(drive.stops)} stops can be used",
            needed=f"at least {MIN_STOPS} are needed ({'; '.join(camera.notes)})",
        )
    if how_it_stands(camera.T_cam_box) is Standing.ON_SIDE:
        raise _error(side_finding(camera.T_cam_box, target))
    try:
        return solve_motion(camera, legs_between(drive, camera.kept))
    except CalibError as error:
        cause = _cause(error, drive, camera, target)
        if isinstance(cause, Explained):
            return cause
        if cause is not None:
            raise cause from error
        raise


def _cause(
    error: CalibError, drive: Correspondences, camera: CameraStep, target: Target
) -> Explained | CalibError | None:
    """Return why the steps fail, as an error; or that the box stands upside down."""
    explained = explain_signs(camera, legs_between(drive, camera.kept), target)
    if explained is not None and explained.key == "box-upside-down":
        return explained
    if explained is not None:
        return CalibError(
            f"{explained.text}: {explained.figures}, as recorded they fit no wheels that roll forward",
            remedy=explained.advice,
        )
    if camera.rms_px > LAYOUT_RMS_PX:
        layout = other_layout(drive.stops, target)
        if layout is not None:
            return _error(layout)
    clock = clock_finding(find_offset(drive, camera), moving_pictures(drive), len(drive.stops))
    if clock is not None:
        return _error(clock)
    if len(camera.kept) >= LEAST_STOPS and ("swapped" in str(error) or "reversed" in str(error)):
        return CalibError(
            "turns seen and turns rolled fit no wheels that roll forward: neither exchanged nor reversed wheels, nor a "
            "box upside down, nor another stamp of the pictures explains it (strong slip, a robot lifted, or a box "
            "moved)",
            remedy="drive slower, on a dry floor, and fasten the box",
        )
    return None


def _error(finding: Finding) -> CalibError:
    advice = finding.advice[:1].lower() + finding.advice[1:].rstrip(".")
    return CalibError(finding.text, remedy=advice)
