"""Uncertainty that a measured or refined box adds to every length of a calibration."""

import hashlib
from collections.abc import Sequence

import numpy as np

from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target
from boxcal.target.measure.measured_size import SIZES
from boxcal.target.measure.size_influence import measured_scale_sigma, scale_influence


def box_notes(target: Target, drives: Sequence[Correspondences]) -> tuple[str, ...]:
    """Return what is to be said of a box that was measured, or that a fleet refined, to whose drives it is given."""
    return (*_measured(target), *_refined(target, drives))


def drive_id(drive: Correspondences) -> str:
    """Return what names a drive in a refined target, 16 hexadecimal digits: a hash of its wheels' readings."""
    wheels = drive.wheels
    digest = hashlib.sha256()
    for part in (wheels.t_ns, wheels.phi_R, wheels.phi_L):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()[:16]


def _measured(target: Target) -> tuple[str, ...]:
    """Return what a measured box's own uncertainty adds to every length, and which of its sizes to measure better."""
    if target.measured is None:
        return ()
    cov = target.measured.cov
    influence = scale_influence(target)
    share = np.abs(influence) * np.sqrt(np.diag(cov))
    names = {"sx": "the print across (--tags-x)", "sy": "the print up (--tags-y)"}
    worst = SIZES[int(np.argmax(share))]
    return (
        f"the box's measured size adds {measured_scale_sigma(target):.2%} to all lengths (wheels, wheel separation, "
        f"camera position); measuring {names.get(worst, f'its {worst} (--{worst})')} better would help most",
    )


def _refined(target: Target, drives: Sequence[Correspondences]) -> tuple[str, ...]:
    """Return whose box it is, and that a drive which helped to refine it would count its own news twice."""
    refined = target.refined
    if refined is None:
        return ()
    who = f"{refined.robots} robots" if refined.robots > 1 else "one robot"
    if any(drive_id(drive) in refined.drives for drive in drives):
        return (
            f"this drive is among those of {who} that the box's shape was found from: its sigmas count that twice; "
            "calibrate the fleet again with --joint-box for sigmas that do not",
        )
    return (f"the box's shape was taken as {who} found it, with its covariance",)
