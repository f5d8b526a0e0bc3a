"""Measured size of a built box: print scale and outer size, with their covariance."""

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.errors import TargetError

if TYPE_CHECKING:
    from boxcal.target.box import Box


SIZES = ("sx", "sy", "width", "depth", "height")
"""The dimensions that are measured, in the order of every covariance and Jacobian by them."""
CREDIBLE = 0.05
"""A dimension further than this from its design, relative, is a mistake and no measurement."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measured:
    """The measured dimensions of one box.

    A print is the designed sheet scaled by (sx, sy). Its face is glued with its **lower edge on the box's base** and
    centred between the vertical edges. So a corner that was designed at ``g`` to the right of the face's centre and
    at height ``z`` lies at ``sx g`` and ``sy z``, in the plane at half the measured width or depth. No corner depends
    on the measured height: it is kept as a check of what was built.

    Attributes
    ----------
    sx, sy
        Printed over designed lengths, across and up a sheet.
    width, depth, height : m
        Of the box along x, y and z, over its glued sheets.
    cov : (5, 5)
        Covariance in the order of :data:`SIZES`; scales are pure numbers, lengths in m.
    """

    sx: float
    sy: float
    width: float
    depth: float
    height: float
    cov: Array

    def __post_init__(self) -> None:
        for name in SIZES:
            value = getattr(self, name)
            if not (isfinite(value) and 0 < value < 100):
                raise TargetError(f"measured {name} is {value}: a positive number is needed", remedy="measure again")
        cov = self.cov
        if cov.shape != (len(SIZES),) * 2 or not np.all(np.isfinite(cov)):
            raise TargetError(f"measured covariance: {len(SIZES)} rows of {len(SIZES)} numbers are needed")
        largest = float(np.abs(cov).max())
        if np.abs(cov - cov.T).max() > 1e-9 * largest or np.linalg.eigvalsh(cov)[0] < -1e-9 * largest:
            raise TargetError("measured covariance: it is no covariance (symmetric, no negative variance)")


def check_credible(box: "Box", measured: Measured) -> None:
    """Refuse measured dimensions that lie more than 5 % from a box's design.

    Raises
    ------
    TargetError
        It asks for the usual cause, a print that a viewer fitted to the page.
    """
    for name in SIZES:
        designed = 1.0 if name in {"sx", "sy"} else getattr(box, name)
        value = getattr(measured, name)
        off = value / designed - 1
        if abs(off) > CREDIBLE:
            what = (
                f"print scale {name} is {value:.4g}, 1 was designed"
                if designed == 1
                else f"measured {name} is {value * 1e3:.5g} mm, {designed * 1e3:.5g} mm was designed"
            )
            raise TargetError(
                f"{off:+.1%} off, at most {CREDIBLE:.0%} is credible",
                source=what,
                remedy="was it printed with "
                '"fit to page"? print again at 100 %, or check the reading and its unit (mm)',
            )
