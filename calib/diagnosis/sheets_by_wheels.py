"""Arrangement of the sheets by the wheels: the one under which they and the images agree, unlike as described.

Images of two sheets show how these lie to each other (:mod:`boxcal.calib.diagnosis.sheets`). With one sheet a image,
sheets exchanged or upside down put the robot elsewhere without any corner being off, and only the wheels show it: each
arrangement with one thing wrong is tried, and the one that fits is taken.
"""

from collections.abc import Callable

import numpy as np

from boxcal.calib.diagnosis.joint_units import LEAST, MOST
from boxcal.calib.diagnosis.sheets import Gluing
from boxcal.calib.diagnosis.wheel_signs import LEAST_STOPS, agreement, fitting
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.four_steps.step1_camera import calibrate_camera
from boxcal.calib.geometry.diff_drive import legs_between
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import FACES, Target

_UPRIGHT = (False,) * FACES
_ORDERS = ((1, 0, 2, 3), (0, 2, 1, 3), (0, 1, 3, 2), (3, 1, 2, 0), (2, 1, 0, 3))
"""Faces of the sheets: neighbours exchanged, or in reverse order."""
GLUINGS = (
    *(Gluing(face=order, turned=_UPRIGHT) for order in _ORDERS),
    *(Gluing(face=tuple(range(FACES)), turned=tuple(f == up for f in range(FACES))) for up in range(FACES)),
)
"""Arrangements with one thing wrong."""
CLEARLY = 3.0
"""Positions agree this many times better under the arrangement that is taken than under any other, or as described."""


def gluing_by_wheels(
    drive: Correspondences,
    target: Target,
    mode: CameraMode,
    placed: Callable[[Correspondences, Target], Correspondences],
    described: FourSteps | None,
) -> tuple[Gluing, str] | None:
    """Return the arrangement under which wheels and images agree, with how well in words; None if none does.

    A few stops after a leg that went wrong fit some arrangement by chance: with wheels that no robot has, or hardly
    better than the box as described.

    Parameters
    ----------
    drive
        What the robot saw and did.
    target
        The box as described.
    mode
        For the camera's calibration.
    placed
        Gives a drive with its landmarks where another target has them.
    described
        The four steps' solution with the box as described; None if they fail.
    """
    if len(drive.stops) < LEAST_STOPS:
        return None
    fits = []
    for gluing in GLUINGS:
        there = placed(drive, gluing.target(target))
        try:
            camera = calibrate_camera(there.stops, there.image_size, mode)
        except CalibError:
            continue
        steps = fitting(camera, legs_between(there, camera.kept)) if len(camera.kept) >= LEAST_STOPS else None
        if steps is not None and LEAST < steps.mounting.rR / steps.mounting.b < MOST:
            fits.append((steps.mounting.rms, gluing, steps))
    fits.sort(key=lambda fit: fit[0])
    others = [rms for rms, *_ in fits[1:]] + ([] if described is None else [described.mounting.rms])
    if not fits or min(others, default=np.inf) < CLEARLY * fits[0][0]:
        return None
    return fits[0][1], agreement(fits[0][2])
