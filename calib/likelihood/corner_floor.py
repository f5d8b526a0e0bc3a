"""Error of corners that their own covariances leave out, as a variance component.

A corner's covariance states how well its image determines it. What the image's model leaves out (how an edge was
sampled, an uneven print) is alike for large and small tags: a floor, in px, that is added to all covariances. It comes
from the residuals, under a t distribution, so that wrong corners do not make it.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from boxcal.calib.geometry.two_by_two import inverses, products
from boxcal.calib.likelihood.levenberg_marquardt import Linearization
from boxcal.calib.likelihood.problem import Problem, whitening
from boxcal.target.arrays import Array

_FREEDOM = 8.0
"""Degrees of freedom of the t distribution."""
_LEVELS = 20
_CORNERS = 2000
"""Number of corners that determine the floor to some per cent; of more, one in a few is taken."""
_LARGEST_PX = 1.0
_SMALLEST_FRACTION = 0.25
"""The least floor that is tried, in standard deviations of the best corner."""
_CLEARLY = 4.0
"""Gain in log likelihood from which on a floor is added; among corners that are alike a floor looks like a scale."""
_FIXED_POINT = 4
_ALIKE = 0.1
"""Relative change of a floor below which the equations are kept."""


def corner_floor(problem: Problem, at: Linearization) -> float:
    """Return the floor of all corners' errors, px; 0 where the residuals do not show one."""
    some = slice(None, None, 1 + len(problem.uv_px) // _CORNERS)
    stated = problem.stated_px2[some]
    x, y = products(inverses(problem.whiten[some]), at.residual_px[some]).T
    errors = x * x, 2 * x * y, y * y
    a, b, d = stated[:, 0, 0], stated[:, 0, 1], stated[:, 1, 1]
    least = float(np.sqrt(np.min(np.minimum(a, d))))
    floors = np.concatenate([[0.0], np.geomspace(_SMALLEST_FRACTION * least, max(_LARGEST_PX, least), _LEVELS)])
    loss = np.full(len(floors), np.inf)

    def look(at: Iterable[int]) -> int:
        for k in at:
            loss[k] = _loss(errors, (a + floors[k] ** 2, b, d + floors[k] ** 2))
        return int(np.argmin(loss))

    coarse = look([0, *range(1, len(floors), 2)])
    best = look(k for k in (coarse - 1, coarse + 1) if 0 < k < len(floors))
    if not np.isfinite(loss[0]) or loss[0] - loss[best] < _CLEARLY:  # errors that are no numbers, or zero, show none
        return 0.0
    if best in {1, len(floors) - 1}:
        return float(floors[best])
    before, here, after = loss[best - 1 : best + 2]
    shift = 0.5 * (before - after) / (before - 2 * here + after)
    return float(floors[best] * (floors[best + 1] / floors[best]) ** shift)


def _loss(products: tuple[Array, Array, Array], cov: tuple[Array, Array, Array]) -> float:
    """Return the negative log likelihood of errors under covariances of one unknown scale.

    Parameters
    ----------
    products : (L,) each
        Of errors x along u and y along v: ``x x``, ``2 x y`` and ``y y``.
    cov : (L,) each
        Variance of x, covariance, and variance of y.
    """
    (xx, xy, yy), (a, b, d) = products, cov
    det = a * d - b * b
    square = (d * xx - b * xy + a * yy) / det
    scale = float(np.partition(square, len(square) // 2)[len(square) // 2]) / (2 * np.log(2.0))
    if not scale > 0:
        return np.inf
    for _ in range(_FIXED_POINT):
        scale *= (_FREEDOM + 2) / 2 * float(np.mean(square / (_FREEDOM * scale + square)))
    tail = (_FREEDOM + 2) * np.log1p(square / (scale * _FREEDOM))
    return 0.5 * float(np.sum(np.log(det) + tail)) + len(square) * float(np.log(scale))


def differs(problem: Problem, floor_px: float) -> bool:
    """Return whether a floor is another one than the problem has."""
    return abs(floor_px - problem.floor_px) > _ALIKE * max(floor_px, problem.floor_px)


def with_floor(problem: Problem, floor_px: float) -> Problem:
    """Return the problem with corners whose errors have a floor, px, besides what their covariances state."""
    whiten, sigma_px = whitening(problem.stated_px2 + floor_px**2 * np.eye(2))
    return replace(problem, whiten=whiten, sigma_px=sigma_px, floor_px=floor_px)
