"""Corners of tags on paper that is not flat, predicted from the displacements of blocks of the tags.

The field that displaces a tag's edges is a Gaussian random field with one correlation length for all tags of an image
and a variance for each sheet; these, and the size of the noise beside it, are estimated by restricted maximum
likelihood from the contrasts of the blocks' displacements (Patterson and Thompson 1971, DOI 10.1093/biomet/58.3.545).
Given these, the corners' displacements have a conditional mean and covariance: simple kriging (Cressie 1993, Statistics
for Spatial Data, 3.4.5; DOI 10.1002/9781119115151). Aliasing and ink that spread displace blocks, too, but neighbours
independently: noise explains them as well as a field does.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.deformation.edge_model import CONTRASTS, HOMOGRAPHY, edge_model
from boxcal.detect.alignment.registration.block_motion import BLOCKS
from boxcal.detect.alignment.row_sets import distinct
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.tag_shape import sides
from boxcal.target.arrays import Array

LEAST_GAIN = 20.0
"""Increase of the log-likelihood with which a field is believed. Twice the gain is distributed much as chi-squared of
two degrees of freedom under noise of this model, where 7 has a chance of one in a thousand; images without blur, whose
aliasing is no such noise, mostly gain less than 20, and few more."""
ORDER, UNLIKELY = [1, 0, 2, 3], 10.0
"""Lengths in the order in which they are tried; none of the others gains much where the first gains less than this."""
GAIN_A_NOISE = 5.0
"""The gain must also be this many times the noise factor: noise that residuals do not explain is no white one."""
FARTHEST = 100.0
"""Normalised square of a tag's ten contrasts beyond which the field does not explain them: those of shadows
have hundreds, while wrinkles that are uneven over the picture have a few tags with more than chance allows (36)."""
ENOUGH, ROUNDS = 5, 4
"""Tags of a sheet that tell its field's variance, which fewer share with all; and rounds of these and the noise."""
LEAST_NOISE = 0.3
"""Of the noise factor."""
ALMOST_NONE = 1e-6
"""Information of a block across whose axis no edge lies, as a fraction of the most that another has."""
RATIOS = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 37)])
"""Variances of the field that are tried, in units of the typical noise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deformation:
    """Displacements of the corners of N tags from their alignments.

    Attributes
    ----------
    displacement_px : (N, 4, 2), px
        From the corners of the fitted homographies to the paper's.
    cov_px2 : (N, 4, 2, 2), px^2
        Of each displacement.
    noise_factor
        By what factor the blocks' variances differ from what residuals say.
    """

    displacement_px: Array
    cov_px2: Array
    noise_factor: float


def krige_corners(  # noqa: PLR0917
    patterns: Patterns,
    rows: Index,
    sheets: Index,
    corners_px: Array,
    blocks: Array,
    noise2: Array,
    even: NDArray[np.bool_],
) -> Deformation | None:
    """Return how the paper displaces the corners of aligned tags; None where noise explains as much.

    Parameters
    ----------
    patterns, rows
        The tags' patterns, and the row of each tag (N,) in them.
    sheets : (N,)
        On which sheet of paper each tag is.
    corners_px : (N, 4, 2), px
        As they were aligned.
    blocks : (N, 9, 5)
        Sums over blocks, :func:`boxcal.detect.alignment.registration.block_motion.block_sums`; NaN for tags without.
    noise2 : (N,)
        Variance of the residuals.
    even : (N,)
        Tags that are evenly lit: field and noise are estimated from these. Of the others, and of tags whose blocks no
        such field explains, corners may get no more than the field's variance.
    """
    there, to_px = np.asarray(np.isfinite(blocks).all(axis=(1, 2))), _to_px(corners_px)
    seen, noise = _contrasts(patterns, rows, to_px, np.where(there[:, None, None], blocks, 0.0), noise2)
    some = there & even
    if not some.any():
        return None
    fits = _fits(patterns, rows, to_px, seen, noise, some)
    first = next(fits)
    if first.gain < UNLIKELY:
        return None
    best = max([first, *fits], key=lambda fit: fit.likelihood)
    if best.gain < max(LEAST_GAIN, GAIN_A_NOISE * best.noise_factor):
        return None
    variance, noise_factor = _of_sheets(best, sheets[some], sheets)
    mean, cov = _predicted(seen, noise_factor * noise, variance[:, None, None] * best.field, there)
    return Deformation(
        displacement_px=mean @ to_px.transpose(0, 2, 1),
        cov_px2=to_px[:, None] @ cov @ to_px[:, None].transpose(0, 1, 3, 2),
        noise_factor=noise_factor,
    )


def likely_gain(patterns: Patterns, rows: Index, corners_px: Array, blocks: Array, noise2: Array) -> float:
    """Return how much better a field of the likeliest length explains the blocks of tags than noise alone.

    As a difference of log-likelihoods, 0 where nothing is seen. Arguments as for :func:`krige_corners`; all tags have
    sums.
    """
    return next(_fits_of_all(patterns, rows, corners_px, blocks, noise2)).gain if len(rows) else 0.0


def field_of_few(patterns: Patterns, rows: Index, corners_px: Array, blocks: Array, noise2: Array) -> Array:
    """Return the covariances (N, 4, 2, 2), px^2, of corners that the most likely field displaces, or none at all.

    For tags that are too few for a field to be believed: their corners stay where they are. Arguments as for
    :func:`krige_corners`; all tags have sums.
    """
    best = max(_fits_of_all(patterns, rows, corners_px, blocks, noise2), key=lambda fit: fit.likelihood)
    same = np.zeros(len(rows), dtype=np.int64)
    field = _of_sheets(best, same, same)[0][:, None, None] * best.field
    to_px = _to_px(corners_px)[:, None]
    return np.asarray(to_px @ _of_corners(field[:, CONTRASTS:, CONTRASTS:]) @ to_px.transpose(0, 1, 3, 2))


def _contrasts(patterns: Patterns, rows: Index, to_px: Array, blocks: Array, noise2: Array) -> tuple[Array, Array]:
    """Return the contrasts (N, 10) of the blocks' displacements on the unit square and their covariances."""
    contrasts = edge_model(patterns).contrasts[rows].transpose(0, 2, 1)
    seen, noise = _displacements(blocks, noise2, np.asarray(np.linalg.inv(to_px)))
    return (contrasts @ seen[..., None])[..., 0], contrasts @ noise @ contrasts.transpose(0, 2, 1)


def _predicted(seen: Array, noise: Array, field: Array, there: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the corners' displacements (N, 4, 2) on the unit square and their covariances, given the contrasts."""
    observed = field[:, :CONTRASTS, :CONTRASTS] + noise
    square = np.sum(np.linalg.solve(observed, seen[..., None])[..., 0] * seen, axis=1)
    weights = np.linalg.solve(observed, field[:, :CONTRASTS, CONTRASTS:]).transpose(0, 2, 1)
    weights[~there | (square > FARTHEST)] = 0
    left = field[:, CONTRASTS:, CONTRASTS:] - weights @ field[:, :CONTRASTS, CONTRASTS:]
    return (weights @ seen[..., None]).reshape(-1, 4, 2), _of_corners(left)


def _of_corners(cov: Array) -> Array:
    """Return the covariances (N, 4, 2, 2) of each corner among those (N, 8, 8) of all."""
    return np.stack([cov[:, k : k + 2, k : k + 2] for k in range(0, HOMOGRAPHY, 2)], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """Maximum of the restricted likelihood for fields of one correlation length, of one variance on all sheets.

    Contrasts (K, 10) are taken along the axes of the field's covariance where the noise is white: a field of the
    variance ``ratio * unit``, px^2, makes their squares ``1 + ratio * white`` times as large as noise does.
    """

    likelihood: float
    gain: float
    noise_factor: float
    field: Array
    unit: float
    white: Array
    square: Array


def _fits_of_all(patterns: Patterns, rows: Index, corners_px: Array, blocks: Array, noise2: Array) -> Iterator[_Fit]:
    """Yield the fits of fields to the blocks of tags that all have sums, by length, the likeliest first."""
    to_px = _to_px(corners_px)
    seen, noise = _contrasts(patterns, rows, to_px, blocks, noise2)
    return _fits(patterns, rows, to_px, seen, noise, np.ones(len(rows), dtype=np.bool_))


def _fits(  # noqa: PLR0917
    patterns: Patterns, rows: Index, to_px: Array, seen: Array, noise: Array, some: NDArray[np.bool_]
) -> Iterator[_Fit]:
    """Yield the fits of fields to the contrasts (N, 10) of some of the tags, by length, the likeliest first."""
    root = np.asarray(np.linalg.cholesky(noise[some]))
    for cov in edge_model(patterns).cov[ORDER]:
        field = _field(cov[:, rows], to_px)
        yield _fit(field, seen[some], noise[some], root, field[some, :CONTRASTS, :CONTRASTS])


def _fit(field: Array, seen: Array, noise: Array, root: Array, of_seen: Array) -> _Fit:
    """Return the best sizes of noise and field, of contrasts (K, 10) with covariances (K, 10, 10) of unit size."""
    unit = float(np.median(np.trace(noise, axis1=1, axis2=2) / np.trace(of_seen, axis1=1, axis2=2)))
    half = np.linalg.solve(root, unit * of_seen)
    white, axes = np.linalg.eigh(np.linalg.solve(root, half.transpose(0, 2, 1)))
    white = np.maximum(white, 0)
    square = (axes.transpose(0, 2, 1) @ np.linalg.solve(root, seen[..., None]))[..., 0] ** 2
    variance = 1 + RATIOS[:, None] * white.ravel()
    factor = np.maximum((square.ravel() / variance).mean(axis=1), LEAST_NOISE)
    size = variance * factor[:, None]
    likelihood = -0.5 * np.sum(np.log(size) + square.ravel() / size, axis=1)
    k = int(likelihood.argmax())
    return _Fit(
        likelihood=float(likelihood[k]),
        gain=float(likelihood[k] - likelihood[0]),
        noise_factor=float(factor[k]),
        field=field,
        unit=unit,
        white=white,
        square=square,
    )


def _of_sheets(fit: _Fit, sheets: Index, asked: Index) -> tuple[Array, float]:
    """Return the variance of the field on sheets ``asked`` (M,), as tags on ``sheets`` (K,) tell it, and the noise."""
    variance, noise_factor = 1 + RATIOS[:, None, None] * fit.white, fit.noise_factor
    by_tag, each = np.log(variance).sum(axis=2), {int(s): sheets == s for s in distinct(sheets)}
    best: dict[int, int] = {}
    for _ in range(ROUNDS):
        cost = by_tag + (fit.square / variance).sum(axis=2) / noise_factor
        common = int(cost.sum(axis=1).argmin())
        best = {s: int(cost[:, on].sum(axis=1).argmin()) if on.sum() >= ENOUGH else common for s, on in each.items()}
        k = np.array([best[int(s)] for s in sheets])
        noise_factor = max(float((fit.square / variance[k, np.arange(len(k))]).mean()), LEAST_NOISE)
    ratio = RATIOS[[best.get(int(s), common) for s in asked]]
    return ratio * noise_factor * fit.unit, noise_factor


def _to_px(corners_px: Array) -> Array:
    """Return the matrices (N, 2, 2) from places on the unit square to the image, px."""
    return np.stack(sides(corners_px), axis=2)


def _displacements(blocks: Array, noise2: Array, from_px: Array) -> tuple[Array, Array]:
    """Return the displacements (N, 18) of blocks on the unit square and their covariances (N, 18, 18)."""
    A = blocks[..., [[0, 1], [1, 2]]]
    # a block without an edge across an axis tells nothing along it
    A = A + (ALMOST_NONE * np.trace(A, axis1=2, axis2=3).max(axis=1) + 1e-12)[:, None, None, None] * np.eye(2)
    inverse = np.linalg.inv(A)
    # the image at a place is that of the pattern displaced by d: the residual is -g d
    seen = -(inverse @ blocks[..., 3:, None])[..., 0] @ from_px.transpose(0, 2, 1)
    each = noise2[:, None, None, None] * (from_px[:, None] @ inverse @ from_px[:, None].transpose(0, 1, 3, 2))
    n = BLOCKS**2
    cov = np.zeros((len(blocks), n, 2, n, 2))
    cov[:, np.arange(n), :, np.arange(n)] = each.transpose(1, 0, 2, 3)
    return seen.reshape(-1, 2 * n), cov.reshape(-1, 2 * n, 2 * n)


def _field(cov: Array, to_px: Array) -> Array:
    """Return the covariances (N, 18, 18) under fields that are as large in all directions of the image, 1 px^2."""
    S = np.linalg.inv(to_px.transpose(0, 2, 1) @ to_px)[..., None, None]
    return np.asarray(S[:, 0, 0] * cov[0] + S[:, 1, 1] * cov[1] + S[:, 0, 1] * cov[2])
