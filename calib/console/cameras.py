"""Cameras of robots and the transforms between them as plain tables."""

from collections.abc import Sequence
from math import isfinite

import numpy as np

from boxcal.calib.console.tables import shortened, table
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.rig import CameraPair
from boxcal.target.arrays import Array

_DEG = float(np.degrees(1.0))
HEADER = ("from", "to", "x mm", "y mm", "z mm", "apart mm", "turned deg")
"""Of :func:`pair_cells`."""


def cameras_table(results: Sequence[Calibration]) -> str:
    """Return where each camera sits in the one before it in name, robot by robot; empty without several cameras."""
    rows = [[shortened(c.robot, 12), *pair_cells(pair)] for c in results if c.rig is not None for pair in c.rig.pairs]
    return table(["cameras", *HEADER], rows) if rows else ""


def pair_cells(pair: CameraPair) -> tuple[str, ...]:
    """Return a pair's cameras, the place of the second in the first's frame, its distance and turn, with sigmas."""
    t, cov = pair.T_a_b[:3, 3], pair.covariance
    apart, along = _length(t, cov[3:, 3:])
    turned, about = _length(log_so3(pair.T_a_b[:3, :3]), cov[:3, :3])
    cells = [_with_sigma(1e3 * v, 1e3 * s) for v, s in zip(t, np.sqrt(np.diag(cov))[3:], strict=True)]
    return (
        shortened(pair.a, 14),
        shortened(pair.b, 14),
        *cells,
        _with_sigma(1e3 * apart, 1e3 * along),
        _with_sigma(turned * _DEG, about * _DEG),
    )


def _length(v: Array, cov: Array) -> tuple[float, float]:
    """Return the length of a vector (3,), and its standard deviation."""
    length = float(np.linalg.norm(v))
    along = v / length if length > 0 else np.zeros(3)
    return length, float(np.sqrt(max(float(along @ cov @ along), 0.0)))


def _with_sigma(value: float, sigma: float) -> str:
    if not (isfinite(sigma) and sigma > 0):
        return f"{value:.2f}"
    places = min(max(0, 1 - int(np.floor(np.log10(sigma)))), 4)
    return f"{value:.{places}f} ± {sigma:.{places}f}"
