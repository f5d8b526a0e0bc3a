"""Corners of tags that were aligned under one lens as a better lens has them: lenses curve the edges of tags.

Alignment takes a tag's edges for straight on the chart that a roughly known lens makes about it. On a better lens's
chart the edges that it aligned lie displaced by a small field; the homography that follows this field best is what
alignment would have found there. Small homographies add eight fields to a place (x, y): constant, linear, ``x (x, y)``
and ``y (x, y)``. Only displacements across an edge are seen. In coordinates of the tag both are the same for all tags,
so that the least squares are solved once.
"""

from functools import cache

import numpy as np

from boxcal.detect.alignment.backend import backend
from boxcal.detect.alignment.homography import from_square
from boxcal.detect.alignment.radial_camera import A1, P1, P2, square, tangential, unsquare
from boxcal.detect.alignment.tag_shape import sides
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
_NEXT = np.array([1, 2, 3, 0])
_CORNERS = np.array([0, 2, 8, 6])
"""Which of the nine places are the corners."""


def under_lens(lens: Array, better: Array, corners_px: Array, followed: Array | None = None) -> Array:
    """Return corners (N, 4, 2), px, aligned under a lens, as they would have been aligned under a better one.

    The better lens counts with its tangential terms, which alignment does not know. Tags are taken as seen all round,
    or as ``followed`` (N, 8, 18) says, which :func:`followed_in_part` returns.
    """
    if len(corners_px) == 0:
        return corners_px
    middle = 0.25 * corners_px.sum(axis=1)
    seen = _on_tag(from_square(1.0, corners_px))
    charts = np.ones((len(middle), 3))
    charts[:, :2] = middle
    field = _straightened(better, charts, seen) - backend().undistort_locally(lens, charts, seen)
    along, down = sides(corners_px)
    on_tag = _split(field, along, down)
    if followed is None:
        at_corners = (on_tag.reshape(len(middle), -1) @ _followed().T).reshape(-1, 4, 2)
    else:
        at_corners = (followed @ on_tag.reshape(len(middle), -1, 1)).reshape(-1, 4, 2)
    moved = at_corners[..., :1] * along[:, None] + at_corners[..., 1:] * down[:, None] - field[:, _CORNERS]
    return np.asarray(corners_px + np.where(np.isfinite(moved), moved, 0.0))


def sagitta_difference_px(lens: Array, other: Array, corners_px: Array) -> float:
    """Return how far apart two lenses have the middles of tags' edges, seen from the corners (N, 4, 2); at most, px."""
    normalisation = np.ones((len(corners_px), 3))
    normalisation[:, :2] = 0.25 * corners_px.sum(axis=1)
    points = np.empty((len(corners_px), 8, 2))
    points[:, :4] = corners_px
    points[:, 4:] = 0.5 * (corners_px + corners_px[:, _NEXT])
    on_chart = backend().undistort_locally
    apart = on_chart(lens, normalisation, points) - on_chart(other, normalisation, points)
    bent = apart[:, 4:] - 0.5 * (apart[:, :4] + apart[:, _NEXT])
    return float(np.sqrt(np.sum(bent * bent, axis=2).max(initial=0)))


def _split(field: Array, along: Array, down: Array) -> Array:
    """Return a field (N, P, 2) in parts of two vectors (N, 2) each: ``x along + y down``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        per = (1 / (along[:, 0] * down[:, 1] - along[:, 1] * down[:, 0]))[:, None]
        out = np.empty_like(field)
        out[..., 0] = (field[..., 0] * down[:, 1, None] - field[..., 1] * down[:, 0, None]) * per
        out[..., 1] = (field[..., 1] * along[:, 0, None] - field[..., 0] * along[:, 1, None]) * per
    return out


def _straightened(lens: Array, charts: Array, seen: Array) -> Array:
    """Return places (N, P, 2), px, on charts of a lens that has its tangential terms, but for those at the centres."""
    if abs(lens[A1]) > ORDINARY or not (lens[P1] or lens[P2]):
        return np.asarray(backend().undistort_locally(lens, charts, seen))
    middle = charts[:, None, :2]
    places = np.concatenate([seen, middle], axis=1)
    added = unsquare(lens, tangential(lens, square(lens, places - lens[:2])))
    return np.asarray(backend().undistort_locally(lens, charts, seen + added[:, :-1] - added[:, -1:]))


def _on_tag(H: Array, places: Array = _PLACES) -> Array:
    """Return where homographies (N, 8) of the unit square have places (P, 2), or the nine, (N, P, 2)."""
    x, y = places.T
    h = H.T[..., None]
    w = h[6] * x + h[7] * y + 1
    out = np.empty((len(H), len(x), 2))
    out[..., 0], out[..., 1] = (h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w
    return out


def followed_in_part(corners_px: Array, image_size: tuple[int, int]) -> Array:
    """Return what ``_followed`` is of whole tags for tags of which only what lies in the picture is seen.

    Parameters
    ----------
    corners_px : (N, 4, 2), px
    image_size
        Width and height, px.

    Returns
    -------
    (N, 8, 18)
    """
    places, across, weight = _edges()
    uv = _on_tag(from_square(1.0, corners_px), places)
    inside = np.all((uv > -0.5) & (uv < np.array(image_size) - 0.5), axis=2)
    fields = np.einsum("ei,eik->ek", across, small_homographies(places))
    weighted = (weight * inside)[:, None, :] * fields.T
    solved = np.linalg.pinv(weighted @ fields, rcond=1e-9, hermitian=True) @ weighted
    return _at_corners(solved, places, across)


@cache
def _followed() -> Array:
    """Return the matrix (8, 18) from a field at the nine places to the best small homography's at the corners."""
    places, across, weight = _edges()
    fields = np.einsum("ei,eik->ek", across, small_homographies(places))
    solved = np.linalg.solve(fields.T @ (weight[:, None] * fields), fields.T * weight)
    return _at_corners(solved, places, across)


@cache
def _edges() -> tuple[Array, Array, Array]:
    """Return places (E, 2) of edges between modules, the directions (E, 2) across them, and weights (E,)."""
    lines, middles = np.arange(MODULES + 1) / MODULES, (np.arange(MODULES) + 0.5) / MODULES
    first, second = (a.ravel() for a in np.meshgrid(lines, middles, indexing="ij"))
    places = np.concatenate([np.column_stack([first, second]), np.column_stack([second, first])])
    across = np.repeat(np.eye(2), len(first), axis=0)
    return places, across, np.tile(np.where((first == 0) | (first == 1), 1.0, INNER_EDGES), 2)


def _at_corners(solved: Array, places: Array, across: Array) -> Array:
    """Return the matrices (..., 8, 18) from a field at nine places to corners, by homographies (..., 8, E) of edges."""
    shape = _quadratic(places[:, 1])[:, :, None] * _quadratic(places[:, 0])[:, None, :]
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
