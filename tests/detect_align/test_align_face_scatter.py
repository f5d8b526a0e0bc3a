"""Covariances made as large as corners scatter about their own faces."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import PLAIN, TARGET, pose, truth, view

from boxcal.detect.alignment.detection import DetectorSettings
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.face_scatter import ENOUGH, scatter

ROWS = np.flatnonzero(TARGET.tag_faces == 0)
EVEN = np.zeros(len(ROWS), dtype=np.bool_)


def noise(rng, n, *, sigma=0.01):
    cov = sigma**2 * rng.uniform(0.5, 2.0, (n, 4, 1, 1)) * np.array([[1.0, 0.3], [0.3, 0.8]])
    return (np.linalg.cholesky(cov) @ rng.normal(size=(n, 4, 2, 1)))[..., 0], cov


@pytest.mark.parametrize("told", [0.3, 1.0, 3.0])
def test_factor_is_what_the_scatter_says_of_covariances_told_too_small_or_too_large(told):
    apart, cov = noise(np.random.default_rng(1), len(ROWS))
    factor, freedom = scatter(TARGET, ROWS, apart, told**2 * cov, EVEN)
    # 250 squares of unit mean: a deviation of 9 %
    np.testing.assert_allclose(factor, 1 / told**2, rtol=0.27)
    assert freedom == 8 * len(ROWS)


def test_a_bowed_face_and_a_wrong_lens_enlarge_nothing():
    apart, cov = noise(np.random.default_rng(2), len(ROWS))
    p = TARGET.tag_corners[ROWS][..., 1:] / 0.1
    smooth = 0.5 * np.stack([p[..., 0] ** 3 - p[..., 1], p[..., 0] * p[..., 1] ** 2 + 1], axis=-1)
    alone, together = (scatter(TARGET, ROWS, a, cov, EVEN)[0] for a in (apart, apart + smooth))
    np.testing.assert_allclose(together, alone, rtol=1e-6)


def test_each_kind_of_tag_has_a_factor_of_its_own():
    apart, cov = noise(np.random.default_rng(3), len(ROWS))
    lit = np.arange(len(ROWS)) % 2 == 0
    factor, _ = scatter(TARGET, ROWS, np.where(lit[:, None, None], 4 * apart, apart), cov, lit)
    np.testing.assert_allclose(factor[lit], 16, rtol=0.4)
    assert np.all(factor[~lit] < 2.5)


def test_one_wrong_corner_among_many_hardly_widens_the_others():
    apart, cov = noise(np.random.default_rng(4), len(ROWS))
    before, _ = scatter(TARGET, ROWS, apart, cov, EVEN)
    apart[3, 1] += 0.1
    after, _ = scatter(TARGET, ROWS, apart, cov, EVEN)
    assert after[0] < 1.25 * before[0]


def test_too_few_tags_of_a_face_tell_nothing():
    apart, cov = noise(np.random.default_rng(5), 2)
    factor, freedom = scatter(TARGET, ROWS[:2], 30 * apart, cov, EVEN[:2])
    assert freedom < ENOUGH
    np.testing.assert_array_equal(factor, 1.0)
    nowhere, _ = scatter(
        TARGET, ROWS, np.full((len(ROWS), 4, 2), np.nan), np.tile(np.eye(2), (len(ROWS), 4, 1, 1)), EVEN
    )
    np.testing.assert_array_equal(nowhere, 1.0)


@pytest.mark.parametrize("sensor", [replace(PLAIN, motion_blur_px=3.0, motion_angle=0.6), replace(PLAIN, noise=6)])
def test_sigmas_hold_in_each_picture_where_the_model_leaves_something_out(sensor):
    for azimuth in (8.0, 33.0):
        T = pose(azimuth, distance=0.6)
        found = detect_tags(view(T, sensor, seed=int(azimuth)), TARGET)
        uv, _ = truth(T)
        error = found.corners_px - uv[[TARGET.row_of(int(i)) for i in found.ids]]
        z2 = np.sum(np.linalg.solve(found.cov_px2, error[..., None])[..., 0] * error, axis=2) / 2
        assert 0.75 < np.sqrt(z2.mean()) < 1.3


@pytest.mark.parametrize("sensor", [replace(PLAIN, psf_px=0.0), PLAIN, replace(PLAIN, noise=6, psf_px=1.0)])
def test_sigmas_of_a_preview_hold_with_and_without_blur(sensor):
    normalised = []
    for azimuth in (8.0, 33.0):
        T = pose(azimuth, distance=0.6)
        found = detect_tags(view(T, sensor, seed=int(azimuth)), TARGET, DetectorSettings(fast=True))
        error = found.corners_px - truth(T)[0][[TARGET.row_of(int(i)) for i in found.ids]]
        normalised.append(np.linalg.solve(np.linalg.cholesky(found.cov_px2), error[..., None]).ravel())
    assert 0.7 < np.concatenate(normalised).std() < 1.35
