"""Cluster-robust inflation of the corners' covariances, estimated from the residuals of the alignment.

Residuals that agree with their neighbours (an edge that the model does not follow, compression) move a corner further
than as many independent ones; residuals that alternate move it less. With ``psi_p = B^T J_p r_p`` what a pixel adds to
the corners, summed over squares of the image, the variance is the sum of the squares' squares (cluster-robust
covariance: Liang and Zeger 1986, DOI 10.1093/biomet/73.1.13), whatever agrees within a square. The same sum has under
white noise an expectation that is known exactly, fitted parameters included; the share of the two is one figure for the
whole image, since one tag has too few squares to tell.

It asks nothing of the camera: under JPEG it comes out below one, on path-traced pictures of another renderer at three.
"""

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

MOST_TAGS, ENOUGH = 5, 4
"""Tags of which sums are asked for as they are aligned, and how many of those must turn out to be tags; else others are
aligned by one step more for theirs."""
PRIOR_TAGS = 1.0
"""So many tags' worth of squares are taken to have shown white noise."""
RANGE = (0.25, 25.0)
TOGETHER = 0.86
"""Neighbouring squares that share an edge undo each other's part of what is left out: measured over the conditions of
benchmarks/detector.py, errors have so much of the variance that squares which know nothing of each other would give."""

RIGID_PRIOR = 5.0
"""So many squared deviations from the rigid box are taken to have been as large as the covariances say."""
LEAST_SHARE, MOST_SQUARE = 0.02, 9.0
"""Least factor of the covariances that the box may ask for; largest normalised square that counts in full."""


def asked(corners_px: Array) -> NDArray[np.bool_]:
    """Return of which tags (N,) to ask for sums: some of all sizes; their corners are (N, 4, 2)."""
    n = len(corners_px)
    size = np.linalg.norm(corners_px[:, 2] - corners_px[:, 0], axis=1)
    chosen = np.zeros(n, dtype=np.bool_)
    chosen[np.argsort(-size)[np.linspace(0, n - 1, min(MOST_TAGS, n)).astype(np.int64)]] = True
    return chosen


def inflation_left_out(frame: Frame, patterns: Patterns, tags: TagAlignments, side_px: float) -> float:
    """Return by what factor the variances of the corners differ from what the residuals' size says.

    Parameters
    ----------
    frame
        The image, response curve and lens with which the tags were aligned.
    patterns, tags
        Tags as :func:`boxcal.detect.alignment.registration.align.align` returned them, with sums of some (see
        :func:`asked`).
    side_px
        With which fraction of large tags' pixels that was, see there.
    """
    if len(tags) == 0:
        return 1.0
    sums = _sums(tags)
    if len(sums) < min(ENOUGH, len(tags)):
        some = tags.take(asked(tags.corners_px))
        every = np.ones(len(some), dtype=np.bool_)
        sums = _sums(
            align(frame, patterns, some.rows, some.corners_px, start=some, iterations=1, side_px=side_px, asked=every)
        )
    return variance_inflation(sums[:, 0], sums[:, 1]) if len(sums) else 1.0


def _sums(tags: TagAlignments) -> Array:
    """Return the sums (K, 4) of those tags that have them."""
    return np.asarray(tags.sandwich_sums[np.isfinite(tags.sandwich_sums).all(axis=1)])


def variance_inflation(observed: Array, expected: Array) -> float:
    """Return by what factor the variances of the corners differ from what the residuals' size says.

    For the sums (N,) of tags see :func:`boxcal.detect.alignment.registration.cluster_sums.cluster_sums`.
    """
    prior = PRIOR_TAGS * float(np.mean(expected)) + 1e-12
    return TOGETHER * float(np.clip((observed.sum() + prior) / (expected.sum() + prior), *RANGE))


def rigid_share(apart_px: Array, cov_px2: Array, unknowns: int) -> float:
    """Return by what factor, at most one, to lessen covariances that the rigid box shows to be too large.

    On a box that is what it is taken for, corners lie beside their fitted places by their errors; on any other further.
    So nearness says that the errors are small, while distance says nothing of them: the factor never exceeds one.

    Parameters
    ----------
    apart_px : (N, 4, 2), px
        From the fitted box to the corners; NaN where the box does not tell.
    cov_px2 : (N, 4, 2, 2), px^2
    unknowns
        Unknowns of the fit.
    """
    told = np.isfinite(apart_px).all(axis=(1, 2))
    apart, cov = apart_px[told].reshape(-1, 2), cov_px2[told].reshape(-1, 2, 2)
    squares = np.minimum(np.sum(np.linalg.solve(cov, apart[..., None])[..., 0] * apart, axis=1), 2 * MOST_SQUARE)
    freedom = 2 * len(apart) - unknowns
    if freedom <= 0:
        return 1.0
    return float(np.clip((squares.sum() + RIGID_PRIOR) / (freedom + RIGID_PRIOR), LEAST_SHARE, 1.0))
