"""Drives of a robot that stood still at too few places: frames taken on the move stand for its stops."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.diagnosis.clock import FITS_DEG, turns_misfit
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.step1_camera import MIN_LANDMARKS, calibrate_camera
from boxcal.calib.four_steps.step3_axis import find_axis
from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.moving.weave import weave
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS
from boxcal.detect.tags.on_the_move import LEAST_WITHOUT_STOPS, TOO_FEW_PLACES
from boxcal.target.arrays import Array

LONGEST_S = 0.4
"""Clock offsets up to this are looked for."""
_COARSE_S, _FINE_S = 0.02, 0.001
_MOST_FRAMES = 200
"""Of more frames, so many are used, spread over the drive."""
_NEAR = 2
"""Turns are compared between frames so many apart at most: over more, slip adds up."""
_STAND = (
    "Let the robot stand still for two seconds in three places or more where it sees the box: stops need no clock, and "
    "tell what frames on the move leave open"
)
_REMEDY = _STAND[:1].lower() + _STAND[1:]


def with_frames_for_stops(drives: Sequence[Correspondences]) -> tuple[list[Correspondences], list[Finding]]:
    """Return drives in which frames on the move stand for stops where too few were made, and what is said.

    Raises
    ------
    CalibError
        If there are too few frames, or turns seen and rolled agree at no clock offset.
    """
    out, findings = [], []
    for drive in drives:
        without = len(drive.stops) < MIN_STOPS and bool(drive.moving)
        if len(drives) > 1 and (without or drive.on_the_move):
            raise CalibError(TOO_FEW_PLACES, source=drive.robot, remedy="calibrate this drive by itself")
        if without:
            out.append(_frames_for_stops(drive))
        else:
            out.append(drive)
        if out[-1].on_the_move:
            findings.append(_finding(out[-1]))
    return out, findings


def said_without_stops(error: CalibError, drives: Sequence[Correspondences]) -> CalibError:
    """Return why a drive cannot be calibrated, after that its robot stood still at too few places where that is so."""
    if not any(drive.on_the_move for drive in drives) or TOO_FEW_PLACES in error.found:
        return error
    return CalibError(
        f"{TOO_FEW_PLACES}, and from its frames on the move alone: {error.found}",
        source=error.source,
        needed=error.needed,
        remedy=_REMEDY,
    )


def _finding(drive: Correspondences) -> Finding:
    """Return that a result hangs on frames on the move: solved for as well as can be, and never good."""
    return Finding(
        cause="no-stops",
        text=f"{TOO_FEW_PLACES}: {len(drive.stops)} frames taken on the move stand for stops, and "
        "what clocks and shutter do to them is told by themselves alone",
        advice=f"{_STAND}.",
    )


def _frames_for_stops(drive: Correspondences) -> Correspondences:
    """Return a drive whose stops are its frames on the move, at times on the wheels' clock."""
    frames = tuple(frame for frame in drive.moving if len(frame.landmark_ids) >= MIN_LANDMARKS)
    if len(frames) < LEAST_WITHOUT_STOPS:
        raise CalibError(
            f"{len(drive.stops)} usable stops, and {len(frames)} frames on the move that show the box",
            needed=f"{MIN_STOPS} stops, or {LEAST_WITHOUT_STOPS} such frames, are needed",
            remedy=_REMEDY,
        )
    rows = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _MOST_FRAMES)).round().astype(int))
    alone = replace(drive, stops=(), moving=tuple(frames[k] for k in rows))
    late_s = _clock_offset(alone)
    woven = weave(alone, np.zeros(0, dtype=np.int64), np.arange(len(rows)), late_s).drives[0]
    source = replace(drive.source, clock_offset=drive.source.clock_offset + late_s)
    return replace(woven, on_the_move=True, source=source)


def _clock_offset(drive: Correspondences) -> float:
    """Return the stamps of frames less the times at which they were taken, s, by turns seen and rolled."""
    stops = weave(drive, np.zeros(0, dtype=np.int64), np.arange(len(drive.moving)), 0.0).drives[0].stops
    camera = calibrate_camera(stops, drive.image_size)
    theta = find_axis(camera.T_cam_box).theta
    i, j = np.triu_indices(len(theta), 1)
    near = j - i <= _NEAR
    i, j = i[near], j[near]
    turn = wrap(-theta[i, j])
    at = np.array([float(stops[k].t_start_ns) for k in camera.kept])

    def misfits(late: Array) -> Array:
        return np.array([turns_misfit(drive, at - x * 1e9, turn, (i, j)) for x in late.tolist()])

    coarse = np.arange(-LONGEST_S, LONGEST_S + _COARSE_S / 2, _COARSE_S)
    cost = misfits(coarse)
    best = float(coarse[int(np.argmin(cost))])
    if not np.degrees(cost.min()) < FITS_DEG or abs(best) > LONGEST_S - _COARSE_S:
        raise CalibError(
            f"{TOO_FEW_PLACES}, and turns seen in {len(stops)} frames on the move fit the wheels' at "
            f"no clock offset within {LONGEST_S:g} s (to {np.degrees(cost.min()):.1f} deg at best)",
            needed=f"{MIN_STOPS} stops, or turns that agree to {FITS_DEG:g} deg, are needed",
            remedy=_REMEDY,
        )
    fine = best + np.arange(-_COARSE_S, _COARSE_S + _FINE_S / 2, _FINE_S)
    return float(fine[int(np.argmin(misfits(fine)))])
