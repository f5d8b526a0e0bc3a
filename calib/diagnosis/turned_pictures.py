"""Stops whose image shows the box at another tilt than the others do: images or a camera that were turned."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.calib.diagnosis.frozen import without_corners
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.step1_camera import CameraStep, calibrate_camera
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS

TURNED_DEG = 45.0
"""A box whose upright is seen so far from where most stops see it is no box that leans: the image was turned."""
_ADVICE = "Fasten the camera, leave the picture's orientation alone during a drive, and drive again."
_REMEDY = _ADVICE[:1].lower() + _ADVICE[1:].rstrip(".")


def turned_stops(camera: CameraStep) -> tuple[tuple[int, ...], float]:
    """Return the stops, from 0, that see the box's upright elsewhere than most do, and by what angle at most, deg.

    A robot turns about the upright only, so that its camera sees it in one direction at all stops.
    """
    up = camera.T_cam_box[:, :3, 2]
    off = np.degrees(np.arccos(np.clip(up @ up.T, -1, 1)))
    alike = off < TURNED_DEG
    most = int(np.argmax(alike.sum(axis=1)))
    odd = np.flatnonzero(~alike[most])
    return tuple(camera.kept[k] for k in odd.tolist()), float(off[most].max(initial=0.0))


def without_turned(drives: Sequence[Correspondences], mode: CameraMode) -> tuple[list[Correspondences], list[Finding]]:
    """Return drives without the corners of turned images, and what is said of them: nothing if there are none.

    Drives are left as they are where turned images are no minority, or no camera is found.
    """
    sound, findings = [], []
    for drive in drives:
        sound.append(drive)
        odd, angle, left = _turned(drive, mode)
        if odd and left >= max(MIN_STOPS, len(odd) + 1):
            stops = tuple(without_corners(stop) if j in odd else stop for j, stop in enumerate(drive.stops))
            sound[-1] = replace(drive, stops=stops)
            text = f"{_text(odd, angle, len(drive.stops))}: these were left out"
            findings.append(Finding(cause="pictures-turned", text=text, advice=_ADVICE, stops=odd))
    return sound, findings


def said_with_turned(error: CalibError, drives: Sequence[Correspondences], mode: CameraMode) -> CalibError:
    """Return why drives cannot be calibrated, after which pictures were turned where these are as many as others."""
    text = _as_many(drives, mode)
    return CalibError(f"{text}; as recorded: {error.found}", source=error.source, remedy=_REMEDY) if text else error


def refuse_turned(drives: Sequence[Correspondences], mode: CameraMode) -> None:
    """Refuse drives in which as many pictures were turned as others were not.

    Raises
    ------
    CalibError
        If one is such: which of the two are right cannot be told.
    """
    text = _as_many(drives, mode)
    if text:
        raise CalibError(f"{text}; there are as many of these as of others", remedy=_REMEDY)


def _as_many(drives: Sequence[Correspondences], mode: CameraMode) -> str:
    """Return what is said of a drive in which as many pictures were turned as others were not; empty if none is."""
    for drive in drives:
        odd, angle, left = _turned(drive, mode)
        if len(odd) >= MIN_STOPS and left <= len(odd):
            return _text(odd, angle, len(drive.stops))
    return ""


def _turned(drive: Correspondences, mode: CameraMode) -> tuple[tuple[int, ...], float, int]:
    """Return the stops of turned pictures, the largest angle, deg, and how many others there are."""
    try:
        camera = calibrate_camera(drive.stops, drive.image_size, mode)
    except CalibError:
        return (), 0.0, len(drive.stops)
    odd, angle = turned_stops(camera)
    return odd, angle, len(camera.kept) - len(odd)


def _text(odd: tuple[int, ...], angle: float, count: int) -> str:
    numbers = ", ".join(str(j + 1) for j in odd)
    return (
        f"the box stands in the pictures of stop{'s' if len(odd) > 1 else ''} {numbers} (of {count}) by up to "
        f"{angle:.0f} deg otherwise than in the others, as if pictures or camera had been turned, or the box been laid "
        "on its side"
    )
