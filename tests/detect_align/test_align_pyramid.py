"""Copies of a picture."""

import numpy as np
import pytest
from aligned_views import LENS

from boxcal.detect.alignment.pyramid import Pyramid
from boxcal.detect.image.gray import from_levels
from boxcal.detect.image.response_curve import response_table

IMAGE = np.random.default_rng(4).integers(0, 256, (480, 640)).astype(np.uint8)


@pytest.mark.parametrize("level", [1, 2])
def test_copies_of_eight_bits_are_means_but_for_rounding(level):
    rounded, exact = (
        Pyramid(grey, response_table("linear"), LENS).level(level) for grey in (IMAGE, from_levels(IMAGE))
    )
    size = 2**level
    means = from_levels(IMAGE).reshape(480 // size, size, 640 // size, size).mean(axis=(1, 3))
    np.testing.assert_allclose(exact.grey, means, atol=1e-6)
    assert np.abs(from_levels(rounded.grey) - means).max() < 0.6 * level / 255
