"""Outlines of dark places with four sides, as OpenCV and the compiled code find them."""

import cv2
import numpy as np
import pytest
from aligned_views import pose, view

from boxcal.detect.alignment.backend import numba_backend, numpy_backend


def _sorted(quads):
    return sorted(map(tuple, np.asarray(quads).reshape(-1, 8).tolist()))


def _both(binary, least=1, most=10_000):
    plain = numpy_backend().four_sided(binary, least, most)
    assert _sorted(numba_backend().four_sided(binary, least, most)) == _sorted(plain)
    return plain


@pytest.mark.parametrize("seed", range(12))
def test_compiled_outlines_are_those_of_opencv(seed):
    random = np.random.default_rng(seed)
    found = 0
    for _ in range(60):
        height, width = random.integers(1, 90, 2)
        binary = (random.random((height, width)) < random.random()).astype(np.uint8)
        binary = cv2.resize(binary, None, fx=1 + seed % 3, fy=1 + seed % 5, interpolation=cv2.INTER_NEAREST)
        for _ in range(int(random.integers(0, 20))):
            corners = (random.random((4, 2)) * binary.shape[::-1]).astype(np.int32)
            cv2.fillConvexPoly(binary, cv2.convexHull(corners), int(random.integers(0, 2)))
        found += len(_both(binary))
    assert found > 5


def test_compiled_outlines_of_a_picture_are_those_of_opencv():
    image = view(pose(20.0))
    binary = cv2.adaptiveThreshold(image, 1, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, 25, 7)
    assert len(_both(binary, 21, 2 * sum(image.shape))) > 20
    assert len(_both(binary, 60, 100)) < len(_both(binary, 21, 100)) < len(_both(binary, 21, 4000))


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (50, 1), (2, 8), (9, 16), (16, 17)])
def test_outlines_at_the_edge_of_a_picture(shape):
    assert len(_both(np.zeros(shape, np.uint8))) == 0
    assert len(_both(np.ones(shape, np.uint8))) == (min(shape) > 2)


def test_corners_are_dark_pixels_clockwise_as_seen():
    binary = np.zeros((30, 40), np.uint8)
    binary[5:15, 8:33] = 1
    binary[8:12, 12:20] = 0  # a hole has an outline, but no dark one
    square = np.array([[8, 5], [32, 5], [32, 14], [8, 14]])
    quad = _both(binary)[0]
    start = int(np.flatnonzero((quad == square[0]).all(axis=1))[0])
    np.testing.assert_array_equal(np.roll(quad, -start, axis=0), square)
    assert len(_both(binary)) == 1
