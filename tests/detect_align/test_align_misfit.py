from dataclasses import replace

import cv2
import numpy as np
import pytest
from aligned_views import PATTERNS, PLAIN, TARGET, pose, some_tags, truth, view, width_px

from boxcal.detect.alignment import covariance as misfit
from boxcal.detect.alignment.backend import numba_backend, numpy_backend
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration import image_model as model
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_batch import Frame
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
    normal, gradient = model.clusters(batch, np.array([8, 9, 12]))
    whole = model.accumulate(batch)
    assert np.all((normal[..., 0, 0] > 0).sum(axis=1) > 3)
    np.testing.assert_allclose(normal.sum(axis=1), whole.normal, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(gradient.sum(axis=1), whole.gradient, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("response", ["linear", "srgb"])
def test_compiled_sums_over_squares_are_those_of_the_reference(response):
    pytest.importorskip("numba", reason="numba is not installed")
    batch = some_tags(33.0, response, 5)
    tags = align(batch.frame, PATTERNS, batch.rows, truth(pose(33.0))[0][batch.rows])
    arguments = (replace(batch, theta=tags.theta, normalisation=tags.normalisation), tags, np.array([8, 9, 12]))
    plain, fast = numpy_backend().misfit_sums(*arguments), numba_backend().misfit_sums(*arguments)
    np.testing.assert_allclose(fast[0], plain[0], rtol=0.02)
    np.testing.assert_allclose(fast[1], plain[1], rtol=0.02)


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
    monkeypatch.setattr("boxcal.detect.alignment.covariance.deformation", lambda *_: 0.0)
    monkeypatch.setattr("boxcal.detect.alignment.detector.scatter", lambda _, rows, *__: (np.ones(len(rows)), 0.0))
    assert 0.85 < _normalised_deviation() < 1.35
    monkeypatch.setattr("boxcal.detect.alignment.covariance.variance_inflation", lambda *_: 1.0)
    assert _normalised_deviation() > 1.5


def test_sigmas_hold_by_the_scatter_on_faces_where_residuals_say_too_little(monkeypatch):
    monkeypatch.setattr("boxcal.detect.alignment.covariance.variance_inflation", lambda *_: 0.5)
    monkeypatch.setattr("boxcal.detect.alignment.covariance.deformation", lambda *_: 0.0)
    assert 0.85 < _normalised_deviation() < 1.2


@pytest.mark.parametrize(("spread_px", "least", "most"), [(0.0, 0.75, 1.3), (1.2, 1.8, 8.0)])
def test_share_is_one_only_where_noise_is_white(monkeypatch, spread_px, least, most):
    told, inflation = [], misfit.variance_inflation
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
    assert least < np.mean(told) / misfit.TOGETHER < most


def test_white_noise_is_told_by_the_measured_share_of_clusters_that_share_edges(monkeypatch):
    """0.86 of what clusters that know nothing of each other would give, as benchmarks/detector.py measured it.

    Under white noise their sums have the expected size but for chance: the mean of 48 views is within four of its
    standard errors, which are about 0.015.
    """
    told, inflation = [], misfit.variance_inflation
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
    told = misfit.misfit(frame, PATTERNS, none, 22.0)
    assert (told.inflation, told.deformation_px2) == (1.0, 0.0)


@pytest.mark.parametrize("response", ["linear", "srgb"])
def test_compiled_motion_of_blocks_is_that_of_the_reference(response):
    batch = some_tags(33.0, response, 5)
    tags = align(batch.frame, PATTERNS, batch.rows, truth(pose(33.0))[0][batch.rows])
    arguments = (batch, replace(tags, noise=np.full(3, 0.01)), np.array([8, 9, 12]))
    plain, fast = numpy_backend().misfit_sums(*arguments), numba_backend().misfit_sums(*arguments)
    np.testing.assert_allclose(fast.motion, plain.motion, rtol=0.03)


def test_bent_tags_are_told_by_their_blocks_and_flat_ones_have_no_deformation():
    image = view(pose(20.0, distance=0.6))
    y, x = np.mgrid[: image.shape[0], : image.shape[1]].astype(np.float32)
    normalised = []
    for amplitude, least in ((0.0, 0.0), (0.25, 0.05)):
        wave = np.float32(amplitude) * np.stack([np.sin(x / 4.1 + y / 5.3), np.sin(x / 5.9 - y / 3.7)])
        bent = cv2.remap(image, x + wave[0], y + wave[1], cv2.INTER_CUBIC)
        tags = detect_tags(bent, TARGET)
        told = np.sqrt(np.trace(tags.cov_px2, axis1=2, axis2=3).mean() / 2)
        # a point of the image is seen where the wave takes it from
        uv = truth(pose(20.0, distance=0.6))[0][tags.ids]
        uv = uv - amplitude * np.stack(
            [np.sin(uv[..., 0] / 4.1 + uv[..., 1] / 5.3), np.sin(uv[..., 0] / 5.9 - uv[..., 1] / 3.7)], axis=-1
        )
        normalised.append(np.linalg.solve(np.linalg.cholesky(tags.cov_px2), (tags.corners_px - uv)[..., None]).std())
        assert told > least
    assert normalised[0] < 1.4
    assert 0.5 < normalised[1] < 1.6
