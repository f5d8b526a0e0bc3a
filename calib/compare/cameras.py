"""Difference of two calibrations of a robot with several cameras: pair by pair."""

from collections.abc import Iterator

import numpy as np
from scipy.special import gammaincc

from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.rig import CameraPair


def pair_lines(a: Calibration, b: Calibration) -> Iterator[str]:
    """Yield how each pair of cameras that both calibrations have differs, and the chance of that."""
    if a.rig is None or b.rig is None:
        return
    for pair in a.rig.pairs:
        if {pair.a, pair.b} <= set(b.rig.names):
            yield _line(pair, b.rig.pair(pair.a, pair.b))
    missing = sorted(set(a.rig.names) ^ set(b.rig.names))
    if missing:
        yield f"cameras that only one of them has: {', '.join(missing)}"


def _line(a: CameraPair, b: CameraPair) -> str:
    """Return the difference of a pair's transform, B less A; independent drives are assumed."""
    turned = log_so3(a.T_a_b[:3, :3].T @ b.T_a_b[:3, :3])
    moved = b.T_a_b[:3, 3] - a.T_a_b[:3, 3]
    change, cov = np.concatenate([turned, moved]), a.covariance + b.covariance
    text = (
        f"camera {a.b} against {a.a}: moved by {1e3 * np.linalg.norm(moved):.2f} mm, turned by "
        f"{np.degrees(np.linalg.norm(turned)):.3f} deg"
    )
    if not np.all(np.isfinite(cov)) or not np.all(np.diag(cov) > 0):
        return f"{text}; chance cannot be judged"
    sigma = np.sqrt(np.diag(cov))
    unit = change / sigma
    chi2 = float(unit @ np.linalg.solve(cov / np.outer(sigma, sigma), unit))
    return f"{text}; chance alone moves and turns it as much with probability {gammaincc(3, chi2 / 2):.2g}"
