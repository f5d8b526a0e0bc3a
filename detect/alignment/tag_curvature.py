"""Corners of tags that were aligned under one lens as a better lens has them: lenses curve the edges of tags.

Alignment takes a tag's edges for straight on the chart that a roughly known lens makes about it. On a better lens's
chart the edges that it aligned lie displaced by a small field; the homography that follows this field best is what
alignment would have found there. Small homographies add eight fields to a place (x, y): constant, linear, ``x (x, y)``
and ``y (x, y)``. Only displacements across an edge are seen. In coordinates of the tag both are the same for all tags,
so that the least squares are solved once.
"""

from functools import cache

import numpy as np

from boxcal.detect.alignment.homography import from_square
from boxcal.detect.alignment.radial_camera import A1, square, tangential, undistort_locally, unsquare
from boxcal.target.arrays import Array

MODULES = 8
"""Modules along a side at whose edges the field is taken; it is as smooth in tags with others."""
INNER_EDGES = 0.5
"""Fraction of the edges between modules inside a tag where black meets white; at the border all do."""
ORDINARY = 0.2
"""Lenses whose a1 is larger are fisheyes: there tangential terms stand for what three radial terms leave, not for a
decentred lens, and tell no curvature."""
_STEPS = np.array([0.0, 0.5, 1.0])
_PLACES = np.stack(np.meshgrid(_STEPS, _STEPS), -1).reshape(-1, 2)
_CORNERS = np.array([0, 2, 8, 6])
"""Which of the nine places are the corners."""


def under_lens(lens: Array, better: Array, corners_px: Array) -> Array:
    """Return corners (N, 4, 2), px, aligned under a lens, as they would have been aligned under a better one.

    The better lens counts with its tangential terms, which alignment does not know.
    """
    if len(corners_px) == 0:
        return corners_px
    middle = corners_px.mean(axis=1)
    seen = _on_tag(from_square(1.0, corners_px))
    charts = np.column_stack([middle, np.ones(len(middle))])
    straight = seen + _tangential(better, seen) - _tangential(better, middle)[:, None]
    field = undistort_locally(better, charts, straight) - undistort_locally(lens, charts, seen)
    along = 0.5 * (corners_px[:, 1:3] - corners_px[:, [0, 3]]).sum(axis=1)
    down = 0.5 * (corners_px[:, 2:] - corners_px[:, [1, 0]]).sum(axis=1)
    A = np.stack([along, down], axis=-1)
    on_tag = np.linalg.solve(A, field.transpose(0, 2, 1)).transpose(0, 2, 1)
    followed = (on_tag.reshape(len(middle), -1) @ _followed().T).reshape(-1, 4, 2)
    moved = followed @ A.transpose(0, 2, 1) - field[:, _CORNERS]
    return np.asarray(corners_px + np.where(np.isfinite(moved), moved, 0.0))


def _on_tag(H: Array) -> Array:
    """Return where homographies (N, 8) of the unit square have the nine places, (N, 9, 2)."""
    x, y = _PLACES.T
    h = H.T[..., None]
    w = h[6] * x + h[7] * y + 1
    return np.stack([(h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w], -1)


def _tangential(lens: Array, uv_px: Array) -> Array:
    """Return what the tangential terms add to pixels (..., 2), nothing under a fisheye's lens."""
    if abs(lens[A1]) > ORDINARY:
        return np.zeros_like(uv_px)
    return unsquare(lens, tangential(lens, square(lens, uv_px - lens[:2])))


@cache
def _followed() -> Array:
    """Return the matrix (8, 18) from a field at the nine places to the best small homography's at the corners."""
    lines, middles = np.arange(MODULES + 1) / MODULES, (np.arange(MODULES) + 0.5) / MODULES
    first, second = (a.ravel() for a in np.meshgrid(lines, middles, indexing="ij"))
    edges = np.concatenate([np.column_stack([first, second]), np.column_stack([second, first])])
    across = np.repeat(np.eye(2), len(first), axis=0)
    weight = np.tile(np.where((first == 0) | (first == 1), 1.0, INNER_EDGES), 2)[:, None]
    fields = np.einsum("ei,eik->ek", across, small_homographies(edges))
    solved = np.linalg.solve(fields.T @ (weight * fields), (weight * fields).T)
    shape = _quadratic(edges[:, 1])[:, :, None] * _quadratic(edges[:, 0])[:, None, :]
    seen = (shape.reshape(-1, 9)[:, :, None] * across[:, None, :]).reshape(-1, 18)
    return np.asarray(small_homographies(_PLACES[_CORNERS]).reshape(8, 8) @ solved @ seen)


def _quadratic(t: Array) -> Array:
    """Return the weights (P, 3) of values at 0, 1/2 and 1 in the parabola through them, at t (P,)."""
    return np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=-1)


def small_homographies(places: Array) -> Array:
    """Return the eight fields of small homographies at places (P, 2) of a tag, (P, 2, 8)."""
    x, y = (places - 0.5).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    along = [one, x, y, zero, zero, zero, x * x, x * y]
    down = [zero, zero, zero, one, x, y, x * y, y * y]
    return np.stack([np.stack(along, -1), np.stack(down, -1)], axis=1)
