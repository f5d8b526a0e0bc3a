"""Wheels that measure too little of the path to calibrate: readings that never change, or hardly any leg covered."""

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.diff_drive import Legs

LEAST_LEGS = 2
"""Each leg has three equations, and wheels and planar extrinsics are six unknowns."""


def refuse_silent_wheels(legs: Legs) -> None:
    """Refuse legs between stops that no wheels can be found from.

    Raises
    ------
    CalibError
        If a wheel's reading is the same at all times, or the path is known of fewer legs than ``LEAST_LEGS``.
    """
    still = [name for name, dphi in (("left", legs.dphi_L), ("right", legs.dphi_R)) if not np.any(dphi)]
    if still:
        raise CalibError(
            f"the {still[0]} wheel's readings never change" if len(still) == 1 else "the wheels' readings never change",
            needed="both wheels' readings between the stops are needed",
            remedy="look for the topic and the joints of the wheels' driver, and turn both wheels",
        )
    measured, count = int(np.sum(legs.known)), len(legs.known)
    if measured < LEAST_LEGS:
        raise CalibError(
            f"the wheels' travel is known on {measured} of {count} paths between stops",
            needed=f"at least {LEAST_LEGS} are needed, better all",
            remedy="look for gaps in the wheels' readings and restarts of their driver, and drive again",
        )
