"""Align tags with an image: batched Gauss-Newton on homography, light and blur of every tag at once."""

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.backend import Backend, backend
from boxcal.detect.alignment.registration import image_model as model
from boxcal.detect.alignment.registration.begin import Begun
from boxcal.detect.alignment.registration.block_motion import BLOCKS
from boxcal.detect.alignment.registration.gauss_newton import StepRules
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST, KURTOSIS, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.sandwich_sums import no_part_sums
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Batch, Frame
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.target.arrays import Array

ITERATIONS = 10
STOP_PX = 0.02
_DAMPING, _FIRST_DAMPING = 1e-6, 1e-3


def _free(*names: slice) -> NDArray[np.bool_]:
    chosen = np.zeros(PARAMETERS, dtype=np.bool_)
    for part in names:
        chosen[part] = True
    return chosen


_LIGHT, _AFFINE, _PERSPECTIVE = slice(BLACK, LOG_PSF), slice(0, 6), slice(0, 8)
_BLUR, _SHAPE = slice(LOG_PSF, LOG_PSF + 1), slice(KURTOSIS, KURTOSIS + 1)
_FIRST = np.stack([_free(_LIGHT, _BLUR, _AFFINE), _free(_LIGHT, _BLUR, _PERSPECTIVE)])
_FURTHER = np.stack([_free(_LIGHT, _BLUR, _PERSPECTIVE, _SHAPE)])
_AGAIN = np.concatenate([_FURTHER, _FURTHER])
"""What each step may change."""


def align(
    frame: Frame,
    patterns: Patterns,
    rows: Index,
    corners_px: Array,
    *,
    start: TagAlignments | None = None,
    intensity_unknown: bool = False,
    stop_px: float = STOP_PX,
    iterations: int = ITERATIONS,
    side_px: float = np.inf,
    covariance: bool = True,
    thinned: bool = False,
    asked: NDArray[np.bool_] | None = None,
    compute: Backend | None = None,
) -> TagAlignments:
    """Align tags whose corners are roughly known (to about a module).

    Parameters
    ----------
    frame
        The image.
    patterns, rows
        The tags' patterns, and the row of each tag (N,) in them.
    corners_px : (N, 4, 2), px
        Where to start.
    start
        The same tags aligned before, for their light and blur. Without it black and white are guessed from the middle
        of the modules, the first step changes light, blur and an affine map only, and the blur stays Gaussian.
    intensity_unknown
        The light of ``start`` is a guess (it was told under another response curve).
    stop_px
        A tag is done once its corners move less and its residuals have settled.
    iterations
        At most so many Gauss-Newton steps.
    side_px
        Use no more pixels of a tag than one with sides of this length has.
    covariance
        Without it covariances come back as zero.
    thinned
        Take the first step with few pixels: saves a third where tags are yet roughly aligned.
    asked : (N,)
        Of which tags to return the sums that tell what the model leaves out; of none if None.
    compute
        Compiled code or its reference in numpy; what :func:`boxcal.detect.alignment.backend.backend` says if None.

    Returns
    -------
    Aligned
        As many as went in, in their order; those that diverged have a correlation of -1.
    """
    schedule = _FIRST if start is None else (_AGAIN if intensity_unknown else _FURTHER)
    compute = compute or backend()
    begun = compute.begin(frame, patterns, corners_px, None if start is None else start.theta, side_px)
    theta, normalisation = begun.theta, begun.normalisation
    batch = _batch(frame, patterns, rows, begun)
    last = model.no_sums(len(rows), patterns.cells)
    rules = StepRules(
        free=schedule,
        damping=_DAMPING if start is not None else _FIRST_DAMPING,
        stop_px=float(stop_px),
        iterations=iterations,
        guess=start is None,
        thinned=thinned and iterations > 1,
    )
    parts = None if asked is None else no_part_sums(asked, begun.bounding_boxes)
    compute.iterate(batch, last, normalised=begun.normalised, module_px=begun.module_px, rules=rules, parts=parts)
    corners, cov, quality = compute.finish(
        frame, patterns, theta=theta, normalisation=normalisation, sums=last, covariance=covariance
    )
    n, noise = len(rows), quality[:, 3]
    sandwich, block_sums = np.full((n, 4), np.nan), np.full((n, BLOCKS**2, 5), np.nan)
    if parts is not None:
        sandwich[parts.tags] = compute.sandwich_sums(batch, parts, corners, noise**2)
        block_sums[parts.tags] = parts.blocks
    good = np.isfinite(corners).reshape(n, 8).all(axis=1) & np.isfinite(cov).reshape(n, 16).all(axis=1)
    good &= last.stats[:, 0] > 2 * PARAMETERS
    corners[~good], cov[~good], sandwich[~good], block_sums[~good] = 0.0, 1.0, np.nan, np.nan
    return TagAlignments(
        rows=rows,
        corners_px=corners,
        cov_px2=cov,
        psf_sigma_px=np.exp(theta[:, LOG_PSF]),
        black_level=theta[:, BLACK],
        contrast=theta[:, CONTRAST],
        correlation=np.where(good, quality[:, 0], -1.0),
        worst_block=quality[:, 1],
        worst_module=quality[:, 2],
        noise=noise,
        theta=theta,
        normalisation=normalisation,
        blocks=last.blocks,
        sandwich_sums=sandwich,
        block_sums=block_sums,
    )


def aligned_batch(frame: Frame, patterns: Patterns, tags: TagAlignments, side_px: float) -> Batch:
    """Return aligned tags with the pixels on which they were aligned; for ``side_px`` see :func:`align`."""
    begun = backend().begin(frame, patterns, tags.corners_px, tags.theta, side_px)
    return _batch(frame, patterns, tags.rows, begun._replace(theta=tags.theta, normalisation=tags.normalisation))


def _batch(frame: Frame, patterns: Patterns, rows: Index, begun: Begun) -> Batch:
    """Return tags with the pixels to use."""
    return Batch(
        frame=frame,
        cells=patterns.cells,
        rows=rows,
        theta=begun.theta,
        normalisation=begun.normalisation,
        bounding_boxes=begun.bounding_boxes,
        margin=begun.margin,
        stride=begun.stride,
        near=begun.near,
    )
