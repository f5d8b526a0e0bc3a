"""The frames of a stop combined: where each landmark was seen, and how well."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.detect.tags.detections import TagDetections
from boxcal.target.arrays import Array, Ids

FLOOR_PX = 0.003
"""Least standard deviation per axis, px: what the corners of large tags err by in the cleanest images. Print, paper
and glue are components of their own in the likelihood, and its noise scale is estimated."""
_SEEN_IN = 0.5
_OUTLIER_SIGMAS = 5.0
_LEAST_OUTLIER_PX = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AveragedCorners:
    """Corners averaged over the frames of one stop.

    Attributes
    ----------
    landmark_ids : (L,)
        Ascending.
    uv_px : (L, 2), px
        Mean over frames.
    sigma_px : (L,), px
        Standard deviation per axis that no number of frames goes below: the pixel grid and compression do the same to
        a corner in every frame of a stop (median over frames of what its tag says).
    cov_px2 : (L, 2, 2), px^2, or None
        Covariance in one frame, the mean of what the frames state: noise, and what the tags' model does not follow.
        None if a frame does not determine it.
    counts : (L,)
        Frames in each mean.
    scatter_px2 : (2, 2), px^2
        Sum over landmarks and frames of the outer products of deviations from the means.
    normalised
        The same sum, each by its covariance in one frame, trace halved; 0 without covariances.
    freedom
        Degrees of freedom of those sums.
    frames
        How many frames were combined.
    of_mean
        The corners were measured once, in the mean of the frames: ``cov_px2`` is their covariance there, noise and
        what the tags' model does not follow together.
    averages_out
        Fraction of the variance in that mean that is noise, which more frames would lessen; NaN where it is not known.
    """

    landmark_ids: Ids
    uv_px: Array
    sigma_px: Array
    cov_px2: Array | None
    counts: Ids
    scatter_px2: Array
    normalised: float
    freedom: int
    frames: int
    of_mean: bool = False
    averages_out: float = float("nan")

    @property
    def tags(self) -> int:
        """Number of tags with all four corners."""
        return int(np.sum(np.unique(self.landmark_ids // 4, return_counts=True)[1] == 4))


def combine(frames: Sequence[TagDetections]) -> AveragedCorners:
    """Combine the frames of one stop.

    A landmark counts if at least half of the frames show it. Its place is the mean of those within five standard
    deviations of the median; the standard deviation is read off the deviations of all landmarks from their medians
    (median absolute deviation, each in proportion to its stated sigma), so a frame that is off at one tag
    does not widen it.
    """
    ids = np.unique(np.concatenate([f.landmark_ids for f in frames])) if frames else np.zeros(0, dtype=np.int64)
    uv, sigma_px = np.full((len(frames), ids.size, 2), np.nan), np.full((len(frames), ids.size), np.nan)
    for k, frame in enumerate(frames):
        at = np.searchsorted(ids, frame.landmark_ids)
        uv[k, at], sigma_px[k, at] = frame.corners_px.reshape(-1, 2), np.repeat(frame.sigma_px, 4)
    often = np.sum(np.isfinite(uv[..., 0]), axis=0) >= max(1.0, _SEEN_IN * len(frames))
    ids, uv, sigma_px = ids[often], uv[:, often], sigma_px[:, often]
    if ids.size == 0:
        return AveragedCorners(
            landmark_ids=ids,
            uv_px=np.zeros((0, 2)),
            sigma_px=np.zeros(0),
            cov_px2=np.zeros((0, 2, 2)),
            counts=np.zeros(0, dtype=np.int64),
            scatter_px2=np.zeros((2, 2)),
            normalised=0.0,
            freedom=0,
            frames=len(frames),
        )
    off = np.linalg.norm(uv - np.nanmedian(uv, axis=0), axis=2)
    cov = _mean_covariance(frames, ids)
    width = np.ones(ids.size) if cov is None else np.sqrt(np.trace(cov, axis1=1, axis2=2) / 2)
    # the radius of 2-D Gaussian noise has the median 1.1774 sigma
    noise = float(np.nanmedian(off / width)) / 1.1774
    good = off <= np.maximum(_OUTLIER_SIGMAS * noise * width, _LEAST_OUTLIER_PX)
    counts = np.sum(good, axis=0)
    kept = counts >= max(1.0, _SEEN_IN * len(frames))
    ids, uv, sigma_px, good, counts = ids[kept], uv[:, kept], sigma_px[:, kept], good[:, kept], counts[kept]
    seen = np.where(good[..., None], uv, 0.0)
    mean = seen.sum(axis=0) / counts[:, None]
    deviation = np.where(good[..., None], uv - mean, 0.0)
    cov = None if cov is None else cov[kept]
    normalised = 0.0 if cov is None else float(np.sum(np.linalg.solve(cov, deviation[..., None])[..., 0] * deviation))
    return AveragedCorners(
        landmark_ids=ids,
        uv_px=mean,
        sigma_px=np.nanmedian(sigma_px, axis=0),
        cov_px2=cov,
        counts=counts,
        scatter_px2=np.einsum("fli,flj->ij", deviation, deviation),
        normalised=normalised / 2,
        freedom=int(np.sum(counts - 1)),
        frames=len(frames),
    )


def _mean_covariance(frames: Sequence[TagDetections], landmark_ids: Ids) -> Array | None:
    """Return the mean over frames of the landmarks' covariances in one, (L, 2, 2) px^2; None if a frame has none."""
    total, count = np.zeros((landmark_ids.size, 2, 2)), np.zeros(landmark_ids.size)
    for frame in frames:
        if frame.ids.size and frame.cov_px2 is None:
            return None
        _, at, within = np.intersect1d(landmark_ids, frame.landmark_ids, assume_unique=True, return_indices=True)
        if at.size and frame.cov_px2 is not None:
            total[at] += frame.cov_px2.reshape(-1, 2, 2)[within]
            count[at] += 1
    return np.asarray(total / count[:, None, None])


def covariances(by_stop: Sequence[AveragedCorners], floor_px: float = FLOOR_PX) -> list[Array]:
    """Return the covariance of each stop's landmarks, (L, 2, 2) px^2 each.

    The stated covariance of a frame's corners is noise, which a mean over n frames has one n-th of, and what the tags'
    model does not follow, which is the same in every frame as long as the robot stands. The frames' scatter, pooled
    over all landmarks of all stops, says what fraction is noise. So a covariance that is stated too large counts as
    something that stays, and one too small hides it: frames alone cannot tell these apart. Where frames do not
    determine it (lines were fitted), the scatter itself is the noise. What does not average out
    (``AveragedCorners.sigma_px``, at least the floor) is added.
    """
    freedom = sum(s.freedom for s in by_stop)
    fixed = [np.maximum(s.sigma_px, floor_px)[:, None, None] ** 2 * np.eye(2) for s in by_stop]
    stated = [s.cov_px2 for s in by_stop if s.cov_px2 is not None]
    if len(stated) == len(by_stop):
        noise = sum(s.normalised for s in by_stop) / freedom if freedom else 1.0
        return [
            (cov if s.of_mean else cov * (noise / s.counts + max(1 - noise, 0.0))[:, None, None]) + least
            for s, cov, least in zip(by_stop, stated, fixed, strict=True)
        ]
    scatter = np.sum([s.scatter_px2 for s in by_stop], axis=0)
    frame_px2 = scatter / freedom if freedom else np.zeros((2, 2))
    return [frame_px2 / s.counts[:, None, None] + least for s, least in zip(by_stop, fixed, strict=True)]
