from dataclasses import replace

import numpy as np
import pytest
from aligned_views import BENT, LENS, PATTERNS, PLAIN, pose, some_tags, truth, view
from numba import njit

from boxcal.detect.alignment.backend import numba_backend, numpy_backend
from boxcal.detect.alignment.homography import from_square, least_squares_homography, map_points, to_square
from boxcal.detect.alignment.numba.collect import Room, collect, room_for
from boxcal.detect.alignment.numba.pixels import OF_PIXEL
from boxcal.detect.alignment.numba.place import place_all
from boxcal.detect.alignment.registration import image_model as model
from boxcal.detect.alignment.registration import psf as blur
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.finish import finish
from boxcal.detect.alignment.registration.gauss_newton import LEAST_THINNED, THINNED
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.tag_batch import ROUND, Frame
from boxcal.detect.image.gray import from_levels
from boxcal.detect.image.response_curve import response_table


def _pixels(batch, theta):
    return model.accumulate(replace(batch, theta=theta)).stats[:, 0]


def _cost(batch, theta):
    return model.accumulate(replace(batch, theta=theta)).stats[:, 1] / 2


@pytest.mark.parametrize(
    ("azimuth_deg", "response", "tolerance"), [(0.0, "linear", 6e-3), (38.0, "linear", 2e-2), (0.0, "srgb", 1e-2)]
)
def test_gradient_is_the_derivative_of_the_residuals(azimuth_deg, response, tolerance):
    batch = some_tags(azimuth_deg, response)
    theta = batch.theta
    theta[:, 10:12] = 0
    sums = model.accumulate(batch)
    size = np.sqrt(np.einsum("nii->ni", sums.normal) * sums.stats[:, 1, None])
    for k in range(PARAMETERS):
        step = np.zeros(PARAMETERS)
        step[k] = 1e-5
        numeric = (_cost(batch, theta + step) - _cost(batch, theta - step)) / 2e-5
        # a tag that a pixel has just entered or left has no derivative
        same = _pixels(batch, theta + step) == _pixels(batch, theta - step)
        assert same.sum() >= 2
        # the analytic derivative holds the width of the blur on the tag while the homography moves
        off = np.abs(-numeric - sums.gradient[:, k])[same]
        np.testing.assert_array_less(off, tolerance * size[same, k] + 1e-9)


@pytest.mark.parametrize("side", [1, 5])
@pytest.mark.parametrize("response", ["linear", "srgb"])
@pytest.mark.parametrize("lens", [LENS, BENT], ids=["plain", "fisheye"])
def test_compiled_sums_are_those_of_the_reference(response, side, lens):
    kernels = pytest.importorskip("boxcal.detect.alignment.numba.gauss_newton", reason="numba is not installed")
    batch = some_tags(33.0, response, side, lens)
    plain, fast = model.accumulate(batch), kernels.accumulate(batch)
    np.testing.assert_array_equal(fast.stats[:, 0], plain.stats[:, 0])
    scale = np.sqrt(np.einsum("nii,njj->nij", plain.normal, plain.normal))
    # the response curve is a table: at a step of its slope the two may fall on different sides
    atol = 6e-3 if response == "linear" else 0.03
    np.testing.assert_allclose(fast.normal / scale, plain.normal / scale, atol=atol)
    np.testing.assert_allclose(fast.stats, plain.stats, rtol=2e-3)
    np.testing.assert_allclose(fast.blocks, plain.blocks, atol=0.02)


@njit(nogil=True, error_model="numpy")
def _collected(batch, k, thinned):
    room: Room = room_for(batch.bounding_boxes, batch.cells.shape[1])
    n, few = collect(batch, k, thinned, room)
    place_all(room.coefficients, room.pixels, n)
    return room.pixels, n, few


@pytest.mark.parametrize("stride", [(1, 1, 1), (1, 1, 1 << 40), (5, 3, 1 << 40), (5, 3, 1), (8, 5, 2), (13, 8, 3)])
@pytest.mark.parametrize("near", [1.5, 2.5])
@pytest.mark.parametrize("lens", [LENS, BENT], ids=["plain", "fisheye"])
@pytest.mark.parametrize(("roll_deg", "thinned"), [(0.0, False), (40.0, True)])
def test_compiled_pixels_are_those_of_the_reference(roll_deg, thinned, lens, stride, near):
    batch = some_tags(33.0, lens=lens, roll_deg=roll_deg, near=near)
    wide = batch.bounding_boxes + np.array([-9, 9, -9, 9])
    batch = replace(batch, stride=np.tile(stride, (3, 1)), bounding_boxes=np.maximum(wide, 0))
    for k in range(len(batch)):
        plain = model.differentiate(batch, k)
        blocks, n, few = _collected(batch.arrays(), k, thinned)
        figures = blocks.reshape(-1, OF_PIXEL, 64).transpose(1, 0, 2).reshape(OF_PIXEL, -1)[:, :n]
        x, y, u, v, grey, column, row = figures[:7]
        first = (column + 2 * row) % THINNED == 0
        assert few == (first.sum() if thinned and n >= LEAST_THINNED else n)
        assert few == n or first[:few].all()
        assert n == len(plain.columns) > 30
        fast, expected = np.lexsort((column, row)), np.lexsort((plain.columns, plain.lines))
        np.testing.assert_array_equal(column[fast], plain.columns[expected])
        np.testing.assert_array_equal(row[fast], plain.lines[expected])
        np.testing.assert_allclose(np.stack([u, v], -1)[fast], plain.uv[expected], atol=2e-5)
        np.testing.assert_allclose(grey[fast], plain.grey[expected], atol=1e-6)
        again = model.apply_h(batch.theta[k, None, :8], np.stack([x, y], -1).astype(float)[None])[0]
        np.testing.assert_allclose(again, np.stack([u, v], -1), atol=2e-5)


def test_grey_levels_of_eight_bits_are_taken_as_they_are():
    image = view(pose(25.0))
    uv, rows = truth(pose(25.0))
    frame = Frame(grey=image, response=response_table("linear"), lens=LENS)
    exact = Frame(grey=from_levels(image), response=response_table("linear"), lens=LENS)
    for compute in (numpy_backend(), numba_backend()):
        tags, expected = (align(f, PATTERNS, rows[:2], uv[rows[:2]], compute=compute) for f in (frame, exact))
        np.testing.assert_array_equal(tags.corners_px, expected.corners_px)
        np.testing.assert_array_equal(tags.blocks, expected.blocks)


@pytest.mark.parametrize("lens", [LENS, BENT], ids=["plain", "fisheye"])
def test_numpy_alone_aligns_as_well_as_compiled(lens):
    pytest.importorskip("numba", reason="numba is not installed")
    T = pose(25.0)
    uv, seen = truth(T)
    rows = seen[::10]
    frame = Frame(grey=(view(T) / np.float32(255)), response=response_table("linear"), lens=lens)
    plain = align(frame, PATTERNS, rows, uv[rows] + 0.2, stop_px=1e-4, iterations=30, compute=numpy_backend())
    fast = align(frame, PATTERNS, rows, uv[rows] + 0.2, stop_px=1e-4, iterations=30)
    off = np.linalg.norm(plain.corners_px - fast.corners_px, axis=2)
    assert np.median(off) < 1e-3
    # the compiled steps keep to the pixels that they began with: a few at the rim of a small tag come and go
    np.testing.assert_array_less(off, 0.3 * np.sqrt(np.trace(plain.cov_px2, axis1=2, axis2=3)))


@pytest.mark.parametrize("response", ["linear", "srgb"])
def test_a_first_step_with_few_pixels_leads_to_the_same_corners(response):
    T = pose(20.0, distance=0.35)
    uv, seen = truth(T)
    rows = seen[::9][:4]
    grey = view(T, replace(PLAIN, srgb=response == "srgb")) / np.float32(255)
    frame = Frame(grey=grey, response=response_table(response), lens=LENS)
    rough = align(frame, PATTERNS, rows, uv[rows] + 0.3, stop_px=0.3, side_px=12.0, iterations=2)
    arguments = {"start": rough, "side_px": 22.0}
    whole = align(frame, PATTERNS, rows, rough.corners_px, stop_px=1e-3, **arguments)
    sigma = np.sqrt(np.trace(whole.cov_px2, axis1=2, axis2=3))
    ends = []
    for compute in (numba_backend(), numpy_backend()):
        counted = []

        def counting(batch, sums, *, taken=compute.iterate, counted=counted, **options):
            taken(batch, sums, **options)
            counted.append((sums.stats[:, 0].copy(), options["rules"]))

        few = align(
            frame, PATTERNS, rows, rough.corners_px, stop_px=0.06, thinned=True,
            compute=replace(compute, iterate=counting), **arguments
        )  # fmt: skip
        assert np.median(counted[0][0]) >= LEAST_THINNED
        assert counted[0][1].thinned
        assert np.all(np.linalg.norm(few.corners_px - whole.corners_px, axis=2) < 0.25 * sigma)
        np.testing.assert_allclose(np.sqrt(np.trace(few.cov_px2, axis1=2, axis2=3)), sigma, rtol=0.02)
        ends.append(few.corners_px)
    np.testing.assert_allclose(*ends, atol=2e-3)


@pytest.mark.parametrize("lens", [LENS, BENT], ids=["plain", "fisheye"])
@pytest.mark.parametrize("side_px", [12.0, 22.0, np.inf])
def test_compiled_beginning_of_an_alignment_is_that_of_the_reference(lens, side_px):
    pytest.importorskip("numba", reason="numba is not installed")
    rng = np.random.default_rng(2)
    frame = Frame(grey=np.zeros((480, 640), np.float32), response=response_table("linear"), lens=lens)
    squares = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * rng.uniform(5, 90, (60, 1, 1))
    corners = rng.uniform(-40, 620, (60, 1, 2)) + squares + rng.normal(0, 2, (60, 4, 2))
    corners[3, 1], corners[4] = np.nan, corners[4, :1]  # not known, and no quadrilateral
    for given in (None, rng.normal(0, 1, (60, PARAMETERS))):
        plain = numpy_backend().begin(frame, PATTERNS, corners, given, side_px)
        fast = numba_backend().begin(frame, PATTERNS, corners, given, side_px)
        assert np.isnan(fast.theta[3:5, :8]).all()
        known = np.delete(np.arange(60), 3)
        for name, expected, got in zip(plain._fields, plain, fast, strict=True):
            np.testing.assert_allclose(got[known], expected[known], rtol=1e-9, atol=1e-11, err_msg=name)
        assert np.array_equal(fast.bounding_boxes, plain.bounding_boxes)


def test_compiled_end_of_an_alignment_is_that_of_the_reference():
    pytest.importorskip("numba", reason="numba is not installed")
    batch = some_tags(33.0)
    frame, theta, place = batch.frame, batch.theta, batch.normalisation
    sums = model.accumulate(batch)
    plain = finish(frame, PATTERNS, theta=theta, normalisation=place, sums=sums, covariance=True)
    fast = numba_backend().finish(frame, PATTERNS, theta=theta, normalisation=place, sums=sums, covariance=True)
    np.testing.assert_allclose(fast[0], plain[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(fast[1], plain[1], rtol=1e-6)
    np.testing.assert_allclose(fast[2], plain[2], rtol=1e-9)
    lost = theta.copy()
    lost[:, 3:6] = lost[:, :3]
    for end in (finish, numba_backend().finish):
        corners, *_ = end(frame, PATTERNS, theta=lost, normalisation=place, sums=sums, covariance=True)
        assert np.isnan(corners).any(axis=(1, 2)).all()


def test_pattern_without_blur_is_the_pattern():
    theta = np.zeros(PARAMETERS)
    theta[[0, 4]] = 1.0
    theta[[BLACK, CONTRAST, LOG_PSF]] = 0, 1, np.log(1e-3)
    uv = np.stack(np.meshgrid(np.arange(-1, 9) + 0.5, np.arange(-1, 9) + 0.5), -1).reshape(-1, 2)
    p, *_ = blur.pattern_value(PATTERNS.cells[7], theta, uv, uv, 1.0, ROUND)
    np.testing.assert_allclose(p.reshape(10, 10), PATTERNS.cells[7], atol=1e-12)


def test_pattern_under_a_sheared_blur_is_the_convolution():
    theta = np.zeros(PARAMETERS)
    theta[:8] = (0.25, 0.1, 0.1, -0.05, 0.2, 0.3, 0, 0)
    theta[LOG_PSF] = np.log(1.5)
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 25, (40, 2))
    uv = model.apply_h(theta[None, :8], xy[None])[0]
    inside = np.all((uv > 0) & (uv < 8), axis=1)
    xy, uv = xy[inside], uv[inside]
    spread = rng.standard_normal((40_000, 2)) * 1.5
    near = model.apply_h(theta[None, :8], (xy[:, None] + spread[None]).reshape(1, -1, 2))[0].reshape(len(xy), -1, 2)
    at = np.clip(np.floor(near + 1).astype(int), 0, 9)
    sampled = PATTERNS.cells[7][at[..., 1], at[..., 0]].mean(axis=1)
    p, *_ = blur.pattern_value(PATTERNS.cells[7], theta, xy, uv, 1.0, ROUND)
    np.testing.assert_allclose(p, sampled, atol=0.012)


def test_homographies_map_their_corners_exactly():
    rng = np.random.default_rng(2)
    square = np.array([[0, 0], [8, 0], [8, 8], [0, 8.0]])
    quads = square * 5 + rng.uniform(-4, 4, (6, 4, 2))
    np.testing.assert_allclose(
        model.apply_h(from_square(8, quads), np.broadcast_to(square, quads.shape)), quads, atol=1e-12
    )
    np.testing.assert_allclose(
        model.apply_h(to_square(quads, 8), quads), np.broadcast_to(square, quads.shape), atol=1e-12
    )
    H = least_squares_homography(square, quads[0])
    np.testing.assert_allclose(map_points(H, square), quads[0], atol=1e-9)


@pytest.mark.parametrize("turn", range(4))
def test_quadrilateral_with_corners_in_line_has_no_homography(turn):
    quad = np.roll(np.array([[[0, 0], [1, 0.3], [2, 0.6], [-1, 3.0]]]), turn, axis=1)
    assert np.isnan(from_square(8, quad)).all()
    assert np.isnan(to_square(quad, 8)).all()
