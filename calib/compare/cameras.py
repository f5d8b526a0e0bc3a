"""Difference of two calibrations of a robot with several cameras: camera by camera, and pair by pair."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from boxcal.calib.compare.difference import Difference, difference
from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.each_camera import each_camera
from boxcal.calib.results.rig import CameraPair
from boxcal.detect.log.safe_text import printable

_LARGEST = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Further:
    """Difference of one further camera, or of one pair of cameras.

    Attributes
    ----------
    text
        What differs, one line.
    p_value
        Chance of a difference as large without any change; None where that cannot be judged.
    """

    text: str
    p_value: float | None


def same_first(a: Calibration, b: Calibration) -> tuple[Calibration, Calibration]:
    """Return both calibrations as of one camera: that of A's first, also where another camera is B's first.

    Raises
    ------
    CalibError
        If B has no camera of that name.
    """
    if a.rig is None or b.rig is None or a.rig.names[0] == b.rig.names[0]:
        return a, b
    name, of_b = a.rig.names[0], _by_name(b)
    if name not in of_b:
        raise CalibError(
            f"A is of camera {printable(name)}, B of {printable(', '.join(of_b))}: two calibrations of one camera are "
            "needed",
            remedy="calibrate both with the same --camera-topic",
        )
    return a, of_b[name]


def further(a: Calibration, b: Calibration) -> list[Further]:
    """Return how each further camera, and each pair of cameras, that both calibrations have differs."""
    if a.rig is None or b.rig is None:
        return []
    of_a, of_b = _by_name(a), _by_name(b)
    common = [name for name in of_a if name in of_b]
    found = [_camera(name, of_a[name], of_b[name]) for name in common[1:]]
    return found + [_pair(pair, b.rig.pair(pair.a, pair.b)) for pair in a.rig.pairs if {pair.a, pair.b} <= set(common)]


def only_in_one(a: Calibration, b: Calibration) -> Iterator[str]:
    """Yield a line on cameras that only one of the calibrations has."""
    names = [set(c.rig.names) if c.rig is not None else set[str]() for c in (a, b)]
    missing = sorted(names[0] ^ names[1])
    if missing:
        yield f"cameras that only one of them has: {', '.join(missing)}"


def chance_of_all(first: float | None, others: Sequence[Further]) -> float | None:
    """Return the chance of differences as large anywhere (Bonferroni); None where the first cannot be judged."""
    if first is None:
        return None
    known = [first, *(o.p_value for o in others if o.p_value is not None)]
    return min(1.0, len(known) * min(known))


def _by_name(c: Calibration) -> dict[str, Calibration]:
    return dict(zip(c.rig.names, each_camera(c), strict=False)) if c.rig is not None else {}


def _camera(name: str, a: Calibration, b: Calibration) -> Further:
    """Return the difference of one camera: its model, and where it sits on the robot."""
    try:
        found = difference(a, b)
    except CalibError as error:
        return Further(text=f"camera {name}: {error}", p_value=None)
    seen = f"a point {found.ground.distance:g} m away appears {found.ground.projection_mean_px:.2f} px away in the mean"
    if found.p_value is None or found.sigma is None:
        return Further(text=f"camera {name}: {seen}; chance cannot be judged: {found.why_not}", p_value=None)
    text = (
        f"camera {name}: {seen}; chi-square {found.chi2:.1f} of {found.dof} parameters, chance alone differs as much "
        f"with probability {found.p_value:.2g}; largest, in sigmas: {_largest(found, found.sigma)}"
    )
    return Further(text=text, p_value=found.p_value)


def _largest(found: Difference, sigma: np.ndarray) -> str:
    z = np.nan_to_num(np.abs(found.values / sigma))
    return ", ".join(f"{ORDER[i]} {z[i]:.1f}" for i in np.argsort(-z)[:_LARGEST])


def _pair(a: CameraPair, b: CameraPair) -> Further:
    """Return the difference of a pair's transform, B less A; independent drives are assumed."""
    turned = log_so3(a.T_a_b[:3, :3].T @ b.T_a_b[:3, :3])
    moved = b.T_a_b[:3, 3] - a.T_a_b[:3, 3]
    change, cov = np.concatenate([turned, moved]), a.covariance + b.covariance
    text = (
        f"camera {a.b} against {a.a}: moved by {1e3 * np.linalg.norm(moved):.2f} mm, turned by "
        f"{np.degrees(np.linalg.norm(turned)):.3f} deg"
    )
    if not np.all(np.isfinite(cov)) or not np.all(np.diag(cov) > 0):
        return Further(text=f"{text}; chance cannot be judged", p_value=None)
    sigma = np.sqrt(np.diag(cov))
    unit = change / sigma
    p_value = float(gammaincc(3, float(unit @ np.linalg.solve(cov / np.outer(sigma, sigma), unit)) / 2))
    return Further(
        text=f"{text}; chance alone moves and turns it as much with probability {p_value:.2g}", p_value=p_value
    )
