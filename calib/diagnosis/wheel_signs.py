"""Causes of impossible wheel signs: exchanged or reversed joints, or a box upside down.

Each explanation is tried: the paper's steps are solved with the wheels, or the box, as it has them. It is said only
where it fits, with the values of the fit.
"""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.diagnosis.standing import Standing, how_it_stands, upside_down
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps, solve_motion
from boxcal.calib.four_steps.step1_camera import CameraStep
from boxcal.calib.four_steps.step4_mounting import upright_translations
from boxcal.calib.geometry.diff_drive import Legs
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.target.arrays import Array
from boxcal.target.box import Target

LEAST_STOPS = 5
"""With stops at fewer places than this some wheels fit whatever the signs are, and nothing is said."""
SAME_PLACE_M, SAME_PLACE_DEG = 0.05, 5.0
"""Stops nearer than this, and whose headings differ by less, are at one place: a robot that drives to and fro slips."""
MAX_HEADING_DEG = 3.0
"""Turns seen and rolled agree to this (root mean square) where an explanation fits."""
MAX_RMS = 0.1
"""Places seen and rolled agree to this fraction of the distances moved."""
MAX_UNLIKE = 0.4
"""The wheels' radii differ by no more than this, as a logarithm."""

MAX_RADIUS = 100.0
"""Wheel radius over wheel separation that no unit of the readings makes: a metre of travel a unit makes some 10."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explained:
    """An explanation that fits.

    Attributes
    ----------
    key
        ``wheels-swapped``, ``wheel-reversed`` or ``box-upside-down``.
    text, advice
        In words.
    steps
        The four steps' solution with it.
    """

    key: str
    text: str
    advice: str
    steps: FourSteps

    @property
    def quality(self) -> str:
        """Quality of the fit in words."""
        return agreement(self.steps)


def agreement(steps: FourSteps) -> str:
    """Return how well wheels and images agree (root mean squares), in words."""
    rms = np.degrees(steps.heading.rms)
    mm = steps.mounting.rms * 1e3
    return f"with that, rotations by the images and by the wheels agree to {rms:.2g} deg and positions to {mm:.2g} mm"


def explain_signs(camera: CameraStep, legs: Legs, target: Target) -> Explained | None:
    """Return what explains wheels that do not fit as they are; None if nothing does.

    A box upside down comes first where the images show it so: wheels that are exchanged *and* a camera that is
    mounted upside down would look the same, but are two faults.
    """
    if places(camera) < LEAST_STOPS:
        return None
    standing = how_it_stands(camera.T_cam_box)
    turned = replace(camera, T_cam_box=camera.T_cam_box @ inverse(upside_down(target)))
    over = fitting(turned, legs) if standing in {Standing.UPSIDE_DOWN, Standing.UNCLEAR} else None
    if over is not None and (standing is Standing.UPSIDE_DOWN or float(np.median(_heights(camera.T_cam_box))) < 0):
        return Explained(
            key="box-upside-down",
            text="the box stands upside down",
            advice="Turn the box over for the next drive; this one is right.",
            steps=over,
        )
    swapped = replace(legs, dphi_R=legs.dphi_L, dphi_L=legs.dphi_R)
    left, right = replace(legs, dphi_L=-legs.dphi_L), replace(legs, dphi_R=-legs.dphi_R)
    tried = (
        (
            "wheels-swapped",
            "left and right wheel joints are swapped (or both count backwards)",
            "exchange --left-joint and --right-joint, or give --reverse-left --reverse-right",
            swapped,
        ),
        ("wheel-reversed", "the left wheel's readings fall while it rolls forward", "give --reverse-left", left),
        ("wheel-reversed", "the right wheel's readings fall while it rolls forward", "give --reverse-right", right),
    )
    fits = []
    for key, text, advice, changed in tried:
        steps = fitting(camera, changed)
        if steps is not None:
            fits.append(Explained(key=key, text=text, advice=advice, steps=steps))
    best = min(fits, key=lambda e: e.steps.mounting.rms, default=None)
    if best is not None and over is not None and best.key == "wheels-swapped":
        return replace(best, text=f"{best.text}, or the box stands upside down")
    return best


def places(camera: CameraStep) -> int:
    """Return at how many places the stops are: moves to and fro between two places are one move."""
    T = inverse(camera.T_cam_box)
    apart = np.linalg.norm(T[:, None, :3, 3] - T[:, :3, 3], axis=2)
    turned = np.einsum("aij,bij->ab", T[:, :3, :3], T[:, :3, :3]) < 1 + 2 * np.cos(np.radians(SAME_PLACE_DEG))
    other = (apart > SAME_PLACE_M) | turned
    kept: list[int] = []
    for j in range(len(T)):
        if other[j, kept].all():
            kept.append(j)
    return len(kept)


def _heights(T_cam_box: Array) -> Array:
    return np.asarray(inverse(T_cam_box)[:, 2, 3])


def fitting(camera: CameraStep, legs: Legs) -> FourSteps | None:
    """Return the four steps' solution if wheels and images agree on it."""
    try:
        steps = solve_motion(camera, legs)
    except (CalibError, np.linalg.LinAlgError):
        return None
    return steps if agree(steps) else None


def agree(steps: FourSteps) -> bool:
    """Return whether rotations and positions by images and wheels agree, with radii that are alike and possible."""
    u = upright_translations(steps.camera.T_cam_box, steps.axis.a2, steps.axis.a3)
    moved = float(np.sqrt(np.mean(np.sum(u**2, axis=1))))
    return bool(
        steps.heading.rms < np.radians(MAX_HEADING_DEG)
        and steps.mounting.rms < MAX_RMS * moved
        and max(abs(steps.heading.aR), abs(steps.heading.aL)) < MAX_RADIUS
        and abs(np.log(steps.mounting.rR / steps.mounting.rL)) < MAX_UNLIKE
    )
