"""Rules on what every calibration determines, the closed form's too: how the robot was driven, and how it stands."""

from collections.abc import Callable, Sequence

import numpy as np

from boxcal.calib.assessment.limits import LIMITS, graded
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Kind, Level, Reason
from boxcal.target.arrays import Array

_LEVEL, _REAR = 0.3, 0.5
"""A view has a direction on the floor if so much of it is level; to the rear is within 60 deg of straight back."""


def _stops(c: Calibration) -> list[Reason]:
    own = len(c.stops)
    of_all = c.rig.stops if c.rig is not None else 0
    count = max(own, of_all) if own >= -LIMITS["stops"].usable else own
    moved = any(finding.cause == "no-stops" for finding in c.findings)
    text = f"{count} frames on the move stand for stops." if moved else f"{count} stops were used."
    if count > own:
        text = f"{count} stops were used, {own} of them by this camera."
    if count < -LIMITS["stops"].good:
        text = f"Only {count} stops were used: with so few a slipped wheel or a pushed box goes unnoticed."
    return graded("stops", -count, text, "Record a drive with at least 12 stops, spread all round the box.")


def _around(c: Calibration) -> list[Reason]:
    gap = largest_gap_deg(np.array([stop.T_box_cam for stop in c.stops]))
    text = f"The stops stand round the box; the largest gap between them is {gap:.0f}°."
    if gap > LIMITS["around"].good:
        text = (
            f"All stops lie on one side of the box, within {360 - gap:.0f}°: a fault of the face on that "
            "side (print, glue, tilt of the floor) enters the result unseen."
        )
    return graded("around", gap, text, "Drive all the way round the box and stop on each of its four sides.")


def _turned(c: Calibration) -> list[Reason]:
    turn = largest_turn_deg(np.array([stop.T_box_cam for stop in c.stops]))
    text = f"The robot turned by up to {turn:.0f}° between stops."
    if turn < -LIMITS["turned"].good:
        text = f"The robot hardly turned (by {turn:.0f}° at most): wheel separation and camera position hang on turns."
    return graded(
        "turned", -turn, text, "Turn between the stops: at least a quarter turn, to the left and to the right."
    )


def _floor(c: Calibration) -> list[Reason]:
    tilt = float(np.degrees(c.quality.up_error_rad))
    text = f"The box stands upright on the floor, to {tilt:.2f}°."
    if tilt > LIMITS["floor"].good:
        text = f"The box leans by {tilt:.1f}° against the floor that the robot drives on."
    return graded(
        "floor", tilt, text, "Put box and robot on one flat floor, with nothing under the box, and drive again."
    )


def _wheels(c: Calibration) -> list[Reason]:
    ratio = c.wheels.rR / c.wheels.rL
    unlike = abs(ratio - 1)
    text = f"Both wheels are alike, to {unlike:.1%}."
    if unlike > LIMITS["wheels"].good:
        than = "larger" if ratio > 1 else "smaller"
        text = f"The right wheel is {unlike:.0%} {than} than the left: no usual pair of wheels."
    return graded(
        "wheels", unlike, text, "Check that left and right joint belong to the wheels they name, and count alike."
    )


def _moves(c: Calibration) -> list[Reason]:
    ratio = c.quality.sigma4_sigma3
    text = f"The moves differ enough to tell all parameters apart (singular value ratio {ratio:.2f})."
    if ratio < -LIMITS["moves"].good:
        text = f"All moves are much alike (singular value ratio {ratio:.3f}): the camera's place can hardly be told."
    return graded("moves", -ratio, text, "Mix the moves: straight legs, bends and turns on the spot, to both sides.")


def direction_unchecked(c: Calibration) -> list[Reason]:
    """Return what a camera that looks to the rear may be instead, where no description in the log says."""
    views = [c.T_body_cam, *(camera.T_body_cam for camera in (c.rig.cameras if c.rig is not None else ()))]
    if any(view[0, 2] > -_REAR * np.hypot(view[0, 2], view[1, 2]) or np.hypot(*view[:2, 2]) < _LEVEL for view in views):
        return []
    text = (
        "The camera looks to the rear. Where it looks ahead on the robot, the wheel joints are exchanged and both "
        "count backwards, which no drive shows: give --left-joint, --right-joint, --reverse-left and --reverse-right."
    )
    return [Reason(rule="direction", level=Level.GOOD, text=text, kind=Kind.UNCHECKED)]


def largest_gap_deg(T_box_cam: Array) -> float:
    """Return the largest angle, seen from the box, in which no stop (P, 4, 4) lies, deg."""
    azimuth = np.sort(np.arctan2(T_box_cam[:, 1, 3], T_box_cam[:, 0, 3]))
    return float(np.degrees(np.max(np.diff(azimuth, append=azimuth[:1] + 2 * np.pi))))


def largest_turn_deg(T_box_cam: Array) -> float:
    """Return the largest angle between the orientations of any two stops (P, 4, 4), deg."""
    R = T_box_cam[:, :3, :3]
    cosine = (np.einsum("iab,jab->ij", R, R) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine.min(), -1, 1))))


DRIVE_RULES: Sequence[Callable[[Calibration], list[Reason]]] = (_stops, _around, _turned, _floor, _wheels, _moves)
