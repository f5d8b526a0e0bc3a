"""Frames of a stop compared: which of them show the same still image, each up to its exposure.

A frame is the reference under a gain and an offset of its grey levels (of a power law, as response curves nearly are,
an exposure is a factor of the grey level too), moved by a fraction of a pixel. The gain, the offset and the motion are
fitted to the pixels where the image has its strongest gradients, with Tukey's weights, so that a passer-by in a
corner of the image counts for nothing (Lucas and Kanade 1981 for the motion; Huber and Ronchetti, Robust Statistics,
2009, for the weights). The reference is the median over the frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.target.arrays import Array

POINTS = 1500
"""Pixels that are compared."""
_SPACING_PX = 2
"""Of every square of so many pixels a side one is a candidate: its neighbour's edge is the same edge."""
MOST_MOTION_PX, MOTION_SIGMAS = 0.1, 5.0
"""A frame that is displaced by more than this, and by more than noise explains, moved."""
CHANGED_SIGMAS, MOST_CHANGED = 6.0, 0.02
"""A frame in which more than this fraction of the pixels differ by so many deviations of the noise is not the same."""
_LEAST_NOISE = 0.5
"""Grey levels of 255: rounding alone has a deviation of 0.3."""
BANDS, MOST_BANDING = 8, 0.02
"""Lamps flicker in horizontal bands of a rolling shutter: bands compared, and their largest deviation in gain."""
_SAMPLED = 16
"""One in so many candidates shows about how strong the strongest are."""
_SMOOTH = np.array([0.125, 0.25, 0.125], dtype=np.float32)
_ROUNDS = 2
_MAD = 1.4826
"""Standard deviation of normal noise over its median absolute deviation."""
_TUKEY = 4.685
"""Tukey's constant: 95 % of the efficiency of least squares under normal noise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stillness:
    """Differences of a stop's frames from the image that most of them show.

    Attributes
    ----------
    kept : (N,)
        Which frames show the same still image.
    moved, flickered, changed : (N,)
        Why the others do not: displaced; lit in bands; covered or changed in part.
    gain, offset : (N,)
        Of each frame's grey levels against the median frame's; the offset in grey levels.
    motion_px : (N, 2)
        Displacement against the median frame.
    noise
        Deviation of a pixel from frame to frame at edges, grey levels; NaN of a single frame.
    settled
        Whether most frames show one image; if not, all are kept, and they were hardly taken at rest.
    displacement_px2 : (2, 2), px^2
        Covariance of the place at which the mean of the kept frames shows the box; zero where noise explains motion.
    """

    kept: NDArray[np.bool_]
    moved: NDArray[np.bool_]
    flickered: NDArray[np.bool_]
    changed: NDArray[np.bool_]
    gain: Array
    offset: Array
    motion_px: Array
    noise: float
    settled: bool
    displacement_px2: Array

    @property
    def left_out(self) -> str:
        """Phrase with the number of frames left out and the reasons; empty if none is."""
        reasons = (("moved", self.moved), ("changed in part (covered?)", self.changed), ("flickered", self.flickered))
        told, seen = [], self.kept.copy()
        for word, which in reasons:
            new = which & ~seen
            seen |= new
            if new.any():
                told.append(f"{int(new.sum())} {word}")
        return ", ".join(told)


def compare_frames(frames: Sequence[DeepGrey], mean: NDArray[np.float32]) -> Stillness:
    """Compare frames (H, W) of one size and depth with the image that most of them show.

    Parameters
    ----------
    frames
        One at least.
    mean : (H, W)
        Of all frames, in their grey levels.
    """
    n = len(frames)
    scale = 1.0 if frames[0].dtype == np.uint8 else 257.0
    at, gradient = _strong_gradients(mean, scale)
    values = np.stack([frame.ravel()[at] for frame in frames]).astype(np.float64)
    reference = np.median(values, axis=0)
    coefficients, residuals, motion_sigma = _fits(values, reference, gradient)
    noise = max(_frame_noise(residuals), _LEAST_NOISE * scale)
    motion = coefficients[:, 2:] - np.median(coefficients[:, 2:], axis=0)
    motion_sigma = motion_sigma * noise
    size = np.linalg.norm(motion, axis=1)
    moved = size > np.maximum(MOST_MOTION_PX, MOTION_SIGMAS * motion_sigma.max(axis=1))
    changed = np.mean(np.abs(residuals) > CHANGED_SIGMAS * noise, axis=1) > MOST_CHANGED
    flickered = _banding(values, reference, at // mean.shape[1], mean.shape[0]) > MOST_BANDING
    kept = ~(moved | changed | flickered)
    settled = n == 1 or bool((~(moved | changed)).sum() * 2 > n)
    # where no image has a majority, nothing says which frame is right
    if kept.sum() * 2 <= n and n > 1:
        kept = ~(moved | changed) if settled else np.ones(n, dtype=np.bool_)
    used = residuals[kept]
    return Stillness(
        kept=kept,
        moved=moved & ~kept,
        flickered=flickered & ~kept,
        changed=changed & ~kept,
        gain=1 + coefficients[:, 0],
        offset=coefficients[:, 1],
        motion_px=motion,
        noise=_temporal_noise(used, int(kept.sum())) if n > 1 else float("nan"),
        settled=settled,
        displacement_px2=_displacement(motion[kept], motion_sigma[kept], settled=settled),
    )


def _frame_noise(residuals: Array) -> float:
    """Return the standard deviation of a pixel's noise in one frame by robust differences of frames; residuals (N, P).

    Not by differences from the median frame: of three frames each is the median in a third of the pixels. Each is
    compared with those before and after it, of which the more alike counts; copies of one image carry no information.
    """
    apart = np.abs(residuals - np.roll(residuals, 1, axis=0))
    pair = _MAD * np.median(apart, axis=1) / np.sqrt(2)
    pair[~apart.any(axis=1)] = np.inf
    beside = np.minimum(pair, np.roll(pair, -1))
    told = beside[np.isfinite(beside)]
    return float(np.median(told)) if told.size else 0.0


def _displacement(motion_px: Array, sigma_px: Array, *, settled: bool) -> Array:
    """Return the covariance (2, 2), px^2, of the mean place of frames displaced by (N, 2) px; zero if noise does that.

    Small displacements about one place lessen with the number of frames. Where no place is that of most frames, the
    robot may have been moving, and the mean be any of theirs.
    """
    n = len(motion_px)
    if n < 2 or not (np.linalg.norm(motion_px, axis=1) > MOTION_SIGMAS * sigma_px.max(axis=1)).any():
        return np.zeros((2, 2))
    return np.cov(motion_px.T) / (n if settled else 1)


def _strong_gradients(picture: NDArray[np.float32], scale: float) -> tuple[NDArray[np.int64], Array]:
    """Return the flat indices (P,) of the pixels with the strongest gradients, spread out, and the gradients (P, 2).

    ``scale`` brings grey levels to 8 bits.
    """
    width, step = picture.shape[1], _SPACING_PX
    # chosen by Sobel's gradients of whole grey levels, which are fast
    inner = (slice(1, -1, step), slice(1, -1, step))
    grey8 = cv2.convertScaleAbs(picture, alpha=1 / scale)
    across, down = (g[inner].astype(np.float32) for g in cv2.spatialGradient(grey8))
    strength = across**2 + down**2
    best = _largest(strength.ravel(), min(POINTS, strength.size))
    row, column = np.divmod(best, strength.shape[1])
    at = (1 + step * row) * width + 1 + step * column
    flat = picture.ravel()
    left, right = (flat[at[:, None] + np.arange(-1, 2) * width + side] @ _SMOOTH for side in (-1, 1))
    above, below = (flat[at[:, None] + np.arange(-1, 2) + side * width] @ _SMOOTH for side in (-1, 1))
    return at.astype(np.int64), np.stack([right - left, below - above], axis=1).astype(np.float64)


def _largest(values: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Return which are the largest of values (V,), ``count`` of them, in any order.

    Among those only that a sample says may be: of equal ones any is as good as another.
    """
    some = values[::_SAMPLED]
    wanted = min(2 * count // _SAMPLED + 1, len(some))
    among = np.flatnonzero(values >= np.partition(some, len(some) - wanted)[len(some) - wanted])
    if len(among) < count:
        among = np.arange(len(values))
    return np.asarray(among[np.argpartition(values[among], len(among) - count)[len(among) - count :]])


def _fits(values: Array, reference: Array, gradient: Array) -> tuple[Array, Array, Array]:
    """Return gain less one, offset and motion (N, 4) of frames, residuals (N, P), and the motion's sigma (N, 2).

    Values are (N, P), the reference (P,), its gradients (P, 2). All frames are fitted at once.
    """
    A = np.column_stack([reference, np.ones(len(reference)), -gradient])
    products = (A[:, :, None] * A[:, None, :]).reshape(len(A), -1)
    least = 1e-9 * np.diag((A**2).sum(axis=0) + 1e-9)
    y, weight = values - reference, np.ones_like(values)
    for _ in range(_ROUNDS):
        normal = (weight @ products).reshape(-1, 4, 4) + least
        x = np.linalg.solve(normal, ((weight * y) @ A)[:, :, None])[:, :, 0]
        r = y - x @ A.T
        width = _TUKEY * max(_frame_noise(r), 1e-3)
        weight = np.maximum(1 - (r / width) ** 2, 0) ** 2
    return x, r, np.sqrt(np.diagonal(np.linalg.inv(normal), axis1=1, axis2=2)[:, 2:])


def _banding(values: Array, reference: Array, rows: NDArray[np.int64], height: int) -> Array:
    """Return the largest deviation (N,) of a horizontal band's gain from that of the whole frame; values are (N, P)."""
    bright = reference > np.median(reference)
    if not bright.any():
        return np.zeros(len(values))
    band = (rows * BANDS // height)[bright]
    ratio = values[:, bright] / np.maximum(reference[bright], 1e-9)
    whole = np.median(ratio, axis=1)
    most = np.zeros(len(values))
    for k in range(BANDS):
        here = band == k
        if here.sum() >= 100:
            most = np.maximum(most, np.abs(np.median(ratio[:, here], axis=1) / whole - 1))
    return most


def _temporal_noise(residuals: Array, n: int) -> float:
    """Return the deviation of a pixel's noise from residuals (N, P) against the median of the frames."""
    if n < 2:
        return float("nan")
    apart = residuals - residuals.mean(axis=0)
    return float(_MAD * np.median(np.abs(apart)) * np.sqrt(n / (n - 1)))
