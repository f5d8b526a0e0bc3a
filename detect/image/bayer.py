"""Grey images from colour mosaics (Bayer patterns), without interpolation."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array

MOSAICS = ("bayer_rggb", "bayer_bggr", "bayer_gbrg", "bayer_grbg")
"""ROS's names: the first row from the first pixel, then the second row."""
_SIGMA_PX = 2.0
_MIN_SIDE_PX = 16
_STRONG, _STRONGEST = 0.5, 0.995
"""A step counts if it is at least this fraction of the quantile above."""
_GAINS = (0.05, 20.0)
"""Of a colour against green; others are no print's."""


_LINES = 480
"""Rows that are looked at, and so many pairs of neighbouring rows."""
_FEW, _SURELY_NOT = 4, 0.9
"""One in so many of them shows that nothing alternates, by less than this fraction of the differences two rows
apart."""
_ALTERNATES, _LEAST_LEVELS2 = 1.03, 0.05
"""Neighbours alternate whose mean squared difference, over the whole image, is so many times that of pixels two
apart, and so many squared levels more.

Scenes have .3 to .6 times, white noise once, two fields of a box that moved by 2 px 1.03 to 1.6 times. Means of
differences without their squares separate less well: .5 to .9, once, 0.98 to 1.3.
"""


def alternation(image: NDArray[Any]) -> tuple[bool, bool]:
    """Return whether a grey image (H, W) alternates from column to column as well as from row to row, and the latter.

    Of a scene, neighbours differ less than pixels two apart. Where they differ more, columns and rows alternate in a
    colour mosaic that was sent as grey, rows alone in an interlaced image of something that moved. Where rows do not
    alternate, columns are not looked at.
    """
    if image.dtype not in {np.dtype(np.uint8), np.dtype(np.uint16)}:
        image = image.astype(np.float32)
    every = max(1, image.shape[0] // _LINES) | 1  # odd, so that both kinds of alternating rows are met
    one, two = _steps_down(image, (_FEW * every) | 1)
    if one < _SURELY_NOT * two or not _alternates(*_steps_down(image, every)):
        return False, False
    rows = image[::every]
    return _alternates(_mean_step(rows[:, 1:], rows[:, :-1]), _mean_step(rows[:, 2:], rows[:, :-2])), True


def _steps_down(image: NDArray[Any], every: int) -> tuple[float, float]:
    """Return the mean squared differences of neighbouring rows and of those two apart, of one in so many rows."""
    first, second, third = (image[k : image.shape[0] - 2 + k : every] for k in range(3))
    return _mean_step(second, first), _mean_step(third, first)


def _alternates(one: float, two: float) -> bool:
    """Return whether levels alternate, by squared differences of neighbours and of pixels two apart."""
    return one > _ALTERNATES * two + _LEAST_LEVELS2


def _mean_step(levels: NDArray[Any], others: NDArray[Any]) -> float:
    """Return the mean squared difference of grey levels (R, W)."""
    return float(cv2.norm(levels, others, cv2.NORM_L2SQR)) / levels.size


def unnamed_mosaic(image: NDArray[Any], alternates: tuple[bool, bool] | None = None) -> str | None:
    """Return which colour mosaic a grey image (H, W) of 8 or 16 bits really is, as in ``MOSAICS``; None if it is grey.

    The two green planes are alike; which of the others is red makes no difference to :func:`even_mosaic`.
    ``alternates`` is what :func:`alternation` says of it, if that is known.
    """
    if (
        image.ndim != 2
        or image.dtype not in {np.dtype(np.uint8), np.dtype(np.uint16)}
        or min(image.shape) < _MIN_SIDE_PX
    ):
        return None
    if (alternation(image) if alternates is None else alternates) != (True, True):
        return None
    height, width = (side // 2 * 2 for side in image.shape)
    a, b, c, d = (image[i:height:2, j:width:2].astype(np.float32) for i in (0, 1) for j in (0, 1))
    return "bayer_grbg" if float(np.abs(a - d).mean()) < float(np.abs(b - c).mean()) else "bayer_rggb"


def even_mosaic(mosaic: NDArray[Any], name: str) -> NDArray[Any]:
    """Return a colour mosaic (H, W) as a grey image: red and blue pixels in the scale of the green ones.

    Print is black on white, so its colours differ by a gain and an offset only. They are estimated from the strongest
    steps of the scene, where a box with tags has most; medians keep coloured things out. Every pixel keeps its place
    and its noise: interpolating colours instead moves corners by 0.03 px.

    Where samples went through a curve ``a x^p - b``, a gain c of the light is the gain ``c^p`` of the sample and the
    offset ``b (c^p - 1)``: sRGB's curve stays sRGB's, but for its straight toe below 4 % of full scale.

    Parameters
    ----------
    mosaic
        As the sensor has it, uint8 or uint16; its largest value stays the largest.
    name
        One of ``MOSAICS``.
    """
    if min(mosaic.shape) < _MIN_SIDE_PX:
        return mosaic
    letters = name.removeprefix("bayer_")
    planes = [_smooth(mosaic, *divmod(k, 2)) for k in range(4)]
    cells = {letter: planes[letters.index(letter)] for letter in "rb"}
    green, green_step = _levels_and_steps((planes[letters.index("g")] + planes[letters.rindex("g")]) / 2)
    size = np.abs(green_step)
    strong = size > max(_STRONG * float(np.quantile(size, _STRONGEST)), 1.0)
    if not np.any(strong):
        return mosaic
    even, top = mosaic.copy(), int(mosaic.max())
    for letter in "rb":
        level, step = _levels_and_steps(cells[letter])
        gain = float(np.median(step[strong] / green_step[strong]))
        if not _GAINS[0] < gain < _GAINS[1]:
            continue
        offset = float(np.median(level[strong] - gain * green[strong]))
        table = np.clip(np.rint((np.arange(top + 1) - offset) / gain), 0, top).astype(mosaic.dtype)
        row, column = divmod(letters.index(letter), 2)
        even[row::2, column::2] = table[mosaic[row::2, column::2]]
    return even


def _smooth(mosaic: NDArray[Any], row: int, column: int) -> Array:
    """Return one plane of a mosaic, blurred, as it would be at the middle of every second cell both ways.

    The blur is wide enough for a lattice of two pixels, so all planes see a scene alike, wherever they lie in a cell.
    """
    height, width = (side // 2 for side in mosaic.shape)
    plane = mosaic[row::2, column::2][:height, :width].astype(np.float32)
    kernels = []
    for place in (column, row):
        kernel = np.exp(-0.5 * ((2.0 * np.arange(-4, 5) + place - 0.5) / _SIGMA_PX) ** 2)
        kernels.append(kernel / kernel.sum())
    return np.asarray(cv2.sepFilter2D(plane, cv2.CV_32F, *kernels)[::2, ::2], dtype=np.float64)


def _levels_and_steps(cells: Array) -> tuple[Array, Array]:
    """Return mean and difference of all neighbours, down and across."""
    pairs = ((cells[:-1], cells[1:]), (cells[:, :-1], cells[:, 1:]))
    return (
        np.concatenate([((a + b) / 2).ravel() for a, b in pairs]),
        np.concatenate([(b - a).ravel() for a, b in pairs]),
    )
