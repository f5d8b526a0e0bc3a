"""The direction in which an image is blurred more than across it: the camera moved, or its lens is astigmatic.

The PSF's covariance over its mean variance is ``[[1 + c, s], [s, 1 - c]]``, the same for all tags of an image. c and s
follow from the residuals of a few large tags by Gauss-Newton steps, whatever else a tag's residuals can be explained
with taken out of them (Schur's complement).
"""

from dataclasses import replace

import numpy as np

from boxcal.detect.alignment.backend import backend
from boxcal.detect.alignment.registration.align import align, aligned_batch
from boxcal.detect.alignment.registration.finish import inverse_normal
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import ROUND, Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

ASKED, TAGS, ROUNDS = 2, 4, 3
"""Tags that are asked whether the image moved at all, those that then say how, and steps."""
SIDE_PX, STOP_PX = 22.0, 0.02
MOST = 0.85
"""Largest length of (c, s): a variance twelve times as large along the motion as across it."""
LEAST = 0.2
"""Smaller ones are passed over: a motion of 1.5 px has it, and resampling of an image may have half of it."""
_SLIGHT = 0.75
"""A first step shorter than this fraction of what counts is not followed: it is right to a tenth where it is short."""
LONGEST = 0.4
CLEAR = 40.0
"""How much a step must lessen the sum of squared residuals, in variances of a residual, for blur not to be round."""
_SMALL = 0.1
_AROUND = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1]])


def shape(c: float, s: float) -> Array:
    """Return the blur (3,) of a frame, see :class:`boxcal.detect.alignment.registration.tag_batch.Frame`."""
    length = np.hypot(c, s)
    if length > MOST:
        c, s = c * MOST / length, s * MOST / length
    first = np.sqrt(1 + c)
    return np.array([first, s / first, np.sqrt(1 - c - s * s / (1 + c))])


def shape_of(blur: Array) -> Array:
    """Return c and s, (2,), of a frame's blur (3,): the inverse of :func:`shape`."""
    return np.array([blur[0] ** 2 - 1, blur[0] * blur[1]])


def estimate_blur(frame: Frame, patterns: Patterns, tags: TagAlignments) -> Array | None:
    """Return the blur (3,) of an image in which tags are aligned; None where it is as the frame has it already.

    A frame has it round unless its motion is expected.
    """
    size = np.linalg.norm(tags.corners_px[:, 2] - tags.corners_px[:, 0], axis=1)
    order, found = np.argsort(-size), shape_of(frame.blur)
    if len(tags) == 0:
        return None
    if _slight(*_step(frame, patterns, tags.take(order[:ASKED]), found)):
        return None
    some = tags.take(order[:TAGS])
    for left in reversed(range(ROUNDS)):
        step, explained = _step(frame, patterns, some, found)
        if left == ROUNDS - 1 and _slight(step, explained):
            return None  # what few tags said, more do not
        found += step * min(1.0, LONGEST / max(float(np.linalg.norm(step)), 1e-12))
        if explained < CLEAR:
            break
        if left:
            under = replace(frame, blur=shape(*found))
            some = align(under, patterns, some.rows, some.corners_px, start=some, side_px=SIDE_PX, stop_px=STOP_PX)
    if np.linalg.norm(found) > LEAST:
        return shape(*found)
    return None if np.array_equal(frame.blur, ROUND) else ROUND


def _slight(step: Array, explained: float) -> bool:
    """Return whether a first step is too small to be followed, or explains too little."""
    return explained < CLEAR or float(np.linalg.norm(step)) < _SLIGHT * LEAST


def _step(frame: Frame, patterns: Patterns, tags: TagAlignments, found: Array) -> tuple[Array, float]:
    """Return a Gauss-Newton step (2,) of c and s, and what it explains, in variances of a residual.

    With r the residuals and G what c and s do to the image, ``G^T r``, ``G^T G`` and ``J^T G`` are central
    differences of ``r^T r`` and ``J^T r``, which every alignment sums.
    """
    batch = aligned_batch(frame, patterns, tags, SIDE_PX)
    here, cp, cm, sp, sm, both = (
        backend().accumulate(replace(batch, frame=replace(frame, blur=shape(*at)))) for at in found + _SMALL * _AROUND
    )
    r2, h = here.stats[:, 1], _SMALL
    by = np.stack([cm.gradient - cp.gradient, sm.gradient - sp.gradient], axis=2) / (2 * h)
    G_r = np.stack([cm.stats[:, 1] - cp.stats[:, 1], sm.stats[:, 1] - sp.stats[:, 1]], axis=1) / (4 * h)
    G_G = np.empty((len(tags), 2, 2))
    for k, (plus, minus) in enumerate(((cp, cm), (sp, sm))):
        G_G[:, k, k] = (plus.stats[:, 1] + minus.stats[:, 1] - 2 * r2) / (2 * h * h)
    G_G[:, 0, 1] = G_G[:, 1, 0] = (both.stats[:, 1] - cp.stats[:, 1] - sp.stats[:, 1] + r2) / (2 * h * h)
    taken = by.transpose(0, 2, 1) @ inverse_normal(here.normal, here.stats)
    A = np.sum(G_G - taken @ by, axis=0)
    b = np.sum(G_r - (taken @ here.gradient[..., None])[..., 0], axis=0)
    if np.linalg.eigvalsh(A)[0] <= 0:
        return np.zeros(2), 0.0
    step = np.linalg.solve(A, b)
    return step, float(step @ b) / max(float(np.mean(tags.noise**2)), 1e-12)
