"""Several cameras that are one, and cameras whose places are exchanged in the robot's description."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.state import camera_motions
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

_ONE_PLACE_M = 3e-3
"""Optical centres nearer than this (m, median over the stops) are of one camera: no two fit so near each other."""
_LEAST_STOPS = 3
_ROUGH_RAD, _ROUGH_M = 0.35, 0.1
"""Errors of a description that are no sign of exchanged cameras, together: 20 deg, 100 mm."""
_CLEARLY = 3.0


def one_place(a: Fit, b: Fit, drives: Sequence[Sequence[Correspondences]]) -> bool:
    """Return whether two cameras stand in one place at the stops that both saw: they are one camera.

    Parameters
    ----------
    a, b
        Their solutions.
    drives
        For each the drives, as it saw them.
    """
    places = [_centres(fit, own) for fit, own in zip((a, b), drives, strict=True)]
    shared = sorted(places[0].keys() & places[1].keys())
    if len(shared) < _LEAST_STOPS:
        return False
    off = np.array([places[0][key][:3, :3].T @ (places[1][key][:3, 3] - places[0][key][:3, 3]) for key in shared])
    return float(np.linalg.norm(np.median(off, axis=0))) < _ONE_PLACE_M


def _centres(fit: Fit, drives: Sequence[Correspondences]) -> dict[tuple[int, int], Array]:
    """Return the camera's pose at each stop that was used, (4, 4), by its drive and its first wheel sample."""
    problem = fit.problem
    motions = camera_motions(problem, fit.state)
    found = {}
    for k, (d, j) in enumerate(zip(problem.drive.tolist(), problem.stop.tolist(), strict=True)):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = motions.R_box_cam[k], motions.p_box_cam[k]
        found[d, drives[d].stops[j].first_sample] = T
    return found


def swapped(found: Sequence[Array], described: Sequence[Sequence[float]]) -> tuple[int, int] | None:
    """Return two cameras that sit where the robot's description has the other one; None if there are none.

    Parameters
    ----------
    found
        Camera extrinsics, (4, 4) each.
    described
        Those of the description, row by row; empty where it does not say. Its base may have another height.
    """
    there = [np.array(T, dtype=np.float64).reshape(4, 4) if len(T) == 16 else None for T in described]
    for a, b in combinations(range(len(found)), 2):
        T_a, T_b = there[a], there[b]
        if T_a is None or T_b is None:
            continue
        straight = _off(found[a], T_a) + _off(found[b], T_b)
        crosswise = _off(found[a], T_b) + _off(found[b], T_a)
        if straight > 1 and straight > _CLEARLY * crosswise:
            return a, b
    return None


def _off(T: Array, described: Array) -> float:
    """Return how far a camera is from where it is described, in rough errors of a description; heights do not count."""
    turn = float(np.linalg.norm(log_so3(described[:3, :3].T @ T[:3, :3])))
    return turn / _ROUGH_RAD + float(np.linalg.norm(T[:2, 3] - described[:2, 3])) / _ROUGH_M
