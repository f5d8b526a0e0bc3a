"""Stops whose image shows the box at another tilt than the others do: images or a camera that were turned."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.left_out import named, said_to_be_left_out, without_stops
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.step1_camera import CameraStep, calibrate_camera
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS

TURNED_DEG = 45.0
"""A box whose upright is seen so far from where most stops see it is no box that leans: the image was turned."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """Stops of a drive whose images were turned.

    Attributes
    ----------
    stops
        Their numbers, from 0.
    angle_deg
        Largest angle at which they see the box's upright away from where the others do.
    others
        Number of the other stops that can be used.
    """

    stops: tuple[int, ...] = ()
    angle_deg: float = 0.0
    others: int = 0

    @property
    def as_many(self) -> bool:
        """Whether there are as many of these as of others, so that which are right cannot be told."""
        return len(self.stops) >= MIN_STOPS and self.others <= len(self.stops)

    def finding(self, drive: Correspondences) -> Finding:
        """Return what is said of a drive without them."""
        return Finding(
            cause="pictures-turned",
            text=f"{self.text(drive)}: {said_to_be_left_out(self.stops)}",
            advice="Fasten the camera, leave the picture's orientation alone during a drive, and drive again.",
            stops=self.stops,
        )

    def text(self, drive: Correspondences) -> str:
        """Return which stops of a drive they are, and how far they are turned."""
        return (
            f"the box stands in the pictures of {named(self.stops, drive)} by up to {self.angle_deg:.0f} deg otherwise "
            "than in the others, as if pictures or camera had been turned, or the box been laid on its side"
        )


def turned_stops(camera: CameraStep) -> Turned:
    """Return the stops that see the box's upright elsewhere than most do.

    A robot turns about the upright only, so that its camera sees it in one direction at all stops.
    """
    up = camera.T_cam_box[:, :3, 2]
    off = np.degrees(np.arccos(np.clip(up @ up.T, -1, 1)))
    alike = off < TURNED_DEG
    most = int(np.argmax(alike.sum(axis=1)))
    stops = tuple(camera.kept[k] for k in np.flatnonzero(~alike[most]).tolist())
    return Turned(stops=stops, angle_deg=float(off[most].max(initial=0.0)), others=len(camera.kept) - len(stops))


def find_turned(drive: Correspondences, mode: CameraMode) -> Turned:
    """Return the stops of a drive whose images were turned; none where its corners determine no camera."""
    try:
        return turned_stops(calibrate_camera(drive.stops, drive.image_size, mode))
    except CalibError:
        return Turned()


def without_turned(
    drives: Sequence[Correspondences], turned: Sequence[Turned]
) -> tuple[list[Correspondences], list[Finding]]:
    """Return drives without the corners of turned images, and what is said of them: nothing if there are none.

    Drives are left as they are where turned images are no minority.
    """
    sound, findings = [], []
    for drive, found in zip(drives, turned, strict=True):
        few = bool(found.stops) and found.others >= max(MIN_STOPS, len(found.stops) + 1)
        sound.append(without_stops(drive, found.stops) if few else drive)
        if few:
            findings.append(found.finding(drive))
    return sound, findings


def said_with_turned(error: CalibError, drives: Sequence[Correspondences], turned: Sequence[Turned]) -> CalibError:
    """Return why drives cannot be calibrated, after which pictures were turned where these are as many as others."""
    for drive, found in zip(drives, turned, strict=True):
        if found.as_many:
            text, remedy = found.text(drive), found.finding(drive).remedy
            return CalibError(f"{text}; as recorded: {error.found}", source=error.source, remedy=remedy)
    return error


def refuse_turned(drives: Sequence[Correspondences], turned: Sequence[Turned]) -> None:
    """Refuse drives in which as many pictures were turned as others were not.

    Raises
    ------
    CalibError
        If one is such: which of the two are right cannot be told.
    """
    for drive, found in zip(drives, turned, strict=True):
        if found.as_many:
            text, remedy = found.text(drive), found.finding(drive).remedy
            raise CalibError(f"{text}; there are as many of these as of others", remedy=remedy)
