"""Align tags with an image: batched Gauss-Newton on homography, light and blur of every tag at once."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from detect.align import model
from detect.align.homography import to_square
from detect.align.lens import bend, bend_jacobian, straighten
from detect.align.model import GAIN, KURTOSIS, LOG_SIGMA, OFFSET, PARAMETERS, Frame, Sums
from detect.align.pattern import Array, Index, Patterns

MIN_SIGMA_PX, MAX_SIGMA_PX = 0.27, 12.0
START_SIGMA_PX = 0.8
KURTOSIS_PRIOR, KURTOSIS_RANGE = 0.5, (-1.3, 1.5)
MARGIN_MODULES = 0.9
ITERATIONS = 10
STOP_PX = 0.02
EDGE_SIDE_PX = 30.0
"""Of tags larger than this not even the pixels at edges are all used."""
MUCH = 0.6
"""A step that explains this share of the squared residuals is not the last."""
_DAMPING, _FIRST_DAMPING = 1e-6, 1e-3
_LONGEST_MODULES, _LONGEST_LOG, _MOST_EXPLAINED = 0.8, 0.35, 0.98

_NEXT = np.array([1, 2, 3, 0])
_FIBONACCI = np.array([1, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233, 377, 610, 987], dtype=np.int64)


def _free(*names: slice) -> NDArray[np.bool_]:
    chosen = np.zeros(PARAMETERS, dtype=np.bool_)
    for part in names:
        chosen[part] = True
    return chosen


_LIGHT, _AFFINE, _PERSPECTIVE = slice(OFFSET, LOG_SIGMA), slice(0, 6), slice(0, 8)
_BLUR, _SHAPE = slice(LOG_SIGMA, LOG_SIGMA + 1), slice(KURTOSIS, KURTOSIS + 1)
_FIRST = (
    _free(_LIGHT, _BLUR, _AFFINE),
    _free(_LIGHT, _BLUR, _PERSPECTIVE),
)
_FURTHER = (_free(_LIGHT, _BLUR, _PERSPECTIVE, _SHAPE),)
_AGAIN = (_free(_LIGHT), *_FURTHER, *_FURTHER)
"""What each step may change."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Aligned:
    """Tags aligned with an image.

    Attributes
    ----------
    rows : (N,)
        Row of each tag in the patterns.
    corners_px : (N, 4, 2), px
        Corners in the image (distorted, as seen).
    cov_px2 : (N, 4, 2, 2), px^2
        Covariance of each corner from the residuals.
    sigma_px : (N,), px
        Deviation of blur and pixel area together.
    offset, gain : (N,)
        Light of black modules, and white less black; 1 is full scale.
    correlation : (N,)
        Of the image with the aligned pattern.
    worst_block : (N,)
        Largest mean residual of a block of two by two modules, as a share of the contrast.
    worst_module : (N,)
        The same of a single module; 0 where modules have too few pixels to say.
    noise : (N,)
        Deviation of the residuals; 1 is full scale.
    theta : (N, 14)
        All parameters (see :mod:`detect.align.model`).
    place : (N, 3)
        Their centres and scales.
    """

    rows: Index
    corners_px: Array
    cov_px2: Array
    sigma_px: Array
    offset: Array
    gain: Array
    correlation: Array
    worst_block: Array
    worst_module: Array
    noise: Array
    theta: Array
    place: Array

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, at: NDArray[np.bool_] | Index) -> "Aligned":
        """Return some of the tags."""
        return Aligned(**{name: getattr(self, name)[at] for name in self.__dataclass_fields__})

    def joined(self, more: "Aligned") -> "Aligned":
        """Return these tags and others."""
        return Aligned(
            **{name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in self.__dataclass_fields__}
        )


class Accumulate(Protocol):
    """Sums over the pixels of tags, see :func:`detect.align.model.accumulate`."""

    def __call__(  # noqa: D102, PLR0917 - the class says it
        self,
        frame: Frame,
        cells: Array,
        rows: Index,
        theta: Array,
        place: Array,
        boxes: NDArray[np.int64],
        margin: Array,
        stride: NDArray[np.int64],
    ) -> Sums: ...


def align(
    frame: Frame,
    patterns: Patterns,
    rows: Index,
    corners_px: Array,
    *,
    start: Aligned | None = None,
    relight: bool = False,
    stop_px: float = STOP_PX,
    iterations: int = ITERATIONS,
    side_px: float = np.inf,
    covariance: bool = True,
    sums_of: Accumulate | None = None,
) -> Aligned:
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
    relight
        The light of ``start`` is a guess (it was told under another tone curve).
    stop_px
        A tag is done once its corners move less and its residuals have settled.
    iterations
        At most so many Gauss-Newton steps.
    side_px
        Use no more pixels of a tag than one with sides of this length has.
    covariance
        Without it covariances come back as zero.
    sums_of
        Take the steps in numpy with these sums; without it they are compiled where numba is installed.

    Returns
    -------
    Aligned
        As many as went in, in their order; those that diverged have a correlation of -1.
    """
    schedule = _FIRST if start is None else (_AGAIN if relight else _FURTHER)
    place, places, theta = _start(frame.lens, patterns, corners_px)
    if start is not None:
        theta[:, OFFSET:] = start.theta[:, OFFSET:]
    boxes, margin, stride, module_px = footprints(
        frame, patterns, corners_px, theta[:, LOG_SIGMA], side_px=side_px, edges=start is not None
    )
    last = model.no_sums(len(rows), patterns.cells)
    (_descent() if sums_of is None else partial(_descend, sums_of))(
        frame, patterns.cells, rows, theta, place, boxes, margin, stride, last,
        places=places, module_px=module_px, free=np.stack(schedule),
        damping=_DAMPING if start is not None else _FIRST_DAMPING, stop_px=stop_px, iterations=iterations,
        guess=start is None,
    )  # fmt: skip
    finishing = finish if sums_of is not None else _finishing()
    corners, cov, figures = finishing(frame, patterns, theta=theta, place=place, sums=last, covariance=covariance)
    good = np.isfinite(corners).all(axis=(1, 2)) & np.isfinite(cov).all(axis=(1, 2, 3))
    good &= last.stats[:, 0] > 2 * PARAMETERS
    return Aligned(
        rows=rows,
        corners_px=np.where(good[:, None, None], corners, 0.0),
        cov_px2=np.where(good[:, None, None, None], cov, 1.0),
        sigma_px=np.exp(theta[:, LOG_SIGMA]),
        offset=theta[:, OFFSET],
        gain=theta[:, GAIN],
        correlation=np.where(good, figures[:, 0], -1.0),
        worst_block=figures[:, 1],
        worst_module=figures[:, 2],
        noise=figures[:, 3],
        theta=theta,
        place=place,
    )


@cache
def _finishing() -> Callable[..., tuple[Array, Array, Array]]:
    """Return the compiled end of an alignment where numba is installed, else that in numpy."""
    try:
        from detect.align.compiled import finish as compiled  # noqa: PLC0415 - optional and slow to import
    except ImportError:
        return finish

    def run(
        frame: Frame, patterns: Patterns, *, theta: Array, place: Array, sums: Sums, covariance: bool
    ) -> tuple[Array, Array, Array]:
        n = len(theta)
        corners, cov, figures = np.empty((n, 4, 2)), np.zeros((n, 4, 2, 2)), np.empty((n, 4))
        compiled.finish(
            frame.lens, patterns.modules, theta, place, sums.normal, sums.stats, sums.blocks, KURTOSIS_PRIOR,
            covariance, corners, cov, figures,
        )  # fmt: skip
        return corners, cov, figures

    return run


@cache
def _descent() -> Callable[..., None]:
    """Return the compiled steps where numba is installed, else those in numpy."""
    try:
        from detect.align.compiled.descent import descend  # noqa: PLC0415 - optional and slow to import
    except ImportError:
        return partial(_descend, model.accumulate)
    limits = np.array([np.log([MIN_SIGMA_PX, MAX_SIGMA_PX]), KURTOSIS_RANGE])
    held = (_LONGEST_MODULES, _LONGEST_LOG, _MOST_EXPLAINED)
    return partial(descend, limits=limits, held=held, much=MUCH, prior=KURTOSIS_PRIOR)


def _descend(  # noqa: PLR0917 - the sums' arguments first
    sums_of: Accumulate,
    frame: Frame,
    cells: Array,
    rows: Index,
    theta: Array,
    place: Array,
    boxes: NDArray[np.int64],
    margin: Array,
    stride: NDArray[np.int64],
    last: Sums,
    *,
    places: Array,
    module_px: Array,
    free: NDArray[np.bool_],
    damping: float,
    stop_px: float,
    iterations: int,
    guess: bool,
) -> None:
    """Take steps until each tag stands still; for the arguments see :func:`detect.align.compiled.descent.descend`."""
    if guess:
        model.first_light(frame, cells, rows, theta, place, boxes, margin, stride)
    active = np.arange(len(rows))
    for step_no in range(iterations):
        if len(active) == 0:
            break
        sums = sums_of(
            frame, cells, rows[active], theta[active], place[active], boxes[active], margin[active], stride[active]
        )
        step = _step(sums, theta[active], free[min(step_no, len(free) - 1)], damping)
        stepped = _stepped(theta[active], step)
        less = _explained(sums, stepped - theta[active])
        converging = less > MUCH * sums.stats[:, 1]
        sums.stats[:, 1] -= less
        _put(last, active, sums)
        moved = model.apply_h(stepped, places[active]) - model.apply_h(theta[active], places[active])
        theta[active] = stepped
        moved_px = np.abs(moved).max(axis=(1, 2)) * module_px[active]
        if step_no >= len(free) - 1:
            active = active[~(moved_px < stop_px) | converging]


def _explained(sums: Sums, step: Array) -> Array:
    """Return by how much a step lessens the sums of squared residuals (N,), by the linear model; at most by all."""
    less = 2 * np.einsum("ni,ni->n", step, sums.gradient) - np.einsum("ni,nij,nj->n", step, sums.normal, step)
    return np.asarray(np.clip(less, 0, _MOST_EXPLAINED * sums.stats[:, 1]))


def _put(sums: Sums, at: Index, some: Sums) -> None:
    for name in Sums.__dataclass_fields__:
        getattr(sums, name)[at] = getattr(some, name)


def footprints(
    frame: Frame, patterns: Patterns, corners_px: Array, log_sigma: Array, *, side_px: float, edges: bool
) -> tuple[NDArray[np.int64], Array, NDArray[np.int64], Array]:
    """Return which pixels of tags to use: boxes (N, 4), margins (N,) and strides (N, 3), and modules' widths (N,), px.

    For the first three see :func:`detect.align.model.accumulate`. So much of the white ring may be used that its
    neighbours' blur does not reach. Of large tags no more pixels are used than one with sides of ``side_px`` has, on a
    Fibonacci lattice: of m pixels one, in each row shifted by q. Unlike every second row and column it meets a module's
    edges at all phases, also where they run along the pixels. With ``edges``, of the pixels that an edge blurs all
    count, or of very large tags every n-th.
    """
    m = patterns.modules
    corners = np.nan_to_num(corners_px)
    along = corners[:, _NEXT] - corners
    side = np.hypot(along[..., 0], along[..., 1])
    blur = np.exp(np.clip(log_sigma, -2, 2)) * m / np.maximum(side.min(axis=1), 1e-3)
    margin = np.clip(patterns.gap_modules - 2.5 * blur, 0.35, min(MARGIN_MODULES, 0.9 * patterns.gap_modules))
    centre = corners.mean(axis=1, keepdims=True)
    grown = centre + (corners - centre) * (1 + 2.2 * margin / m)[:, None, None]
    boxes = np.empty((len(corners), 2, 2), dtype=np.int64)
    limit = frame.grey.shape[::-1]
    boxes[:, :, 0] = np.clip(np.floor(grown.min(axis=1)), 0, limit)
    boxes[:, :, 1] = np.clip(np.ceil(grown.max(axis=1)) + 1, 0, limit)
    mean = side.mean(axis=1)
    at = np.searchsorted(_FIBONACCI, (mean / side_px) ** 2, side="right") - 1
    at = np.clip(at, 1, len(_FIBONACCI) - 1)
    stride = np.stack([_FIBONACCI[at], _FIBONACCI[at - 1], _FIBONACCI[at]], axis=1)
    if edges:
        stride[:, 2] = np.clip(mean / EDGE_SIDE_PX, 1, 1000)
    return boxes.reshape(-1, 4), margin, stride, side.max(axis=1) / m


def _start(lens: Array, patterns: Patterns, corners_px: Array) -> tuple[Array, Array, Array]:
    """Return centres and scales (N, 3), the corners' normalised places (N, 4, 2) and parameters (N, 14)."""
    place = np.empty((len(corners_px), 3))
    place[:, :2] = corners_px.mean(axis=1)
    apart = corners_px - place[:, None, :2]
    place[:, 2] = 1 / np.maximum(np.hypot(apart[..., 0], apart[..., 1]).max(axis=1), 1.0)
    places = straighten(lens, place, corners_px)
    theta = np.zeros((len(corners_px), PARAMETERS))
    theta[:, :8] = to_square(places, patterns.modules)
    theta[:, OFFSET], theta[:, GAIN] = 0.2, 0.5
    theta[:, LOG_SIGMA] = np.log(START_SIGMA_PX)
    return place, places, theta


def _step(sums: Sums, theta: Array, free: NDArray[np.bool_], damping: float) -> Array:
    normal, gradient = sums.normal.copy(), sums.gradient.copy()
    prior = _kurtosis_prior(sums.stats)
    normal[:, KURTOSIS, KURTOSIS] += prior
    gradient[:, KURTOSIS] -= prior * theta[:, KURTOSIS]
    diagonal = np.einsum("nii->ni", normal)
    damp = np.where(diagonal > 1e-12, damping * diagonal, 1.0)
    normal += damp[:, :, None] * np.eye(PARAMETERS)
    step = np.zeros(gradient.shape)
    step[:, free] = np.linalg.solve(normal[:, free][:, :, free], gradient[:, free, None])[..., 0]
    return step


def _kurtosis_prior(stats: Array) -> Array:
    """Return the information (N,) that the prior on the kurtosis adds, in units of the residuals."""
    n, r2 = stats[:, 0], stats[:, 1]
    return np.asarray(np.maximum(r2, 1e-9) / np.maximum(n - PARAMETERS, 1) / KURTOSIS_PRIOR**2)


def _stepped(theta: Array, step: Array) -> Array:
    """Return the parameters after a step, held back where it would leave what the model can follow."""
    step = np.nan_to_num(step, nan=0.0, posinf=0.0, neginf=0.0)
    reach = np.abs(step[:, [2, 5]]).max(axis=1)
    held = np.minimum(1.0, _LONGEST_MODULES / np.maximum(reach, 1e-12))
    step[:, :8] *= held[:, None]
    step[:, LOG_SIGMA] = np.clip(step[:, LOG_SIGMA], -_LONGEST_LOG, _LONGEST_LOG)
    new = theta + step
    new[:, KURTOSIS] = np.clip(new[:, KURTOSIS], *KURTOSIS_RANGE)
    new[:, LOG_SIGMA] = np.clip(new[:, LOG_SIGMA], np.log(MIN_SIGMA_PX), np.log(MAX_SIGMA_PX))
    return new


def _normalised_corners(patterns: Patterns, theta: Array) -> Array:
    """Return the corners (N, 4, 2) in normalised places: H inverted by its adjugate; NaN where it is singular."""
    h0, h1, h2, h3, h4, h5, h6, h7 = theta[:, :8].T
    u, v = patterns.corners[:, 0, None], patterns.corners[:, 1, None]
    x = (h4 - h5 * h7) * u + (h2 * h7 - h1) * v + (h1 * h5 - h2 * h4)
    y = (h5 * h6 - h3) * u + (h0 - h2 * h6) * v + (h2 * h3 - h0 * h5)
    w = (h3 * h7 - h4 * h6) * u + (h1 * h6 - h0 * h7) * v + (h0 * h4 - h1 * h3)
    with np.errstate(divide="ignore", invalid="ignore"):
        corners = np.stack([x / w, y / w], -1).transpose(1, 0, 2)
    return np.where(np.abs(corners) < 1e3, corners, np.nan)


def finish(
    frame: Frame, patterns: Patterns, *, theta: Array, place: Array, sums: Sums, covariance: bool
) -> tuple[Array, Array, Array]:
    """Return corners (N, 4, 2), px, covariances (N, 4, 2, 2), px^2, and correlation, worst block and module, noise."""
    corners = bend(frame.lens, place, _normalised_corners(patterns, theta))
    n, r2, y, y2, p, p2 = sums.stats.T
    count = np.maximum(n, 1)
    var_y, var_p = y2 / count - (y / count) ** 2, p2 / count - (p / count) ** 2
    cross = 0.5 * (y2 + p2 - r2) / count - (y / count) * (p / count)
    correlation = np.minimum(cross / np.sqrt(np.maximum(var_y * var_p, 1e-12)), 1.0)
    noise2 = r2 / np.maximum(n - PARAMETERS, 1)
    cov = _covariance(frame, sums, noise2, theta, place, corners) if covariance else np.zeros((len(theta), 4, 2, 2))
    mean = sums.blocks[..., 0] / np.maximum(sums.blocks[..., 1], 1)
    contrast = np.maximum(np.sqrt(np.maximum(var_y, 0)) * 2, 1e-6)
    worst_module = np.where(sums.blocks[..., 1] >= 4, np.abs(mean), 0).max(axis=(1, 2)) / contrast
    even = np.pad(sums.blocks, ((0, 0), (0, sums.blocks.shape[1] % 2), (0, sums.blocks.shape[2] % 2), (0, 0)))
    fours = even[:, ::2, ::2] + even[:, 1::2, ::2] + even[:, ::2, 1::2] + even[:, 1::2, 1::2]
    mean = fours[..., 0] / np.maximum(fours[..., 1], 1)
    worst = np.where(fours[..., 1] >= 2, np.abs(mean), 0).max(axis=(1, 2)) / contrast
    return corners, cov, np.stack([correlation, worst, worst_module, np.sqrt(noise2)], axis=1)


def _covariance(  # noqa: PLR0917
    frame: Frame, sums: Sums, noise2: Array, theta: Array, place: Array, corners: Array
) -> Array:
    """Return the corners' covariances (N, 4, 2, 2): residual variance by the inverse normal matrix."""
    cov_h = inverse_normal(sums.normal, sums.stats)[:, :8, :8] * noise2[:, None, None]
    D = corners_by_homography(frame, theta, place, corners)
    cov = np.einsum("ncik,nkl,ncjl->ncij", D, cov_h, D)
    return np.asarray(cov)


def inverse_normal(normal: Array, stats: Array) -> Array:
    """Return the inverses (N, 14, 14) of normal matrices, the prior on the kurtosis added."""
    normal = normal.copy()
    normal[:, range(PARAMETERS), range(PARAMETERS)] += 1e-12 + 1e-9 * np.einsum("nii->ni", normal)
    normal[:, KURTOSIS, KURTOSIS] += _kurtosis_prior(stats)
    return np.asarray(np.linalg.inv(normal))


def corners_by_homography(frame: Frame, theta: Array, place: Array, corners_px: Array) -> Array:
    """Return how corners (N, 4, 2), px, move with the homographies' entries: (N, 4, 2, 8)."""
    D = _corner_jacobian(theta, straighten(frame.lens, place, corners_px)) / place[:, 2, None, None, None]
    return np.asarray(np.einsum("ncij,ncjk->ncik", bend_jacobian(frame.lens, place, corners_px), D))


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
