"""Warnings at once, from a look at one image and from the solution so far."""

from collections.abc import Iterator
from math import degrees
from typing import NamedTuple

import numpy as np

from boxcal.calib.guide.drive.glance import Glance
from boxcal.calib.likelihood.estimate import Estimate

_DARK, _LOW_CONTRAST = 45.0, 35.0
_WHITE = 252.0
_SMALL_PX, _TINY_PX = 18.0, 14.0
_SOFT_PX, _BLURRED_PX = 2.8, 3.5
_LEAN = 1.5
"""Tilt of the floor against the box, degrees, that is reported."""


class Warned(NamedTuple):
    """A warning.

    Attributes
    ----------
    level
        ``bad`` (the stop will not count), ``care`` (it will count for less) or ``note``.
    text
        What is wrong and what to do.
    """

    level: str
    text: str


def warnings_of_picture(seen: Glance, *, planned: bool, moving: bool) -> Iterator[Warned]:
    """Yield what is wrong with an image.

    Parameters
    ----------
    seen
        The image at a glance.
    planned
        Whether stops are planned: how many faces they see is part of the plan then.
    moving
        Whether the robot is moving: it may look elsewhere and its images may be blurred.
    """
    if not len(seen.corners):
        if seen.white < _DARK:
            yield Warned("bad", "too dark: the picture's brightest parts are nearly black; turn on the light")
        elif not moving:
            yield Warned("bad", "no tag of the box in the picture; turn the robot towards the box")
        return
    if seen.white < _DARK or seen.white - seen.black < _LOW_CONTRAST:
        yield Warned("care", f"too dark: white paper is {seen.white:.0f} of 255; turn on the light, or expose longer")
    elif seen.white > _WHITE:
        yield Warned("care", "overexposed: white paper is clipped, which moves the edges; expose shorter")
    if moving:
        return
    if seen.side_px < _TINY_PX:
        yield Warned("bad", f"too far: tags are {seen.side_px:.0f} px wide, {_SMALL_PX:.0f} are wanted; drive nearer")
    elif seen.side_px < _SMALL_PX:
        yield Warned("note", f"far: tags are {seen.side_px:.0f} px wide, {_SMALL_PX:.0f} are wanted; drive nearer")
    if seen.edge_px > _BLURRED_PX:
        yield Warned("care", f"blurred: edges are {seen.edge_px:.0f} px wide; stand still, and focus the camera")
    if len(seen.faces) == 1 and not planned:
        yield Warned("note", "one face only: a corner of the box in the picture says more")


def sharpness(seen: Glance) -> str:
    """Return in a word how sharp an image is, empty without a tag."""
    if not np.isfinite(seen.edge_px):
        return ""
    return "sharp" if seen.edge_px < _SOFT_PX else "a little soft" if seen.edge_px < _BLURRED_PX else "blurred"


def warnings_of_estimate(found: Estimate) -> Iterator[Warned]:
    """Yield what the solution so far cannot explain, and what it had to allow for."""
    for leg in found.flagged_legs:
        yield Warned("bad", leg.text)
    for drive in found.drives:
        tilt = degrees(float(np.hypot(*drive.tilt)))
        sigma = degrees(float(np.max(drive.tilt_sigma)))
        if tilt > max(_LEAN, 4 * sigma):
            yield Warned(
                "care", f"the floor leans {tilt:.1f} deg against the box; is the box upright on the same floor?"
            )
    for finding in found.findings:
        yield Warned("care", f"{finding.text}. {finding.advice}".strip())
