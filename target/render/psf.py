"""The PSF and the motion of the image, acting before the light is gathered into pixels.

Samples are means over cells of a lattice S times finer than the pixels. The PSF as weights on that lattice, then the
sum over the S x S cells of each pixel, is the scene convolved with both the PSF and the pixel's square: exact, but for
the PSF's lattice, which is fine against it.
"""

from math import ceil

import cv2
import numpy as np

from boxcal.target.arrays import Index, Reals
from boxcal.target.render.sensor import SensorModel, motion_kernel

_SIGMAS = 4.5
"""Reach of the PSF in its standard deviations; what lies beyond is 1e-5 of it."""
_NARROW = 0.7
"""Standard deviation, cells, below which three weights of the right variance stand for a Gaussian."""
_STRIP = 1 << 22
"""Cells that are worked on at once (16 MB)."""


def reach_px(sensor: SensorModel) -> int:
    """Return how far, px, PSF and motion carry light."""
    return ceil(_SIGMAS * sensor.psf_px) + ceil(sensor.motion_blur_px / 2 + 1) * (sensor.motion_blur_px > 0)


def gather(coarse: Reals, at: Index, fine: Reals, sensor: SensorModel) -> Reals:
    """Return the linear intensity (H, W) on a sensor's pixels.

    Parameters
    ----------
    coarse : (H, W)
        Mean over each pixel before any blur.
    at : (M,)
        Pixels, counted row by row, that are known more finely.
    fine : (M, S * S)
        Means over their cells, row by row.
    sensor
        Its PSF and motion.
    """
    reach = reach_px(sensor)
    if not reach:
        return coarse
    height, width = coarse.shape
    out = _blurred(coarse, 1, sensor)
    if not len(at):
        return out
    cells = int(np.sqrt(fine.shape[1]))
    rows, columns = np.divmod(at, width)
    left, right = max(int(columns.min()) - reach, 0), min(int(columns.max()) + reach + 1, width)
    top, bottom = max(int(rows.min()) - reach, 0), min(int(rows.max()) + reach + 1, height)
    step = max(_STRIP // (cells * cells * (right - left)) - 2 * reach, 8)
    for first in range(top, bottom, step):
        last = min(first + step, bottom)
        low, high = max(first - reach, 0), min(last + reach, height)
        begin, end = max(left - reach, 0), min(right + reach, width)
        lattice = np.repeat(np.repeat(coarse[low:high, begin:end], cells, axis=0), cells, axis=1)
        here = (rows >= low) & (rows < high)
        blocks = lattice.reshape(high - low, cells, end - begin, cells)
        blocks[rows[here] - low, :, columns[here] - begin, :] = fine[here].reshape(-1, cells, cells)
        blurred = _blurred(lattice, cells, sensor)[
            (first - low) * cells : (last - low) * cells, (left - begin) * cells : (right - begin) * cells
        ]
        out[first:last, left:right] = cv2.resize(blurred, (right - left, last - first), interpolation=cv2.INTER_AREA)
    return out


def _blurred(intensity: Reals, cells: int, sensor: SensorModel) -> Reals:
    """Return the intensity on a lattice of ``cells`` cells a pixel after PSF and motion."""
    sigma = sensor.psf_px * cells
    if sigma > 0:
        weights = _gaussian(sigma)
        intensity = np.asarray(
            cv2.sepFilter2D(intensity, -1, weights, weights, borderType=cv2.BORDER_REPLICATE), dtype=np.float32
        )
    if sensor.motion_blur_px > 0:
        kernel = motion_kernel(sensor.motion_blur_px * cells, sensor.motion_angle)
        intensity = np.asarray(cv2.filter2D(intensity, -1, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
    return intensity


def _gaussian(sigma: float) -> Reals:
    """Return weights (odd,) of a standard deviation, cells; they sum to 1."""
    if sigma < _NARROW:
        side = sigma * sigma / 2
        return np.array([side, 1 - 2 * side, side], dtype=np.float32)
    reach = ceil(_SIGMAS * sigma)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.asarray(weights / weights.sum(), dtype=np.float32)
