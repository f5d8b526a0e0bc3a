"""Cameras of robots and the transforms between them as plain tables."""

from collections.abc import Sequence
from math import isfinite

import numpy as np

from boxcal.calib.console.judgement import wrapped
from boxcal.calib.console.tables import shortened, table
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.rig import CameraPair

_DEG = float(np.degrees(1.0))
HEADER = ("from", "to", "x mm", "y mm", "z mm", "apart mm", "turned deg")
"""Of :func:`pair_cells`."""


def cameras_table(results: Sequence[Calibration]) -> str:
    """Return where each camera sits in the one before it in name, robot by robot; empty without several cameras."""
    rows = [[shortened(c.robot, 12), *pair_cells(pair)] for c in results if c.rig is not None for pair in c.rig.pairs]
    return table(["cameras", *HEADER], rows) if rows else ""


def of_further_cameras(c: Calibration) -> list[str]:
    """Return lines on each camera after a robot's first whose verdict is not good for reasons of its own."""
    if c.rig is None:
        return []
    said = " ".join(cause.text for cause in c.verdict.causes) if c.verdict is not None else ""
    return [
        line
        for camera in c.rig.cameras[1:]
        if camera.why and camera.why != said
        for line in wrapped("  ", f"camera {camera.name} is {camera.verdict}: {camera.why}")
    ]


def pair_cells(pair: CameraPair) -> tuple[str, ...]:
    """Return a pair's cameras, the place of the second in the first's frame, its distance and turn, with sigmas."""
    t, (apart, along), (turned, about) = pair.T_a_b[:3, 3], pair.distance, pair.angle
    cells = [_with_sigma(1e3 * v, 1e3 * s) for v, s in zip(t, np.sqrt(np.diag(pair.covariance))[3:], strict=True)]
    return (
        shortened(pair.a, 14),
        shortened(pair.b, 14),
        *cells,
        _with_sigma(1e3 * apart, 1e3 * along),
        _with_sigma(turned * _DEG, about * _DEG),
    )


def _with_sigma(value: float, sigma: float) -> str:
    if not (isfinite(sigma) and sigma > 0):
        return f"{value:.2f}"
    places = min(max(0, 1 - int(np.floor(np.log10(sigma)))), 4)
    return f"{value:.{places}f} ± {sigma:.{places}f}"
