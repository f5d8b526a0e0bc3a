"""The frames of a stop combined: where each landmark was seen, and how well."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from detect.tags import Tags
from detect.wheels import Array, Ids

FLOOR_PX = 0.03
"""Least standard deviation per axis of a landmark, px, whatever its tag says."""
_SEEN_IN = 0.5
_OUTLIER_SIGMAS = 5.0
_LEAST_OUTLIER_PX = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sighting:
    """What the frames of one stop agree on.

    Attributes
    ----------
    landmark_ids : (L,)
        Ascending.
    uv_px : (L, 2), px
        Mean over frames.
    sigma_px : (L,), px
        Standard deviation per axis that no number of frames goes below: the pixel grid and compression do the same to
        a corner in every frame of a stop (median over frames of what its tag says).
    counts : (L,)
        Frames in each mean.
    scatter_px2 : (2, 2), px^2
        Sum over landmarks and frames of the outer products of deviations from the means.
    freedom
        Degrees of freedom of that sum.
    frames
        How many frames were combined.
    """

    landmark_ids: Ids
    uv_px: Array
    sigma_px: Array
    counts: Ids
    scatter_px2: Array
    freedom: int
    frames: int

    @property
    def tags(self) -> int:
        """How many tags have all four corners."""
        return int(np.sum(np.unique(self.landmark_ids // 4, return_counts=True)[1] == 4))


def combine(frames: Sequence[Tags]) -> Sighting:
    """Combine the frames of one stop.

    A landmark counts if at least half of the frames show it. Its place is the mean of those within five standard
    deviations of the median; the standard deviation is read off the deviations of all landmarks from their medians
    (median absolute deviation), so a frame that is off at one tag does not widen it.
    """
    ids = np.unique(np.concatenate([f.landmark_ids for f in frames])) if frames else np.zeros(0, dtype=np.int64)
    uv, sigma_px = np.full((len(frames), ids.size, 2), np.nan), np.full((len(frames), ids.size), np.nan)
    for k, frame in enumerate(frames):
        at = np.searchsorted(ids, frame.landmark_ids)
        uv[k, at], sigma_px[k, at] = frame.corners_px.reshape(-1, 2), np.repeat(frame.sigma_px, 4)
    often = np.sum(np.isfinite(uv[..., 0]), axis=0) >= max(1.0, _SEEN_IN * len(frames))
    ids, uv, sigma_px = ids[often], uv[:, often], sigma_px[:, often]
    if ids.size == 0:
        return Sighting(
            landmark_ids=ids,
            uv_px=np.zeros((0, 2)),
            sigma_px=np.zeros(0),
            counts=np.zeros(0, dtype=np.int64),
            scatter_px2=np.zeros((2, 2)),
            freedom=0,
            frames=len(frames),
        )
    off = np.linalg.norm(uv - np.nanmedian(uv, axis=0), axis=2)
    # the radius of 2-D Gaussian noise has the median 1.1774 sigma
    noise = float(np.nanmedian(off)) / 1.1774
    good = off <= max(_OUTLIER_SIGMAS * noise, _LEAST_OUTLIER_PX)
    counts = np.sum(good, axis=0)
    kept = counts >= max(1.0, _SEEN_IN * len(frames))
    ids, uv, sigma_px, good, counts = ids[kept], uv[:, kept], sigma_px[:, kept], good[:, kept], counts[kept]
    seen = np.where(good[..., None], uv, 0.0)
    mean = seen.sum(axis=0) / counts[:, None]
    deviation = np.where(good[..., None], uv - mean, 0.0)
    return Sighting(
        landmark_ids=ids,
        uv_px=mean,
        sigma_px=np.nanmedian(sigma_px, axis=0),
        counts=counts,
        scatter_px2=np.einsum("fli,flj->ij", deviation, deviation),
        freedom=int(np.sum(counts - 1)),
        frames=len(frames),
    )


def covariances(sightings: Sequence[Sighting], floor_px: float = FLOOR_PX) -> list[Array]:
    """Return the covariance of each stop's landmarks, (L, 2, 2) px^2 each.

    The noise of one frame is pooled over all landmarks of all stops; a mean over n frames has one n-th of it, plus
    what does not average out (``Sighting.sigma_px``, at least the floor). With one frame a stop there is no scatter to
    pool and the latter stands alone.
    """
    freedom = sum(s.freedom for s in sightings)
    scatter = np.sum([s.scatter_px2 for s in sightings], axis=0) if sightings else np.zeros((2, 2))
    frame_px2 = scatter / freedom if freedom else np.zeros((2, 2))
    return [
        frame_px2 / s.counts[:, None, None] + (np.maximum(s.sigma_px, floor_px) ** 2)[:, None, None] * np.eye(2)
        for s in sightings
    ]
