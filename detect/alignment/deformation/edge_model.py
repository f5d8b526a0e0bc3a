"""Linear model of a deformed tag: what blocks and corners show of a field that displaces the tag's edges.

Paper that is wrinkled or bowed displaces the edges between black and white by a smooth field. An alignment follows with
the homography that fits the displaced edges best; what is left of the field displaces blocks of the tag beside their
places (:mod:`boxcal.detect.alignment.registration.block_motion`), and its corners. With a Gaussian random field as the
prior, all these have a joint Gaussian distribution that depends on the pattern alone, but for the field's variances.

Coordinates are those of the unit square, (0, 0) a tag's top-left corner, u to the right, v down.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from boxcal.detect.alignment.pattern_edges import CORNERS, pattern_edges
from boxcal.detect.alignment.registration.block_motion import BLOCKS
from boxcal.detect.alignment.tag_curvature import small_homographies
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

LENGTHS = (0.25, 0.4, 0.7, 1.2)
"""Of the smoothing that would make the field of white noise, in sides of a tag; its correlation is
``exp(-r^2 / (4 length^2))``. Three blocks a side do not distinguish shorter ones from noise, nor longer ones from each
other."""
HOMOGRAPHY = 8
CONTRASTS = 2 * BLOCKS**2 - HOMOGRAPHY
"""Combinations of the blocks' displacements that no homography changes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeModel:
    """Covariances of contrasts and corners under fields of unit variance, for each of T patterns.

    Attributes
    ----------
    contrasts : (T, 18, 10)
        Combinations of the displacements (u, v) of nine blocks, in columns.
    cov : (L, 3, T, 18, 18)
        For each of :data:`LENGTHS`: covariance of the ten contrasts and of the corners' eight displacements from the
        fitted homography, if the field displaces along u alone, along v alone, and what a covariance of the two adds.
    """

    contrasts: Array
    cov: Array


@lru_cache(maxsize=4)
def edge_model(patterns: Patterns) -> EdgeModel:
    """Return the model of the patterns' tags."""
    edges = pattern_edges(patterns)
    blocks = np.concatenate(
        [_means(edges.at_u, np.abs(edges.step_u), 0), _means(edges.at_v, np.abs(edges.step_v), 1)], axis=2
    )
    contrasts = np.linalg.svd(blocks @ edges.fields)[0][:, :, HOMOGRAPHY:]
    corners = small_homographies(CORNERS).reshape(HOMOGRAPHY, HOMOGRAPHY)
    seen = np.concatenate([contrasts.transpose(0, 2, 1) @ blocks, -corners @ edges.fitted], axis=1)
    n = len(edges.at_u)
    by_u, by_v = _with_corners(seen[:, :, :n], 0), _with_corners(seen[:, :, n:], 1)
    at_u, at_v = np.concatenate([edges.at_u, CORNERS]), np.concatenate([edges.at_v, CORNERS])
    cov = np.empty((len(LENGTHS), 3, *seen.shape[:2], seen.shape[1]))
    for k, length in enumerate(LENGTHS):
        cov[k, 0] = by_u @ _correlation(at_u, at_u, length) @ by_u.transpose(0, 2, 1)
        cov[k, 1] = by_v @ _correlation(at_v, at_v, length) @ by_v.transpose(0, 2, 1)
        both = by_u @ _correlation(at_u, at_v, length) @ by_v.transpose(0, 2, 1)
        cov[k, 2] = both + both.transpose(0, 2, 1)
    return EdgeModel(contrasts=contrasts, cov=cov)


def _means(at: Array, there: Array, component: int) -> Array:
    """Return the matrices (T, 18, E) of the means over blocks, of edges at (E, 2) that are there (T, E) or not.

    Edges that two blocks share count half in each; blocks without edges are not displaced.
    """
    share = np.stack([_in_blocks(at[:, k]) for k in (0, 1)])
    inside = share[1][:, None] * share[0][None]
    weight = inside.reshape(1, BLOCKS**2, -1) * there[:, None]
    out = np.zeros((len(there), 2 * BLOCKS**2, len(at)))
    out[:, component::2] = weight / np.maximum(weight.sum(axis=2, keepdims=True), 1e-9)
    return out


def _in_blocks(along: Array) -> Array:
    """Return which fraction of the close neighbourhood of places (P,) from 0 to 1 lies in each block, (BLOCKS, P)."""
    near, ends = 1e-6, np.arange(BLOCKS + 1)[:, None] / BLOCKS
    overlap = np.maximum(np.minimum(ends[1:], along + near) - np.maximum(ends[:-1], along - near), 0)
    return np.asarray(overlap / overlap.sum(axis=0))


def _with_corners(seen: Array, component: int) -> Array:
    """Return what is seen of a component of the field at edges (T, 18, E) and at the corners, (T, 18, E + 4)."""
    at_corners = np.zeros((len(seen), seen.shape[1], len(CORNERS)))
    at_corners[:, CONTRASTS + component :: 2] = np.eye(len(CORNERS))
    return np.concatenate([seen, at_corners], axis=2)


def _correlation(a: Array, b: Array, length: float) -> Array:
    """Return the field's correlation between places (P, 2) and (Q, 2)."""
    apart = a[:, None] - b[None]
    return np.asarray(np.exp(-np.sum(apart * apart, axis=2) / (4 * length**2)))
