"""Grey images of more than 8 bits: how many bits there are, and all of them on one scale."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

DeepGrey = NDArray[Any]
"""A grey image as its sensor had it: uint8, or uint16 for more bits."""

FULL_SCALE = 65_535
"""White of a 16-bit image."""
DEPTHS = (8, 10, 12, 14, 16)
"""Bits that sensors give a grey level."""


def bits_of(image: DeepGrey) -> int:
    """Return how many bits (8, 10, 12, 14 or 16) an image's largest value needs."""
    most = int(image.max(initial=0))
    return next(bits for bits in DEPTHS if most < 1 << bits)


def full_scale(image: DeepGrey, bits: int) -> DeepGrey:
    """Return a uint16 image of so many bits, or of more if its values need them, with its white at 65535.

    An 8-bit image comes back as it is.
    """
    if image.dtype == np.uint8:
        return image
    white = (1 << max(bits, bits_of(image))) - 1
    return image if white == FULL_SCALE else np.rint(image * np.float32(FULL_SCALE / white)).astype(np.uint16)


def eight_bits(image: DeepGrey) -> NDArray[np.uint8]:
    """Return an image at full scale in 8 bits."""
    return image if image.dtype == np.uint8 else np.rint(image * np.float32(255 / FULL_SCALE)).astype(np.uint8)
