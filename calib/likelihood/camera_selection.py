"""Choice of the camera model by an information criterion, from one solution.

Brown's model with five coefficients holds the paper's one and is held by the rational one, so one solution judges all
three: what its further coefficients lower the sum of squares by (a Wald test), and what three more would (a score
test). Only a wide field of view, where the fisheye model is another one altogether, costs a solution of its own.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from boxcal.calib.likelihood.camera_score import CameraScore
from boxcal.calib.likelihood.fit import Fit, log_noise
from boxcal.calib.likelihood.levenberg_marquardt import linearize, moved
from boxcal.calib.likelihood.problem import Problem, with_kind
from boxcal.calib.likelihood.slip_profile import fixed_profile
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel, further_names, unproject

_TIE = 4.0
"""Where a fisheye and Brown's model fit a wide field alike, the fisheye is taken: it goes on as lenses do."""
WIDE = 0.8
"""Tangent of the angle off the axis from which on corners can tell a fisheye from a polynomial: 39 deg."""
PER_COEFFICIENT, _PER_RATIONAL = 2.4, 5.4
"""What a coefficient that is not needed lowers the sum of squares by at most, in all but one of twenty drives.

The 95 % quantile of chi-square over its freedom, for four coefficients. Schwarz' ln(n) would leave out coefficients
that are five standard deviations from zero, and bias all others by as much. The rational model's are charged the
99.9 % quantile of their three: they change little inside the image that Brown's do not, and much at its edge.
"""


Solve = Callable[[CameraKind, Fit | None], Fit]
"""Solves with a camera model, from scratch or from another solution of the same data."""


def choose_camera(solve: Solve, image_size: tuple[int, int]) -> tuple[Fit, tuple[CameraScore, ...]]:
    """Return the solution with the camera model that the images ask for, and how all did, the best first.

    Parameters
    ----------
    solve
        How to solve.
    image_size : px
        A model must be invertible all over it.
    """
    brown = solve(CameraKind.BROWN, None)
    lowered = {CameraKind.BROWN: 0.0, CameraKind.RADIAL: -_wald(brown), CameraKind.RATIONAL: _rational(brown)}
    fits = {CameraKind.BROWN: brown}
    if field_of_view(brown) > WIDE:
        fisheye = fits[CameraKind.FISHEYE] = solve(CameraKind.FISHEYE, None)
        lowered[CameraKind.FISHEYE] = lowered_by(fisheye, brown)
        if lowered[CameraKind.FISHEYE] > 0:  # what lies far from Brown's solution is not judged by it
            rational = fits[CameraKind.RATIONAL] = solve(CameraKind.RATIONAL, brown)
            lowered[CameraKind.RATIONAL] = lowered_by(rational, brown)
    counts = {kind: 1 + len(further_names(kind)) for kind in lowered}
    charged = {kind: _charge(kind, counts[kind]) - lowered[kind] for kind in lowered}
    if CameraKind.FISHEYE in charged:
        charged[CameraKind.FISHEYE] -= _TIE
    for kind in sorted(charged, key=lambda kind: charged[kind]):
        fit = fits.get(kind) or solve(kind, brown)
        # Only a rational model can have a pole between the corners; refuse it, not what is needed.
        if kind is not CameraKind.RATIONAL or invertible(kind, fit.state.lens, image_size):
            break
        del charged[kind]
    best = min(charged.values())
    scores = [
        CameraScore(kind=kind, coefficients=counts[kind], score=charged[kind] - best)
        for kind in sorted(charged, key=lambda kind: charged[kind])
    ]
    return fit, tuple(scores)


def field_of_view(fit: Fit) -> float:
    """Return the tangent of the largest angle off the axis at which a corner was seen."""
    camera = CameraModel.from_values(fit.problem.lens, fit.state.lens)
    xy = unproject(camera, fit.problem.uv_px)
    radius = np.hypot(xy[:, 0], xy[:, 1])
    return float(np.max(radius[np.isfinite(radius)], initial=0.0)) if np.all(np.isfinite(radius)) else np.inf


def invertible(kind: CameraKind, values: Array, image_size: tuple[int, int]) -> bool:
    """Return whether every pixel has a direction: no fold, and no pole of a rational model, inside the image."""
    w, h = image_size
    u, v = np.meshgrid(np.linspace(0, w - 1, 9), np.linspace(0, h - 1, 7))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    return bool(np.all(np.isfinite(unproject(CameraModel.from_values(kind, values), uv))))


def lowered_by(fit: Fit, other: Fit) -> float:
    """Return how much lower one solution's sum of squares of the corners is than another's, noise scale estimated."""
    return 2 * (log_noise(other) - log_noise(fit))


def with_camera(problem: Problem, state: State, kind: CameraKind) -> State:
    """Return a state of another camera model in place of Brown's: coefficients that it has not are left away."""
    old = dict(zip(further_names(problem.lens), state.lens[5:], strict=True))
    further = [old.get(name, 0.0) for name in further_names(kind)]
    return replace(state, lens=np.concatenate([state.lens[:5], further]))


def without_further(fit: Fit) -> State:
    """Return where the other unknowns go if the further coefficients of a solution's camera model are held at zero.

    To first order: nothing is linearized again, and a solution with fewer coefficients begins near its end.
    """
    rows, s = fit.problem.extras, fit.profile.solution.at(fit.profile.best)
    d_shared = -s.cov[:, rows] @ np.linalg.solve(s.cov[rows, rows], fit.state.lens[5:])
    d_stops = -s.Y @ d_shared
    d_local = -(s.eliminated.by_shared @ d_shared) - np.einsum("pqk,pk->pq", s.eliminated.by_chain, d_stops)
    return moved(fit.problem, fit.state, fit.components, (d_shared, d_stops, d_local))


def _wald(fit: Fit) -> float:
    """Return how much worse the sum of squares would be without the coefficients beyond the first."""
    rows = fit.problem.extras
    values = fit.state.lens[5:]
    return float(values @ np.linalg.solve(fit.cov[rows, rows], values))


def _rational(fit: Fit) -> float:
    """Return how much better the sum of squares would be with a rational model's three further coefficients."""
    problem = fit.problem
    wider = with_kind(problem, CameraKind.RATIONAL)
    new = slice(problem.extras.stop, wider.extras.stop)
    wider.prior[new] = _FREE
    state = with_camera(problem, fit.state, CameraKind.RATIONAL)
    profile = fixed_profile(wider, linearize(wider, state, fit.weights), fit.components, fit.weights)
    step, cov = profile.solution.d_shared[0, new], profile.solution.cov[0, new, new]
    return float(step @ np.linalg.solve(cov, step))


_FREE = 10.0
"""Prior standard deviation of k4 to k6: wider than any lens."""


def _charge(kind: CameraKind, coefficients: int) -> float:
    if kind is CameraKind.RATIONAL:
        brown = 1 + len(further_names(CameraKind.BROWN))
        return PER_COEFFICIENT * brown + _PER_RATIONAL * (coefficients - brown)
    return PER_COEFFICIENT * coefficients
