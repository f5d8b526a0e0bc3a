"""Drives of a robot that stood still at too few places: frames taken on the move stand for its stops."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.diagnosis.clock import FITS_DEG, turns_left
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.step1_camera import MIN_LANDMARKS, calibrate_camera
from boxcal.calib.four_steps.step3_axis import find_axis
from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.moving.weave import weave
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS
from boxcal.detect.tags.on_the_move import LEAST_WITHOUT_STOPS, TOO_FEW_PLACES
from boxcal.target.arrays import Array, Ids

LONGEST_S = 0.4
"""Clock offsets up to this are looked for."""
_COARSE_S, _FINE_S = 0.02, 0.001
_MOST_FRAMES = 200
"""Of more frames, this many are used, spread over the drive."""
_NEAR = 2
"""Turns are compared between frames at most this many apart: over more, slip adds up."""
_WORST = 0.15
"""Fraction of the turns that does not count: those of a frame that is mistaken."""
_STAND = (
    "Let the robot stand still for two seconds in three places or more where it sees the box: stops need no clock, and "
    "determine what frames on the move leave open"
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
        used, mistaken = _frames_for_stops(drive) if without else (drive, 0)
        out.append(used)
        if used.on_the_move:
            findings.append(_finding(used, mistaken))
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


def _finding(drive: Correspondences, mistaken: int) -> Finding:
    """Return that a result hangs on frames on the move: solved for as well as can be, and never good."""
    return Finding(
        cause="no-stops",
        text=f"{TOO_FEW_PLACES}: {len(drive.stops)} frames taken on the move stand for stops"
        + (f" ({mistaken} more, seen to turn as the wheels do not, left out)" if mistaken else "")
        + ", and what clocks and shutter do to them is estimated from themselves alone",
        advice=f"{_STAND}.",
    )


def _frames_for_stops(drive: Correspondences) -> tuple[Correspondences, int]:
    """Return a drive whose stops are its frames on the move, on the wheels' clock, and how many are mistaken."""
    frames = tuple(frame for frame in drive.moving if len(frame.landmark_ids) >= MIN_LANDMARKS)
    if len(frames) < LEAST_WITHOUT_STOPS:
        raise CalibError(
            f"{len(drive.stops)} usable stops, and {len(frames)} frames on the move that show the box",
            needed=f"{MIN_STOPS} stops, or {LEAST_WITHOUT_STOPS} such frames, are needed",
            remedy=_REMEDY,
        )
    rows = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _MOST_FRAMES)).round().astype(int))
    alone = replace(drive, stops=(), moving=tuple(frames[k] for k in rows))
    late_s, kept = _clock_offset(alone)
    woven = weave(alone, np.zeros(0, dtype=np.int64), kept, late_s).drives[0]
    source = replace(drive.source, clock_offset=drive.source.clock_offset + late_s)
    return replace(woven, on_the_move=True, source=source), len(rows) - len(kept)


def _clock_offset(drive: Correspondences) -> tuple[float, Ids]:
    """Return the stamps of frames less the times at which they were taken, s, by turns seen and rolled.

    And the numbers of the frames that are not mistaken: one that shows a single face from afar may be seen mirrored.
    """
    row = weave(drive, np.zeros(0, dtype=np.int64), np.arange(len(drive.moving)), 0.0)
    stops = row.drives[0].stops
    camera = calibrate_camera(stops, drive.image_size)
    theta = find_axis(camera.T_cam_box).theta
    i, j = np.triu_indices(len(theta), 1)
    near = j - i <= _NEAR
    i, j = i[near], j[near]
    turn = wrap(-theta[i, j])
    at = np.array([float(stops[k].t_start_ns) for k in camera.kept])

    def left(late: float) -> Array | None:
        return turns_left(drive, at - late * 1e9, turn, (i, j), _WORST)

    def misfits(late: Array) -> Array:
        return np.array([_most_of(left(x)) for x in late.tolist()])

    coarse = np.arange(-LONGEST_S, LONGEST_S + _COARSE_S / 2, _COARSE_S)
    cost = misfits(coarse)
    best = float(coarse[int(np.argmin(cost))])
    if not np.degrees(cost.min()) < FITS_DEG or abs(best) > LONGEST_S - _COARSE_S:
        least = float(np.degrees(cost.min()))
        at_best = f" (to {least:.1f} deg at best)" if np.isfinite(least) else ""
        raise CalibError(
            f"{TOO_FEW_PLACES}, and turns seen in {len(stops)} frames on the move fit the wheels' at "
            f"no clock offset within {LONGEST_S:g} s{at_best}",
            needed=f"{MIN_STOPS} stops, or turns that agree to {FITS_DEG:g} deg, are needed",
            remedy=_REMEDY,
        )
    fine = best + np.arange(-_COARSE_S, _COARSE_S + _FINE_S / 2, _FINE_S)
    late_s = float(fine[int(np.argmin(misfits(fine)))])
    return late_s, np.delete(
        np.arange(len(drive.moving)), row.frame[np.array(camera.kept)[_mistaken(left(late_s), i, j)]]
    )


def _most_of(left: Array | None) -> float:
    """Return the root mean square of turns, rad, but for the worst; inf where there are none."""
    if left is None:
        return float("inf")
    square = np.sort(left[np.isfinite(left)] ** 2)
    return float(np.sqrt(np.mean(square[: max(round((1 - _WORST) * len(square)), 1)])))


def _mistaken(left: Array | None, i: Ids, j: Ids) -> Ids:
    """Return the frames most of whose turns, of frames i to frames j, differ from the wheels' by more than fits."""
    if left is None:
        return i[:0]
    far = np.abs(left) > np.radians(FITS_DEG)
    known = np.isfinite(left)
    count = int(j.max()) + 1
    bad = np.bincount(i, far, count) + np.bincount(j, far, count)
    return np.flatnonzero(bad > 0.5 * (np.bincount(i, known, count) + np.bincount(j, known, count)))
