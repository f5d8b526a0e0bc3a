from dataclasses import replace

import cv2
import numpy as np
import pytest
from aligned_views import LENS, PATTERNS, PLAIN, TARGET, pose, some_tags, truth, view, width_px

from boxcal.detect.alignment import covariance
from boxcal.detect.alignment.backend import numba_backend, numpy_backend
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration import image_model as model
from boxcal.detect.alignment.registration.align import align, aligned_batch
from boxcal.detect.alignment.registration.gauss_newton import StepRules
from boxcal.detect.alignment.registration.parameters import PARAMETERS
from boxcal.detect.alignment.registration.sandwich_sums import no_part_sums, sum_parts
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.image.response_curve import response_table
from boxcal.target.render.renderer import SensorModel


def _grained(azimuth_deg, seed, spread_px):
    """Return a view with strong noise whose neighbouring pixels agree, and where its corners are."""
    T = pose(azimuth_deg, distance=0.6)
    rng = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(rng.standard_normal((480, 640)), (0, 0), spread_px) if spread_px else 0
    grain = 4 * grain / max(np.std(grain), 1e-9) + rng.standard_normal((480, 640))
    image = view(T, SensorModel(psf_px=PLAIN.psf_px)) + grain
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), truth(T)[0]


@pytest.mark.parametrize("response", ["linear", "srgb"])
def test_sums_over_squares_are_those_over_all(response):
    batch = some_tags(33.0, response, 5)
    whole = model.accumulate(batch)
    for k, side in enumerate((8, 9, 12)):
        normal, gradient = model.clusters(model.differentiate(batch, k), batch.bounding_boxes[k], side)
        assert (normal[:, 0, 0] > 0).sum() > 3
        np.testing.assert_allclose(normal.sum(axis=0), whole.normal[k], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(gradient.sum(axis=0), whole.gradient[k], rtol=1e-9, atol=1e-12)


def _stepped(compute, batch, steps):
    """Return sums over parts of all but the second of some tags after so many steps, and the tags then."""
    batch = replace(batch, theta=batch.theta.copy())
    parts = no_part_sums(np.array([True, False, True]), batch.bounding_boxes)
    free = np.ones((1, PARAMETERS), dtype=np.bool_)
    rules = StepRules(free=free, damping=1e-6, stop_px=0.0, iterations=steps, guess=False)
    corners = truth(pose(33.0))[0][batch.rows]
    normalised = (corners - batch.normalisation[:, None, :2]) * batch.normalisation[:, 2, None, None]
    where = {"normalised": normalised, "module_px": np.full(3, 5.0)}
    compute.iterate(batch, model.no_sums(3, batch.cells), rules=rules, parts=parts, **where)
    return batch, parts, corners


@pytest.mark.parametrize("response", ["linear", "srgb"])
def test_compiled_sums_over_parts_are_those_of_the_reference(response):
    batch = some_tags(33.0, response, 5)
    (_, plain, _), (_, fast, _) = (_stepped(compute(), batch, 1) for compute in (numpy_backend, numba_backend))
    np.testing.assert_array_equal(fast.tags, [0, 2])
    size = np.sqrt(np.einsum("nii->ni", plain.normals.sum(axis=1)))
    scale = size[:, None, :, None] * size[:, None, None, :]
    # the response curve is a table: at a step of its slope the two may fall on different sides
    atol = 6e-3 if response == "linear" else 0.05
    np.testing.assert_allclose(fast.normals / scale, plain.normals / scale, atol=atol)
    most = np.abs(plain.gradients).max(axis=1, keepdims=True)
    np.testing.assert_allclose(fast.gradients / most, plain.gradients / most, atol=atol)
    most = np.abs(plain.blocks).max(axis=1, keepdims=True)
    np.testing.assert_allclose(fast.blocks / most, plain.blocks / most, atol=atol)


@pytest.mark.parametrize("response", ["linear", "srgb"])
def test_compiled_sandwich_sums_are_those_of_the_reference(response):
    batch, parts, corners = _stepped(numba_backend(), some_tags(33.0, response, 5), 2)
    noise2 = np.array([1e-4, 2e-4, 3e-4])
    plain, fast = (compute().sandwich_sums(batch, parts, corners, noise2) for compute in (numpy_backend, numba_backend))
    np.testing.assert_allclose(fast, plain, rtol=1e-6)


@pytest.mark.parametrize("response", ["linear", "srgb"])
@pytest.mark.parametrize("compute", [numpy_backend, numba_backend])
def test_sums_of_the_last_step_are_those_of_evaluating_anew(response, compute):
    """To a hundredth of what they make of the sigmas, though tags are left once a step moves them by .06 px."""
    T = pose(33.0, distance=0.5)
    grey = view(T, replace(PLAIN, srgb=response == "srgb")) / np.float32(255)
    frame = Frame(grey=grey, response=response_table(response), lens=LENS)
    uv, seen = truth(T)
    rows = seen[::6]
    every, compute = np.ones(len(rows), dtype=np.bool_), compute()
    start = align(frame, PATTERNS, rows, uv[rows] + 0.2, stop_px=0.3, iterations=2)
    tags = align(frame, PATTERNS, rows, start.corners_px, start=start, stop_px=0.06, asked=every, compute=compute)
    batch = aligned_batch(frame, PATTERNS, tags, np.inf)
    anew = no_part_sums(every, batch.bounding_boxes)
    for k in range(len(rows)):
        sum_parts(batch, k, model.differentiate(batch, k), anew)
    sums = numpy_backend().sandwich_sums(batch, anew, tags.corners_px, tags.noise**2)
    told, again = (
        covariance.variance_inflation(*tags.sandwich_sums[:, :2].T),
        covariance.variance_inflation(*sums[:, :2].T),
    )
    assert np.sqrt(told / again) == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(tags.sandwich_sums[:, 2:].sum(axis=0), sums[:, 2:].sum(axis=0), rtol=0.03)


def test_tags_that_are_not_asked_tell_nothing_until_too_few_others_are_left():
    image = view(pose(20.0)) / np.float32(255)
    frame = Frame(grey=image, response=response_table("linear"), lens=LENS)
    uv, seen = truth(pose(20.0))
    asked = covariance.asked(uv[seen])
    size = np.linalg.norm(uv[seen, 2] - uv[seen, 0], axis=1)
    assert asked.sum() == covariance.MOST_TAGS
    assert set(np.flatnonzero(asked)) >= {size.argmax(), size.argmin()}
    tags = align(frame, PATTERNS, seen, uv[seen] + 0.1, asked=asked)
    np.testing.assert_array_equal(np.isfinite(tags.sandwich_sums).all(axis=1), asked)
    np.testing.assert_array_equal(np.isfinite(tags.block_sums).all(axis=(1, 2)), asked)
    told = covariance.inflation_left_out(frame, PATTERNS, tags, np.inf)
    assert told == covariance.variance_inflation(*tags.sandwich_sums[asked, :2].T)
    others = covariance.inflation_left_out(frame, PATTERNS, tags.take(~asked), np.inf)
    assert 0.5 < np.sqrt(others / told) < 2.0
    assert others != told


def _normalised_deviation():
    normalised = []
    for seed, azimuth_deg in enumerate((5.0, 20.0, 33.0, 47.0)):
        image, uv = _grained(azimuth_deg, seed, spread_px=0.8)
        tags = detect_tags(image, TARGET)
        wide = width_px(uv[tags.ids]) >= 12
        errors, covs = (tags.corners_px - uv[tags.ids])[wide], tags.cov_px2[wide]
        normalised.append(np.linalg.solve(np.linalg.cholesky(covs), errors[..., None]).ravel())
    return float(np.concatenate(normalised).std())


def test_sigmas_hold_where_neighbouring_pixels_agree(monkeypatch):
    assert 0.85 < _normalised_deviation() < 1.35
    monkeypatch.setattr("boxcal.detect.alignment.detector.scatter", lambda _, rows, *__: (np.ones(len(rows)), 0.0))
    assert 0.85 < _normalised_deviation() < 1.35
    monkeypatch.setattr("boxcal.detect.alignment.covariance.variance_inflation", lambda *_: 1.0)
    assert _normalised_deviation() > 1.5


def test_sigmas_hold_by_the_scatter_on_faces_where_residuals_say_too_little(monkeypatch):
    monkeypatch.setattr("boxcal.detect.alignment.covariance.variance_inflation", lambda *_: 0.5)
    assert 0.85 < _normalised_deviation() < 1.2


@pytest.mark.parametrize(("spread_px", "least", "most"), [(0.0, 0.75, 1.3), (1.2, 1.8, 8.0)])
def test_share_is_one_only_where_noise_is_white(monkeypatch, spread_px, least, most):
    told, inflation = [], covariance.variance_inflation
    monkeypatch.setattr(
        "boxcal.detect.alignment.covariance.variance_inflation",
        lambda *arguments: told.append(inflation(*arguments)) or told[-1],
    )
    for seed, azimuth_deg in enumerate((5.0, 33.0)):
        T = pose(azimuth_deg, distance=0.6)
        if spread_px:
            detect_tags(_grained(azimuth_deg, seed, spread_px)[0], TARGET)
        else:
            detect_tags(view(T, SensorModel(psf_px=0.6, noise=8.0), seed=seed), TARGET)
    assert least < np.mean(told) / covariance.TOGETHER < most


def test_white_noise_is_told_by_the_measured_share_of_clusters_that_share_edges(monkeypatch):
    """0.86 of what clusters that know nothing of each other would give, as benchmarks/detector.py measured it.

    Under white noise their sums have the expected size but for chance: the mean of 48 views is within four of its
    standard errors, which are about 0.015.
    """
    told, inflation = [], covariance.variance_inflation
    monkeypatch.setattr(
        "boxcal.detect.alignment.covariance.variance_inflation",
        lambda *arguments: told.append(inflation(*arguments)) or told[-1],
    )
    rng = np.random.default_rng(1)
    for azimuth_deg in (5.0, 17.0, 29.0, 41.0):
        image = 40 + 0.7 * view(pose(azimuth_deg, distance=0.6), SensorModel(psf_px=PLAIN.psf_px))
        for _ in range(12):
            noisy = np.clip(np.rint(image + 6 * rng.standard_normal(image.shape)), 0, 255)
            detect_tags(noisy.astype(np.uint8), TARGET)
    sure = np.std(told) / np.sqrt(len(told))
    assert sure < 0.02
    assert np.mean(told) == pytest.approx(0.86, abs=4 * sure)


def test_nothing_seen_is_taken_for_white_noise():
    frame = Frame(grey=np.zeros((8, 8), np.float32), response=np.array([0.0, 1.0]), lens=no_distortion((8, 8)))
    none = align(frame, PATTERNS, np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    assert covariance.inflation_left_out(frame, PATTERNS, none, 22.0) == 1.0
