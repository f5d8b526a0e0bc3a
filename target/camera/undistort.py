"""Undistortion: normalised coordinates from distorted ones, or NaN; never a wrong answer."""

from functools import lru_cache

import numpy as np

from boxcal.target.arrays import Array, Mask
from boxcal.target.camera.distortion import CameraKind, distort

_WIDEST = 1e3
"""Tangent of the widest angle off the axis that is searched (89.94 deg); rays beyond it count as unseen."""
_REAL = 1e-9
"""Imaginary part, relative, up to which a root counts as real: rounding."""
_ROUNDS = 60
"""Steps of the safeguarded Newton method; halving alone reaches rounding in 60."""
_CLOSE = 1e-11
"""How near the distortion of an answer must come to what was asked, relative to one plus the distorted radius."""
_LAST = 1e-12
"""Step of Newton's method, relative to one plus the radius, after which the next would be below rounding."""
_STEP = 0.3
"""Longest step of Newton's method in the plane, normalised coordinates."""


def undistort(kind: CameraKind, k: Array, xy_d: Array) -> Array:
    """Return the normalised coordinates (N, 2) that a camera model distorts to ``xy_d`` (N, 2), NaN where none.

    The radial part is solved on the interval from the axis to where its growth ends (known exactly: a root of a
    polynomial), where it is monotone, so that the safeguarded Newton method cannot fail. Decentring is added by
    Newton's method in the plane from there. Every answer is checked by distorting it.
    """
    limit = radius_limit(kind, k)
    rho_d = np.hypot(xy_d[:, 0], xy_d[:, 1])
    rho, reached = _radius(kind, k, rho_d, limit)
    xy = xy_d * np.where(rho_d > 0, rho / np.where(rho_d > 0, rho_d, 1.0), 1.0)[:, None]
    if _decentred(kind, k):
        xy, reached = _newton(kind, k, xy_d, xy)
        reached &= np.hypot(xy[:, 0], xy[:, 1]) <= limit
    return np.where(reached[:, None], xy, np.nan)


def radius_limit(kind: CameraKind, k: Array) -> float:
    """Return the tangent of the angle off the axis up to which the radial distortion grows; infinite if it always does.

    It ends where ``d(rho g)/d rho`` is zero or at a pole of a rational model, whichever comes first; both are roots of
    polynomials in rho^2 (a fisheye: in the square of the angle, and never beyond a right angle).
    """
    return _radius_limit(kind, tuple(float(c) for c in k))


@lru_cache(maxsize=64)
def _radius_limit(kind: CameraKind, k: tuple[float, ...]) -> float:
    if kind is CameraKind.FISHEYE:
        slope = np.polynomial.Polynomial([1.0, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]])
        angle = np.sqrt(_first_positive_root(slope))
        return float(np.tan(angle)) if angle < np.pi / 2 else np.inf
    padded = np.pad(k, (0, 8 - len(k)))
    top = np.polynomial.Polynomial([1.0, padded[0], padded[1], padded[4]])
    bottom = np.polynomial.Polynomial([1.0, padded[5], padded[6], padded[7]])
    s = np.polynomial.Polynomial([0.0, 1.0])
    slope = top * bottom + 2 * s * (top.deriv() * bottom - top * bottom.deriv())
    return float(np.sqrt(min(_first_positive_root(slope), _first_positive_root(bottom))))


def _first_positive_root(polynomial: np.polynomial.Polynomial) -> float:
    """Return the least positive root of a polynomial that is 1 at zero: the inverse of the reversed one's largest.

    The reversed polynomial begins with 1, so that coefficients near zero do no harm.
    """
    inverse = np.roots(polynomial.coef)
    real = inverse[np.abs(inverse.imag) <= _REAL * np.abs(inverse)].real
    largest = float(real.max(initial=0.0))
    return 1 / largest if largest > _WIDEST**-2 else np.inf


def _decentred(kind: CameraKind, k: Array) -> bool:
    return kind in {CameraKind.BROWN, CameraKind.RATIONAL} and bool(k[2] != 0 or k[3] != 0)


def _radius(kind: CameraKind, k: Array, rho_d: Array, limit: float) -> tuple[Array, Mask]:
    """Return the undistorted radii (N,) of distorted ones without decentring, and which of them exist."""
    radial = k.copy()
    if _decentred(kind, k):
        radial[2:4] = 0.0
    highest = min(limit * (1 - 1e-12), _WIDEST)
    low, high = np.zeros_like(rho_d), np.full_like(rho_d, highest)
    top = _radial(kind, radial, np.array([highest]))[0][0]
    reached = np.isfinite(rho_d) & (rho_d <= top if np.isfinite(top) else True)
    goal = np.where(reached, rho_d, 0.0)
    rho = np.minimum(goal, highest / 2)
    at = np.arange(len(rho))  # those still sought
    for _ in range(_ROUNDS):
        here = rho[at]
        value, slope = _radial(kind, radial, here)
        error = value - goal[at]
        above = error > 0
        high[at], low[at] = np.where(above, here, high[at]), np.where(above, low[at], here)
        newton = here - error / np.where(slope > 0, slope, 1.0)
        inside = (slope > 0) & (newton >= low[at]) & (newton <= high[at])
        moved = np.where(inside, newton, (low[at] + high[at]) / 2)
        rho[at] = moved
        at = at[np.abs(moved - here) > np.where(inside, _LAST, 4e-16) * (1 + here)]
        if not len(at):
            break
    return rho, reached


def _radial(kind: CameraKind, k: Array, rho: Array) -> tuple[Array, Array]:
    """Return the distorted radius of (rho, 0), and its derivative."""
    (xd, _), (xdx, _, _, _), _ = distort(kind, k, rho, np.zeros_like(rho))
    return xd, xdx


def _newton(kind: CameraKind, k: Array, xy_d: Array, xy: Array) -> tuple[Array, Mask]:
    """Return coordinates by Newton's method in the plane, and which of them are answers."""
    for _ in range(_ROUNDS):  # steps into a pole give no number: such points are found by the check at the end
        error, (xx, xy_, yx, yy) = _planar_error(kind, k, xy_d, xy)
        det = xx * yy - xy_ * yx
        safe = np.where(np.abs(det) > 1e-9, det, 1.0)
        step = np.stack([yy * error[:, 0] - xy_ * error[:, 1], xx * error[:, 1] - yx * error[:, 0]], axis=1)
        step = np.nan_to_num(np.clip(step / safe[:, None], -_STEP, _STEP))
        xy = xy + step
        if not np.any(np.abs(step) > 4e-16 * (1 + np.abs(xy))):
            break
    error, (xx, xy_, yx, yy) = _planar_error(kind, k, xy_d, xy)
    close = np.max(np.abs(error), axis=1) <= _CLOSE * (1 + np.hypot(xy_d[:, 0], xy_d[:, 1]))
    return xy, close & (xx * yy - xy_ * yx > 0)


def _planar_error(
    kind: CameraKind, k: Array, xy_d: Array, xy: Array
) -> tuple[Array, tuple[Array, Array, Array, Array]]:
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        (xd, yd), parts, _ = distort(kind, k, xy[:, 0], xy[:, 1])
    return xy_d - np.stack([xd, yd], axis=1), parts
