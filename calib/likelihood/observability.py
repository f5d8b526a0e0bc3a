"""Directions of the parameters that a drive determines badly or not at all, in words.

The information matrix of the shared unknowns is taken in natural units, in which 1 is a poor result: 1 % of a focal
length, a radius or the wheel separation, 10 mrad, 5 mm. Its eigenvectors of little information are combinations of
parameters that the drive leaves open.
"""

import numpy as np

from boxcal.calib.geometry.parameters import MOUNTING
from boxcal.calib.likelihood.estimate import Direction
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array, Mask

WEAK_SIGMA = 1.0
"""From this standard deviation on (natural units) a direction is called weak."""
NULL_SIGMA = 1e3
"""From this one on it is not determined at all."""
_RELATIVE = 0.3
_BODY_NAMES = {
    "rx": "roll of the camera on the robot",
    "ry": "pitch of the camera on the robot",
    "rz": "yaw of the camera on the robot (a1)",
    "kr": "distortion kr",
}
_GROUPS = (
    ({"fu", "fv", "cu", "cv", "kr"}, "add stops near to and far from the box, and such that see two faces at a slant"),
    ({"b"}, "add turns on the spot, to the left and to the right"),
    ({"rR", "rL"}, "add long straight legs, and turns to both sides"),
    ({"rz", "tx", "ty"}, "add stops that face the box from other sides, with turns between them"),
    ({"rx", "ry", "tz"}, "add stops with other headings and at other distances"),
)
_OTHER = "leave this unknown out, give it a tighter prior, or add stops that see more faces of the box"


def natural_units(problem: Problem, state: State) -> Array:
    """Return the size of a poor result for each shared unknown, (n,)."""
    focal = float(np.mean(np.abs(state.lens[:2])))
    units = []
    for name in problem.names:
        if name in {"fu", "fv", "cu", "cv"}:
            unit = 0.01 * focal
        elif name in {"rR", "rL", "b"}:
            unit = 0.01 * float(np.abs(state.wheels[("rR", "rL", "b").index(name)]))
        elif name in {"tx", "ty", "tz"}:
            unit = 5e-3
        elif name.startswith("tilt") or name.endswith(("rx", "ry", "rz")):
            unit = 1e-2
        elif name == "ink" or name.startswith("bow") or name.endswith(("_tx", "_ty", "_tz")):
            unit = 1e-3
        elif name.startswith("scale"):
            unit = 1e-2
        else:  # coefficients of the lens
            unit = 0.1
        units.append(unit)
    return np.array(units)


def open_directions(problem: Problem, state: State, information: Array) -> tuple[tuple[Direction, ...], Mask]:
    """Return what is weak or not determined, the worst first, and which shared unknowns are not determined.

    Parameters
    ----------
    problem, state
        Names and values of the unknowns.
    information : (n, n)
        Of the shared unknowns (extrinsics: right perturbation), the stops eliminated.
    """
    units = natural_units(problem, state)
    # About the body's axes, so that names mean what a user measures.
    T = np.diag(units)
    R = state.T_body_cam[:3, :3]
    m = MOUNTING.start
    T[m : m + 3, m : m + 3] = R.T * units[m]
    T[m + 3 : m + 6, m + 3 : m + 6] = R.T * units[m + 3]
    values, vectors = np.linalg.eigh(T.T @ information @ T)
    sigma = np.where(values > NULL_SIGMA**-2, 1 / np.sqrt(np.maximum(values, NULL_SIGMA**-2)), np.inf)
    found = [
        _direction(problem.names, vectors[:, k], float(sigma[k])) for k in np.argsort(-sigma) if sigma[k] > WEAK_SIGMA
    ]
    null = T @ vectors[:, np.isinf(sigma)]  # in the solver's own terms
    touched = np.any(np.abs(null) / units[:, None] > 1e-3, axis=1)
    return tuple(found), touched


def _direction(names: tuple[str, ...], vector: Array, sigma: float) -> Direction:
    order = np.argsort(-np.abs(vector))
    sign = np.sign(vector[order[0]])
    relative = np.abs(vector) / np.abs(vector).max()
    taking_part = [int(k) for k in order if relative[k] > _RELATIVE]
    parts = tuple((names[k], float(round(sign * vector[k], 3))) for k in taking_part)
    shown = [_BODY_NAMES.get(names[k], names[k]) for k in taking_part]
    advice = next((text for group, text in _GROUPS if names[taking_part[0]] in group), _OTHER)
    if np.isinf(sigma):
        what = (
            f"{shown[0]} is not determined by these stops"
            if len(shown) == 1
            else f"{', '.join(shown[:-1])} and {shown[-1]} cannot be told apart by these stops"
        )
    else:
        size = f"{sigma:.1f} times what would be poor (1 % of a length, 10 mrad, 5 mm)"
        what = (
            f"{shown[0]} is known badly only, {size}"
            if len(shown) == 1
            else f"{', '.join(shown[:-1])} and {shown[-1]} are known badly together, {size}"
        )
    return Direction(parameters=parts, sigma=sigma, what=what, advice=advice)
