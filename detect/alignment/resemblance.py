"""Resemblance of an image to tags at places where they may be, module by module, without any alignment."""

import numpy as np

from boxcal.detect.alignment.candidates import sample
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.image.gray import Levels
from boxcal.target.arrays import Array


def resemblance(image: Levels, patterns: Patterns, rows: Index, corners_px: Array) -> Array:
    """Return the correlations between an image and tags at several places of all together, (S,), means over the tags.

    A module's width apart from where tags are it is half of what it is there, or less.

    Parameters
    ----------
    image : (H, W)
        The image.
    patterns, rows : (T,)
        The tags.
    corners_px : (S, T, 4, 2), px
        The places: where a tag's corners are seen, from the top left one clockwise.
    """
    M = patterns.modules
    at = (np.arange(M + 2) - 0.5) / M
    u, v = (part.ravel() for part in np.meshgrid(at, at))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
    points = weights @ corners_px  # (S, T, modules, 2)
    seen = np.asarray(sample(image, points[..., 0].reshape(len(points), -1), points[..., 1].reshape(len(points), -1)))
    seen = seen.reshape(points.shape[:-1]).astype(np.float64)
    seen -= seen.mean(axis=-1, keepdims=True)
    cells = patterns.cells[rows].reshape(len(rows), -1)
    cells = cells - cells.mean(axis=-1, keepdims=True)
    size = np.sqrt(np.sum(seen**2, axis=-1) * np.sum(cells**2, axis=-1))
    by_tag = np.divide(np.sum(seen * cells, axis=-1), size, out=np.zeros_like(size), where=size > 0)
    return np.asarray(by_tag.mean(axis=1))
