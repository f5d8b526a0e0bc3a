"""Shapes, charts and sets of a picture's few tags: the fast ways give what the plain ones do."""

import cv2
import numpy as np
import pytest
from aligned_views import pose, view

from boxcal.detect.alignment.backend import numba_backend, numpy_backend
from boxcal.detect.alignment.candidates import _THRESHOLD_OFFSET, _dark
from boxcal.detect.alignment.homography import map_points
from boxcal.detect.alignment.radial_camera import fisheye_distortion, no_distortion
from boxcal.detect.alignment.row_sets import among, distinct


def _quads(seed):
    rng = np.random.default_rng(seed)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    quads = rng.uniform(0, 600, (80, 1, 2)) + square * rng.uniform(5, 90, (80, 1, 2)) + rng.normal(0, 9, (80, 4, 2))
    quads[:9] = quads[:9, ::-1]  # seen from behind
    quads[9] = quads[9, :1]  # all corners in one place
    return quads


def test_compiled_shapes_of_tags_are_those_of_the_reference():
    quads = _quads(1)
    plain, fast = numpy_backend(), numba_backend()
    np.testing.assert_allclose(fast.widths(quads), plain.widths(quads), rtol=1e-12, atol=1e-9)
    assert np.array_equal(fast.convex(quads), plain.convex(quads))
    assert 0 < np.count_nonzero(plain.convex(quads)) < 71
    unknown = np.full((1, 4, 2), np.nan)
    assert np.isnan(fast.widths(unknown)).all()
    assert not fast.convex(unknown).any()


def test_the_narrower_way_across_a_rectangle_is_its_shorter_side():
    rectangle = np.array([[[0.0, 0], [30, 0], [30, 7], [0, 7]]])
    np.testing.assert_allclose(numba_backend().widths(rectangle), 7.0)


@pytest.mark.parametrize(
    "lens", [no_distortion((640, 480)), fisheye_distortion((640, 480), 300.0)], ids=["plain", "fisheye"]
)
def test_compiled_charts_are_those_of_the_reference(lens):
    lens[6:8] = 0.02, 0.01
    places = _quads(2)
    normalisation = np.column_stack([places.mean(axis=1), np.full(len(places), 0.02)])
    plain = numpy_backend().undistort_locally(lens, normalisation, places)
    fast = numba_backend().undistort_locally(lens, normalisation, places)
    np.testing.assert_allclose(fast, plain, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("noise_px", [0.0, 0.5, 5.0])
@pytest.mark.parametrize("points", [4, 8, 140])
def test_compiled_homography_is_that_of_the_reference(noise_px, points):
    rng = np.random.default_rng(points)
    src = rng.uniform(-0.1, 0.1, (points, 2))
    H = np.array([[900.0, -150, 320], [80, 1100, 240], [0.8, -0.6, 1]])
    dst = map_points(H, src) + rng.normal(0, noise_px, (points, 2))
    plain = numpy_backend().least_squares_homography(src, dst)
    fast = numba_backend().least_squares_homography(src, dst)
    np.testing.assert_allclose(map_points(fast, src), map_points(plain, src), atol=1e-6)
    if noise_px == 0:
        np.testing.assert_allclose(map_points(fast, src), dst, atol=1e-6)


def test_points_in_one_place_have_a_homography_without_an_error():
    assert numba_backend().least_squares_homography(np.ones((4, 2)), np.ones((4, 2))).shape == (3, 3)


def test_rows_among_others_and_each_once_are_those_that_numpy_finds():
    rng = np.random.default_rng(3)
    rows, some = rng.integers(0, 40, 30), rng.integers(0, 40, 12)
    assert np.array_equal(among(rows, some), np.isin(rows, some))
    assert not among(rows, some[:0]).any()
    assert np.array_equal(distinct(rows), np.unique(rows))
    assert len(distinct(rows[:0])) == 0


@pytest.mark.parametrize("window_px", [9, 25])
def test_dark_places_are_those_of_the_adaptive_threshold(window_px):
    image = view(pose(20.0))
    method, kind = cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV
    expected = cv2.adaptiveThreshold(image, 1, method, kind, window_px, _THRESHOLD_OFFSET)
    assert np.array_equal(_dark(image, window_px), expected)
    part = image[100:300, 150:420]
    assert np.array_equal(
        _dark(part, window_px), cv2.adaptiveThreshold(part, 1, method, kind, window_px, _THRESHOLD_OFFSET)
    )
