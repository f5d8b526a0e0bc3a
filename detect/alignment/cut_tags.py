"""Tags that the border of the picture cuts: a wrong lens moves their corners as it does no others'.

Alignment under a roughly known lens leaves the corners of a tag that is seen all round nearly where they are. A corner
at the border hangs on what is seen of the tag: a bend that the lens should not have moves it by many times as much. So
such corners are carried to the lens that the picture tells by what is seen of their tags, and as uncertain as that lens
leaves them; and they do not tell it.
"""

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_pose import BoxFit
from boxcal.detect.alignment.box_refinement import FITTED
from boxcal.detect.alignment.radial_camera import LOG_ASPECT, SKEW
from boxcal.detect.alignment.tag_curvature import followed_in_part, under_lens
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

_BENDING = [k for k in FITTED if k not in {LOG_ASPECT, SKEW}]
"""Parameters of a lens that bend edges; a homography follows the others as they are."""
_STEP = 1e-3
"""Of a lens's parameters, in their own deviations: corners move in proportion."""


def cut_by_border(patterns: Patterns, corners_px: Array, image_size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which tags (N, 4, 2), px, are not wholly seen with a module of white around them.

    Parameters
    ----------
    patterns
        Of the tags.
    corners_px : (N, 4, 2), px
    image_size
        Width and height, px.
    """
    along = corners_px - np.roll(corners_px, 1, axis=1)
    module = np.hypot(along[..., 0], along[..., 1]).max(axis=1) / patterns.modules
    inside = np.minimum(corners_px, np.array(image_size) - 1 - corners_px).min(axis=(1, 2))
    return np.asarray(inside < module)


def carried_to_lens(lens: Array, fit: BoxFit, corners_px: Array, image_size: tuple[int, int]) -> tuple[Array, Array]:
    """Return corners of cut tags (N, 4, 2), px, under the lens of a box, and what its errors add to them.

    Parameters
    ----------
    lens : (10,)
        Under which they were aligned.
    fit
        The box, with the lens that whole tags tell.
    corners_px : (N, 4, 2), px
    image_size
        Width and height, px.

    Returns
    -------
    Corners (N, 4, 2), px, and covariances (N, 4, 2, 2), px^2
    """
    followed = followed_in_part(corners_px, image_size)
    there = under_lens(lens, fit.lens, corners_px, followed)
    of_lens = 1 + np.array([FITTED.index(name) for name in _BENDING])
    cov = fit.sigma_px**2 * np.linalg.inv(fit.information)[np.ix_(of_lens, of_lens)]
    added = np.zeros((*corners_px.shape, 2))
    values, vectors = np.linalg.eigh(cov)
    for value, vector in zip(values, vectors.T, strict=True):
        other = fit.lens.copy()
        other[_BENDING] += _STEP * np.sqrt(max(value, 0.0)) * vector
        moved = (under_lens(lens, other, corners_px, followed) - there) / _STEP
        added += moved[..., :, None] * moved[..., None, :]
    return there, added
