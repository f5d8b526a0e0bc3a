"""The end of an alignment: corners, their covariances and what verification needs, from the sums of the last step."""

from typing import NamedTuple

import numpy as np

from boxcal.detect.alignment.radial_camera import distort_locally, distortion_jacobian, undistort_locally
from boxcal.detect.alignment.registration.image_model import Sums
from boxcal.detect.alignment.registration.parameters import KURTOSIS, PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

KURTOSIS_PRIOR = 0.5
"""Deviation of the blur's kurtosis before anything is seen."""


class Finished(NamedTuple):
    """Corners of aligned tags and what verification needs.

    Attributes
    ----------
    corners : (N, 4, 2), px
        NaN where there are none.
    cov : (N, 4, 2, 2), px^2
        Of each corner.
    quality : (N, 4)
        Correlation, worst block, worst module and deviation of the residuals, see
        :class:`boxcal.detect.alignment.registration.align.TagAlignments`.
    """

    corners: Array
    cov: Array
    quality: Array


def finish(
    frame: Frame, patterns: Patterns, *, theta: Array, normalisation: Array, sums: Sums, covariance: bool
) -> Finished:
    """Return the corners of aligned tags, their covariances (zero unless asked for) and qualities."""
    corners = distort_locally(frame.lens, normalisation, _normalised_corners(patterns, theta))
    n, r2, y, y2, p, p2 = sums.stats.T
    count = np.maximum(n, 1)
    var_y, var_p = y2 / count - (y / count) ** 2, p2 / count - (p / count) ** 2
    cross = 0.5 * (y2 + p2 - r2) / count - (y / count) * (p / count)
    correlation = np.minimum(cross / np.sqrt(np.maximum(var_y * var_p, 1e-12)), 1.0)
    noise2 = r2 / np.maximum(n - PARAMETERS, 1)
    cov = (
        _covariance(frame, sums, noise2, theta, normalisation, corners)
        if covariance
        else np.zeros((len(theta), 4, 2, 2))
    )
    mean = sums.blocks[..., 0] / np.maximum(sums.blocks[..., 1], 1)
    contrast = np.maximum(np.sqrt(np.maximum(var_y, 0)) * 2, 1e-6)
    worst_module = np.where(sums.blocks[..., 1] >= 4, np.abs(mean), 0).max(axis=(1, 2)) / contrast
    even = np.pad(sums.blocks, ((0, 0), (0, sums.blocks.shape[1] % 2), (0, sums.blocks.shape[2] % 2), (0, 0)))
    fours = even[:, ::2, ::2] + even[:, 1::2, ::2] + even[:, ::2, 1::2] + even[:, 1::2, 1::2]
    mean = fours[..., 0] / np.maximum(fours[..., 1], 1)
    worst = np.where(fours[..., 1] >= 2, np.abs(mean), 0).max(axis=(1, 2)) / contrast
    quality = np.stack([correlation, worst, worst_module, np.sqrt(noise2)], axis=1)
    return Finished(corners=corners, cov=cov, quality=quality)


def _normalised_corners(patterns: Patterns, theta: Array) -> Array:
    """Return the corners (N, 4, 2) in normalised normalised: H inverted by its adjugate; NaN where it is singular."""
    h0, h1, h2, h3, h4, h5, h6, h7 = theta[:, :8].T
    u, v = patterns.corners[:, 0, None], patterns.corners[:, 1, None]
    x = (h4 - h5 * h7) * u + (h2 * h7 - h1) * v + (h1 * h5 - h2 * h4)
    y = (h5 * h6 - h3) * u + (h0 - h2 * h6) * v + (h2 * h3 - h0 * h5)
    w = (h3 * h7 - h4 * h6) * u + (h1 * h6 - h0 * h7) * v + (h0 * h4 - h1 * h3)
    with np.errstate(divide="ignore", invalid="ignore"):
        corners = np.stack([x / w, y / w], -1).transpose(1, 0, 2)
    return np.where(np.abs(corners) < 1e3, corners, np.nan)


def _covariance(  # noqa: PLR0917
    frame: Frame, sums: Sums, noise2: Array, theta: Array, normalisation: Array, corners: Array
) -> Array:
    """Return the corners' covariances (N, 4, 2, 2): residual variance by the inverse normal matrix."""
    cov_h = inverse_normal(sums.normal, sums.stats)[:, :8, :8] * noise2[:, None, None]
    D = corners_by_homography(frame, theta, normalisation, corners)
    cov = np.einsum("ncik,nkl,ncjl->ncij", D, cov_h, D)
    return np.asarray(cov)


def inverse_normal(normal: Array, stats: Array) -> Array:
    """Return the inverses (N, 14, 14) of normal matrices, the prior on the kurtosis added."""
    normal = normal.copy()
    normal[:, range(PARAMETERS), range(PARAMETERS)] += 1e-12 + 1e-9 * np.einsum("nii->ni", normal)
    normal[:, KURTOSIS, KURTOSIS] += kurtosis_prior(stats)
    return np.asarray(np.linalg.inv(normal))


def corners_by_homography(frame: Frame, theta: Array, normalisation: Array, corners_px: Array) -> Array:
    """Return how corners (N, 4, 2), px, move with the homographies' entries: (N, 4, 2, 8)."""
    D = (
        _corner_jacobian(theta, undistort_locally(frame.lens, normalisation, corners_px))
        / normalisation[:, 2, None, None, None]
    )
    return np.asarray(np.einsum("ncij,ncjk->ncik", distortion_jacobian(frame.lens, normalisation, corners_px), D))


def _corner_jacobian(theta: Array, xy: Array) -> Array:
    """Return how the corners (N, 4, 2) in normalised places move with h: (N, 4, 2, 8).

    The corner stays where its modules are: ``dx = -(dH/dx)^-1 dH/dh``.
    """
    x, y = xy[..., 0], xy[..., 1]
    t = theta[:, None, :]
    w = 1 / (t[..., 6] * x + t[..., 7] * y + 1)
    u, v = (t[..., 0] * x + t[..., 1] * y + t[..., 2]) * w, (t[..., 3] * x + t[..., 4] * y + t[..., 5]) * w
    by_x = np.stack(
        [
            np.stack([(t[..., 0] - u * t[..., 6]) * w, (t[..., 1] - u * t[..., 7]) * w], -1),
            np.stack([(t[..., 3] - v * t[..., 6]) * w, (t[..., 4] - v * t[..., 7]) * w], -1),
        ],
        -2,
    )
    zero, one = np.zeros_like(x), np.ones_like(x)
    row = np.stack([x, y, one], -1) * w[..., None]
    by_h = np.stack(
        [
            np.concatenate([row, np.stack([zero] * 3, -1), -(u * w * x)[..., None], -(u * w * y)[..., None]], -1),
            np.concatenate([np.stack([zero] * 3, -1), row, -(v * w * x)[..., None], -(v * w * y)[..., None]], -1),
        ],
        -2,
    )
    determinant = by_x[..., 0, 0] * by_x[..., 1, 1] - by_x[..., 0, 1] * by_x[..., 1, 0]
    inverse = (
        np.stack(
            [np.stack([by_x[..., 1, 1], -by_x[..., 0, 1]], -1), np.stack([-by_x[..., 1, 0], by_x[..., 0, 0]], -1)], -2
        )
        / np.where(np.abs(determinant) > 1e-15, determinant, 1e-15)[..., None, None]
    )
    return np.asarray(-inverse @ by_h)


def kurtosis_prior(stats: Array) -> Array:
    """Return the information (N,) that the prior on the kurtosis adds, in units of the residuals."""
    n, r2 = stats[:, 0], stats[:, 1]
    return np.asarray(np.maximum(r2, 1e-9) / np.maximum(n - PARAMETERS, 1) / KURTOSIS_PRIOR**2)
