"""Sharpness of a box's shape: what is known of its landmarks relative to each other, and of its size as a whole."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import Target, make_target
from boxcal.target.measure.refined_shape import SHAPE, RefinedShape

_STEP = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Sharpness:
    """Standard deviations of a box's landmarks.

    Attributes
    ----------
    shape : m
        Root mean square over the landmarks, of what is left of their errors once the box is moved, turned and scaled
        to fit best.
    scale
        Relative, of the size of the box as a whole.
    """

    shape: float
    scale: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ruler:
    """Measure of how sharply covariances of a shape's unknowns determine a box.

    Attributes
    ----------
    square : (m, m), m^2
        Mean square of the landmarks' errors by the unknowns' own, the box moved, turned and scaled to fit best.
    growth : (m,)
        Relative growth of the whole box by the unknowns.
    """

    square: Array
    growth: Array

    def of(self, cov: Array) -> Sharpness:
        """Return the sharpness of a covariance (m, m) of the unknowns."""
        return Sharpness(
            shape=float(np.sqrt(np.sum(self.square * cov))), scale=float(np.sqrt(self.growth @ cov @ self.growth))
        )

    def error(self, difference: Array) -> float:
        """Return the root mean square error of the landmarks, m, for errors of the unknowns (m,)."""
        return float(np.sqrt(difference @ self.square @ difference))


def ruler(target: Target, names: Sequence[str]) -> Ruler:
    """Return the measure for some of a shape's unknowns, about a target."""
    by_shape = landmark_jacobian(target, names)
    free, growth = similarity_free(target)
    left = free(by_shape)
    return Ruler(square=left.T @ left / (len(left) / 3), growth=growth @ by_shape)


def similarity_free(target: Target) -> tuple[Callable[[Array], Array], Array]:
    """Return what frees errors of a target's landmarks (3 L, ...) of motion and growth of the whole box, and growth.

    The growth is relative: the product of (3 L,) with the errors.
    """
    moves = similarities(target)
    Q, _ = np.linalg.qr(moves)
    grown = moves[:, -1]
    return (lambda errors: np.asarray(errors - Q @ (Q.T @ errors))), grown / float(grown @ grown)


def similarities(target: Target) -> Array:
    """Return how a target's landmarks move with the whole box, (3 L, 7): translations, rotations, growth."""
    p = target.tag_corners.reshape(-1, 3)
    p = p - p.mean(axis=0)
    shifts = [np.tile(axis, len(p)) for axis in np.eye(3)]
    turns = [np.cross(axis, p).ravel() for axis in np.eye(3)]
    return np.stack([*shifts, *turns, p.ravel()], axis=1)


def landmark_jacobian(target: Target, names: Sequence[str]) -> Array:
    """Return the derivatives of all landmarks' coordinates by some of a shape's unknowns, (3 L, m), by differences."""
    values = np.zeros(len(SHAPE)) if target.refined is None else target.refined.values
    columns = []
    for name in names:
        step = _STEP * (np.arange(len(SHAPE)) == SHAPE.index(name))
        ahead, behind = (_landmarks(target, values + sign * step) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * _STEP))
    return np.stack(columns, axis=1)


def _landmarks(target: Target, values: Array) -> Array:
    nothing = RefinedShape(values=values, cov=np.zeros((len(SHAPE), len(SHAPE))), robots=1)
    return make_target(target.box, target.measured, nothing).tag_corners.ravel()
