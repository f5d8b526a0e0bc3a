"""A tag in the picture: light, response curve and pattern make grey levels; sums over its pixels tell how to fit them.

The light is ``m = o + g P + (s_x x + s_y y)(P + kappa)`` with the blurred pattern P
(:mod:`boxcal.detect.alignment.registration.psf`), kappa = o / g held fixed, and the grey level T(m).

This module is the reference in numpy; :mod:`boxcal.detect.alignment.numba.image_model` computes the same sums compiled.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.radial_camera import undistort_locally
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST, GRADIENT_X, GRADIENT_Y, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.psf import pattern_value
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.target.arrays import Array

MIDDLE = 0.3
"""Half the width of the middle of a module, modules: there blur hardly mixes black and white."""
LEAST_CONTRAST = 1e-3
CLUSTERS = 6
"""Squares of the image each way that a tag is divided into, see :func:`squares`."""
STATS = 6
"""n, sum r^2, sum y, sum y^2, sum p, sum p^2 have columns 0..5; y grey level, p prediction."""


class Sums(NamedTuple):
    """Normal equations of many tags, and what the verification needs.

    Attributes
    ----------
    normal : (N, 14, 14)
    gradient : (N, 14)
        J^T r with r = grey level - prediction.
    stats : (N, 6)
    blocks : (N, M + 2, M + 2, 2)
        Sum of residuals and number of pixels in each module, white ring included.
    """

    normal: Array
    gradient: Array
    stats: Array
    blocks: Array


def apply_h(h: Array, xy: Array) -> Array:
    """Return ``H(x, y)`` (N, P, 2) for homographies (N, 8), last entry 1, and places (N, P, 2)."""
    x, y = xy[..., 0], xy[..., 1]
    w = h[:, 6, None] * x + h[:, 7, None] * y + 1
    u = h[:, 0, None] * x + h[:, 1, None] * y + h[:, 2, None]
    v = h[:, 3, None] * x + h[:, 4, None] * y + h[:, 5, None]
    return np.stack([u / w, v / w], -1)


def accumulate(batch: Batch) -> Sums:
    """Return the normal equations of tags at their present parameters."""
    sums = no_sums(len(batch), batch.cells)
    for k in range(len(batch)):
        seen = differentiate(batch, k)
        if seen is None:
            continue
        J, grey, predicted = seen.jacobian, seen.grey, seen.predicted
        r = grey - predicted
        sums.normal[k] = J.T @ J
        sums.gradient[k] = J.T @ r
        sums.stats[k] = (len(r), r @ r, grey.sum(), grey @ grey, predicted.sum(), predicted @ predicted)
        at = np.clip((seen.uv + 1).astype(int), 0, sums.blocks.shape[1] - 1)
        np.add.at(sums.blocks[k, :, :, 0], (at[:, 1], at[:, 0]), r)
        np.add.at(sums.blocks[k, :, :, 1], (at[:, 1], at[:, 0]), 1)
    return sums


def no_sums(n: int, cells: Array) -> Sums:
    """Return sums over nothing, of n tags."""
    side = cells.shape[1]
    return Sums(
        normal=np.zeros((n, PARAMETERS, PARAMETERS)),
        gradient=np.zeros((n, PARAMETERS)),
        stats=np.zeros((n, STATS)),
        blocks=np.zeros((n, side, side, 2)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TagPixels:
    """The pixels of a tag that count.

    Attributes
    ----------
    columns, lines : (P,)
        Where they are.
    grey, predicted : (P,)
        Grey levels, 1 is full scale.
    uv : (P, 2), modules
    jacobian : (P, 14)
        Of the prediction.
    """

    columns: NDArray[np.int64]
    lines: NDArray[np.int64]
    grey: Array
    uv: Array
    predicted: Array
    jacobian: Array

    def after(self, step: Array) -> "TagPixels":
        """Return them predicted as they are after a step (14,), to first order."""
        return replace(self, predicted=self.predicted + self.jacobian @ step)


def clusters(seen: TagPixels, box: NDArray[np.int64], cluster_px: int) -> tuple[Array, Array]:
    """Return the normal equations of each cluster of a tag's pixels: (S * S, 14, 14) and (S * S, 14).

    The clusters are squares of ``cluster_px`` px, counted from the image's corner; of each tag there are S by S, from
    that of its box's first pixel on.
    """
    normal, gradient = np.zeros((CLUSTERS**2, PARAMETERS, PARAMETERS)), np.zeros((CLUSTERS**2, PARAMETERS))
    i = np.minimum(seen.columns // cluster_px - box[0] // cluster_px, CLUSTERS - 1)
    j = np.minimum(seen.lines // cluster_px - box[2] // cluster_px, CLUSTERS - 1)
    J = seen.jacobian
    np.add.at(normal, j * CLUSTERS + i, J[:, :, None] * J[:, None, :])
    np.add.at(gradient, j * CLUSTERS + i, J * (seen.grey - seen.predicted)[:, None])
    return normal, gradient


def differentiate(batch: Batch, k: int) -> TagPixels | None:
    """Return the pixels of tag k that count, predicted, with derivatives; None if there are none."""
    seen = _seen(batch, k)
    if seen is None:
        return None
    columns, lines, xy, uv = seen
    frame, cells, theta, normalisation = batch.frame, batch.cells[batch.rows[k]], batch.theta[k], batch.normalisation[k]
    p, p_u, p_v, p_s, p_k = pattern_value(cells, theta, xy, uv, normalisation[2], frame.blur)
    x, y = xy.T
    u, v = uv.T
    w = 1 / (theta[6] * x + theta[7] * y + 1)
    kappa = theta[BLACK] / theta[CONTRAST] if abs(theta[CONTRAST]) > 1e-9 else 0.0
    slope = theta[GRADIENT_X] * x + theta[GRADIENT_Y] * y
    light = theta[BLACK] + theta[CONTRAST] * p + slope * (p + kappa)
    factor = theta[CONTRAST] + slope
    du, dv = factor * p_u * w, factor * p_v * w
    both = -(du * u + dv * v)
    jacobian = np.stack(
        [
            du * x,
            du * y,
            du,
            dv * x,
            dv * y,
            dv,
            both * x,
            both * y,
            np.ones_like(p),
            p,
            x * (p + kappa),
            y * (p + kappa),
            factor * p_s,
            factor * p_k,
        ],
        axis=1,
    )
    predicted, slope_t = response_value(frame.response, light)
    jacobian *= slope_t[:, None]
    grey = frame.grey_at(lines, columns)
    return TagPixels(columns=columns, lines=lines, grey=grey, uv=uv, predicted=predicted, jacobian=jacobian)


def initial_intensity(batch: Batch) -> None:
    """Set offset and gain of tags from the mean grey levels in the middle of their black and white modules, in place.

    Tags of which no pixel lies in the middle of a module of each kind are left as they are.
    """
    response = batch.frame.response
    for k in range(len(batch)):
        seen = _seen(batch, k)
        if seen is None:
            continue
        columns, lines, _, uv = seen
        middle = np.all(np.abs(uv - np.floor(uv) - 0.5) < MIDDLE, axis=1)
        at = (uv[middle] + 1).astype(int)
        white = batch.cells[batch.rows[k]][at[:, 1], at[:, 0]] > 0.5
        grey = batch.frame.grey_at(lines[middle], columns[middle])
        if white.any() and not white.all():
            levels = np.array([grey[~white].mean(), grey[white].mean()])
            black, bright = np.interp(levels, response, np.linspace(0, 1, len(response)))
            batch.theta[k, BLACK], batch.theta[k, CONTRAST] = black, max(bright - black, LEAST_CONTRAST)


def _seen(batch: Batch, k: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array] | None:
    """Return columns and rows of the pixels that count, their normalised places and modules; None if there are none."""
    x0, x1, y0, y1 = (int(b) for b in batch.bounding_boxes[k])
    if x1 <= x0 or y1 <= y0:
        return None
    cells, theta, normalisation = batch.cells[batch.rows[k]], batch.theta[k], batch.normalisation[k]
    margin, stride = float(batch.margin[k]), batch.stride[k]
    columns, lines = (a.ravel() for a in np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)))
    xy = undistort_locally(batch.frame.lens, normalisation[None], np.stack([columns, lines], -1).astype(float)[None])[0]
    uv = apply_h(theta[None, :8], xy[None])[0]
    sampled = (columns - x0 - lines * stride[1] % stride[0]) % stride[0] == 0
    sampled |= ((columns + lines) % stride[2] == 0) & _crossed(cells, theta, normalisation[2], batch.near[k], uv)
    sampled &= (columns + 2 * lines) % batch.every == 0
    used = sampled & np.all((uv > -margin) & (uv < cells.shape[0] - 2 + margin), axis=1)
    return (columns[used], lines[used], xy[used], uv[used]) if used.any() else None


def _crossed(cells: Array, theta: Array, scale: float, sigmas: float, uv: Array) -> NDArray[np.bool_]:
    """Return which places (P, 2) are some sigmas near an edge of black and white, by the blur at the tag's centre."""
    h, last = theta[:8], cells.shape[0] - 1
    sigma = np.exp(theta[LOG_PSF]) * scale
    near = (
        sigmas
        * sigma
        * np.array([np.hypot(h[0] - h[2] * h[6], h[1] - h[2] * h[7]), np.hypot(h[3] - h[5] * h[6], h[4] - h[5] * h[7])])
    )
    at = np.clip(np.nan_to_num(uv) + 1, 0, last).astype(np.int64)
    edge = np.clip(np.nan_to_num(uv) + 1.5, 0, last + 1).astype(np.int64) - 1
    close = (np.abs(uv - edge) < near) & (edge >= 0) & (edge < last)
    low, high = np.clip(edge, 0, last), np.clip(edge + 1, 0, last)
    across = cells[at[:, 1], low[:, 0]] != cells[at[:, 1], high[:, 0]]
    down = cells[low[:, 1], at[:, 0]] != cells[high[:, 1], at[:, 0]]
    return np.asarray((close[:, 0] & across) | (close[:, 1] & down))


def response_value(response: Array, light: Array) -> tuple[Array, Array]:
    """Return the grey levels of light and their derivative; both ends saturate."""
    last = len(response) - 1
    at = np.clip(light * last, 0, last - 1e-9)
    i = at.astype(np.int64)
    step = response[i + 1] - response[i]
    inside = (light >= 0) & (light < 1)
    return np.asarray(response[i] + (at - i) * step), np.asarray(np.where(inside, step * last, 0.0))
