"""Uncertainty that a measured box adds to every length of a calibration."""

import numpy as np

from boxcal.target.box import Target
from boxcal.target.measure.measured_size import SIZES
from boxcal.target.measure.size_influence import measured_scale_sigma, scale_influence


def box_notes(target: Target) -> tuple[str, ...]:
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
