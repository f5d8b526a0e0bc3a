"""The beginning of an alignment: where tags' corners lie on their charts, parameters to start from, pixels to use."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.homography import to_square
from boxcal.detect.alignment.radial_camera import undistort_locally
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

START_SIGMA_PX = 0.8
MARGIN_MODULES = 0.9
NEAR = (1.5, 2.5)
"""Pixels this near to an edge count, in standard deviations of the blur: of large tags and of small ones. The middle
of a blurred edge tells most of where it is."""
NEAR_SIDE_PX = 90.0
"""Of tags of another size pixels count within so many deviations as this is larger than their sides."""
EDGE_SIDE_PX = 45.0
"""Of tags twice as large only every second pixel at an edge is used, and so on."""
_NEXT = np.array([1, 2, 3, 0])
FIBONACCI = np.array([1, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233, 377, 610, 987], dtype=np.int64)


class Begun(NamedTuple):
    """Beginning of an alignment.

    Attributes
    ----------
    theta : (N, 14)
        Parameters.
    normalisation : (N, 3)
        Centres (x, y) px and 1 / scale px.
    normalised : (N, 4, 2)
        The corners on the charts, from the centre in units of the scale.
    bounding_boxes, margin, stride, near
        Pixels to use, see :class:`boxcal.detect.alignment.registration.tag_batch.Batch`.
    module_px : (N,), px
        Width of a module along the longest side.
    """

    theta: Array
    normalisation: Array
    normalised: Array
    bounding_boxes: NDArray[np.int64]
    margin: Array
    stride: NDArray[np.int64]
    near: Array
    module_px: Array


def begin(frame: Frame, patterns: Patterns, corners_px: Array, given: Array | None, side_px: float) -> Begun:
    """Return what an alignment of tags with rough corners (N, 4, 2), px, begins with.

    Parameters
    ----------
    frame, patterns
        The image, and what all tags look like.
    corners_px : (N, 4, 2), px
        Where to begin.
    given : (N, 14)
        Parameters of the same tags aligned before, for their light and blur; a guess if None.
    side_px
        Use no more pixels of a tag than one with sides of this length has.
    """
    normalisation, normalised, theta = start_at(frame.lens, patterns, corners_px)
    if given is not None:
        theta[:, BLACK:] = given[:, BLACK:]
    used = footprints(frame, patterns, corners_px, theta[:, LOG_PSF], side_px=side_px, edges=given is not None)
    return Begun(theta, normalisation, normalised, *used)


def footprints(
    frame: Frame, patterns: Patterns, corners_px: Array, log_sigma: Array, *, side_px: float, edges: bool
) -> tuple[NDArray[np.int64], Array, NDArray[np.int64], Array, Array]:
    """Return which pixels of tags to use: boxes (N, 4), margins, strides (N, 3), nearness, and modules' widths, px.

    For the first four see :class:`boxcal.detect.alignment.registration.tag_batch.Batch`. Of the white ring so much
    may be used as its neighbours' blur does not reach. Of large tags no more pixels are used than one with sides of
    ``side_px`` has, on a Fibonacci lattice: of m pixels one, in each row shifted by q. Unlike every second row and
    column it meets a module's edges at all phases, also where they run along the pixels. With ``edges``, of the pixels
    near to an edge all count, or of very large tags every n-th, of the lattice the fewer the nearer those are, and the
    mean side says how large a tag is; without, its area does, since there are no other pixels to tell the narrow way
    across a tag seen at a slant.
    """
    m = patterns.modules
    corners = np.where(np.isfinite(corners_px), corners_px, 0.0)
    along = corners[:, _NEXT] - corners
    side = np.hypot(along[..., 0], along[..., 1])
    blur = np.exp(_within(log_sigma, -2, 2)) * m / np.maximum(side.min(axis=1), 1e-3)
    margin = _within(patterns.gap_modules - 2.5 * blur, 0.35, min(MARGIN_MODULES, 0.9 * patterns.gap_modules))
    centre = 0.25 * corners.sum(axis=1)
    reach, limit = (1 + 2.2 * margin / m)[:, None], frame.grey.shape[::-1]
    bounding_boxes = np.empty((len(corners), 2, 2), dtype=np.int64)
    bounding_boxes[:, :, 0] = _within(np.floor(centre + reach * (corners.min(axis=1) - centre)), 0, limit)
    bounding_boxes[:, :, 1] = _within(np.ceil(centre + reach * (corners.max(axis=1) - centre)) + 1, 0, limit)
    mean, across = side.mean(axis=1), corners[:, 2:] - corners[:, :2]
    area = 0.5 * np.abs(across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0])
    near = _within(NEAR_SIDE_PX / np.maximum(mean, 1e-3), *NEAR)
    of = mean**2 * (NEAR[1] / near) if edges else area
    at = np.searchsorted(FIBONACCI, of / side_px**2, side="right") - 1
    at = np.minimum(np.maximum(at, 1), len(FIBONACCI) - 1)
    stride = np.empty((len(at), 3), dtype=np.int64)
    stride[:, 0], stride[:, 1] = FIBONACCI[at], FIBONACCI[at - 1]
    stride[:, 2] = _within(mean / EDGE_SIDE_PX, 1, 1000) if edges else 1 << 40
    return bounding_boxes.reshape(-1, 4), margin, stride, near, side.max(axis=1) / m


def _within(values: Array, low: float, high: float | tuple[int, ...]) -> Array:
    """Return values held between limits; ``np.clip`` takes several times as long on few values."""
    return np.asarray(np.minimum(np.maximum(values, low), high))


def start_at(lens: Array, patterns: Patterns, corners_px: Array) -> tuple[Array, Array, Array]:
    """Return centres and scales (N, 3), the corners' normalised places (N, 4, 2) and parameters (N, 14)."""
    normalisation = np.empty((len(corners_px), 3))
    normalisation[:, :2] = 0.25 * corners_px.sum(axis=1)
    apart = corners_px - normalisation[:, None, :2]
    normalisation[:, 2] = 1 / np.maximum(np.hypot(apart[..., 0], apart[..., 1]).max(axis=1), 1.0)
    normalised = undistort_locally(lens, normalisation, corners_px)
    theta = np.zeros((len(corners_px), PARAMETERS))
    theta[:, :8] = to_square(normalised, patterns.modules)
    theta[:, BLACK], theta[:, CONTRAST] = 0.2, 0.5
    theta[:, LOG_PSF] = np.log(START_SIGMA_PX)
    return normalisation, normalised, theta
