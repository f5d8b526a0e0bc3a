"""Floors that are no plane: steps, ramps and bends, detected by how the robot stands at its stops.

The model has one plane, and roll, pitch and height of each stop at random about it. A floor that bends under the box
leans robots by where they stand, not at random, and all stops face the box: what they have in common goes into the
camera's pitch and height, and no scatter shows it.
"""

import numpy as np
from scipy.special import fdtrc

from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.finding import Finding
from boxcal.target.arrays import Array

HEIGHT_M = 7e-4
"""Standard deviation of the stops' heights about one plane from which on it is none; tiles and carpets have .2 mm."""
LEAN_RAD = 4e-4
"""Lean that goes with the place, root mean square, from which on it is reported."""
SIGNIFICANCE = 1e-4
"""p-value of a bend below which it is believed."""
_LEAST_STOPS = 6


def uneven_floor(found: Estimate) -> Finding | None:
    """Return what is said of a floor that is not the plane that the model has; None if nothing speaks against it."""
    height = float(found.components.height)
    T = np.concatenate([drive.T_box_body for drive in found.drives])
    lean, p_value = _bent(T)
    stepped, bent = height >= HEIGHT_M, lean > LEAN_RAD and p_value < SIGNIFICANCE
    said = [f"stops stand {1e3 * height:.1f} mm above and below one plane"] if stepped else []
    said += [f"the robot leans by {np.degrees(lean):.2f} deg as the place has it"] if bent else []
    if not said:
        return None
    return Finding(
        cause="floor-uneven",
        text=f"the floor is no plane: {' and '.join(said)}; the camera's pitch and height take up a part of that",
        advice="Drive on one even floor, without steps, ramps or the edges of carpets, and put the box on it.",
        size=float(np.degrees(lean)) if bent else 1e3 * height,
        unit="deg" if bent else "mm",
        p_value=p_value if bent else np.nan,
    )


def _bent(T_box_body: Array) -> tuple[float, float]:
    """Return the lean, rad, that stops (P, 4, 4) have by their place, as on a floor of second degree, and its p-value.

    A tilt of the floor, and one of the robot, which all have, are no bend.
    """
    count = len(T_box_body)
    if count < _LEAST_STOPS:
        return 0.0, 1.0
    x, y = T_box_body[:, :2, 3].T
    lean = T_box_body[:, :2, 2].ravel()
    alike = np.concatenate([np.tile(np.eye(2), (count, 1)), T_box_body[:, :2, :2].reshape(-1, 2)], axis=1)
    none = np.zeros(count)
    slope = np.stack([np.stack([2 * x, none], 1), np.stack([y, x], 1), np.stack([none, 2 * y], 1)], axis=-1)
    left, slopes = (_beside(alike, part) for part in (lean[:, None], slope.reshape(-1, 3)))
    freedom = 2 * count - alike.shape[1] - slopes.shape[1]
    rest = _beside(slopes, left)
    bend = float(np.sum(left**2) - np.sum(rest**2))
    scatter = float(np.sum(rest**2)) / freedom
    if bend <= 0 or scatter <= 0:
        return 0.0, 1.0
    return float(np.sqrt(bend / count)), float(fdtrc(slopes.shape[1], freedom, bend / slopes.shape[1] / scatter))


def _beside(columns: Array, values: Array) -> Array:
    """Return what columns (N, k) leave of values (N, m)."""
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])
