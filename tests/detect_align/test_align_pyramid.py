"""Copies of a picture, and its grey levels around tags alone."""

import numpy as np
import pytest
from aligned_views import LENS

from boxcal.detect.alignment.pyramid import Pyramid
from boxcal.detect.image.gray import from_levels
from boxcal.detect.image.response_curve import response_table

IMAGE = np.random.default_rng(4).integers(0, 256, (480, 640)).astype(np.uint8)
SQUARE = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]])


def test_around_tags_a_picture_of_eight_bits_is_what_it_is():
    pyramid = Pyramid(IMAGE, response_table("linear"), LENS)
    whole = from_levels(IMAGE)
    assert not pyramid.around(SQUARE[None] + (500.0, 300.0)).grey[:250].any()
    for top in (300.0, 20.0, 430.0):
        grey = pyramid.under(LENS).around(SQUARE[None] + (500.0, top)).grey
        near = slice(int(top - 20), int(top + 60)), slice(480, 560)
        np.testing.assert_array_equal(grey[near], whole[near])
        assert not grey[:, :450].any()
    np.testing.assert_array_equal(pyramid.level(0).grey, whole)


@pytest.mark.parametrize("level", [0, 1])
def test_around_tags_on_all_sides_a_copy_is_made_piece_by_piece(level):
    pyramid = Pyramid(IMAGE, response_table("linear"), LENS)
    whole, made = from_levels(pyramid.copy(level)), []
    for at in ((300.0, 200.0), (100.0, 220.0), (320.0, 90.0), (420.0, 330.0)):
        grey = pyramid.around((SQUARE[None] + at) / 2**level, level).grey
        made.append(np.array([at, np.array(at) + 40]) / 2**level)
        (left, top), (right, bottom) = np.min(made, axis=(0, 1)).astype(int), np.max(made, axis=(0, 1)).astype(int)
        np.testing.assert_array_equal(grey[top:bottom, left:right], whole[top:bottom, left:right])
        assert not grey[: top - 30].any()


@pytest.mark.parametrize("level", [1, 2])
def test_copies_of_eight_bits_are_means_but_for_rounding(level):
    rounded, exact = (
        Pyramid(grey, response_table("linear"), LENS).level(level) for grey in (IMAGE, from_levels(IMAGE))
    )
    size = 2**level
    means = from_levels(IMAGE).reshape(480 // size, size, 640 // size, size).mean(axis=(1, 3))
    np.testing.assert_allclose(exact.grey, means, atol=1e-6)
    assert np.abs(rounded.grey - means).max() < 0.6 * level / 255
