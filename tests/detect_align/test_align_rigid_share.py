"""Covariances that the rigid box shows to be too large."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import PLAIN, TARGET, pose, truth, view

from boxcal.detect.alignment.covariance import LEAST_SHARE, rigid_share
from boxcal.detect.alignment.detector import detect_tags


@pytest.mark.parametrize("told", [1.0, 2.0, 4.0])
def test_covariances_told_too_large_are_lessened_to_what_the_box_shows(told):
    rng = np.random.default_rng(4)
    cov = rng.uniform(0.5, 2.0, (40, 4, 1, 1)) * np.array([[1.0, 0.3], [0.3, 0.8]])
    apart = (np.linalg.cholesky(cov) @ rng.normal(size=(40, 4, 2, 1)))[..., 0]
    assert rigid_share(apart, told**2 * cov, 0) == pytest.approx(1 / told**2, rel=0.3)


def test_a_box_that_is_not_what_it_is_taken_for_enlarges_no_covariance():
    cov = np.tile(np.eye(2), (10, 4, 1, 1))
    assert rigid_share(np.full((10, 4, 2), 50.0), cov, 16) == 1.0
    assert rigid_share(np.full((1, 4, 2), 1e-9), cov[:1], 16) == 1.0
    assert rigid_share(np.full((10, 4, 2), np.nan), cov, 0) == 1.0
    assert rigid_share(np.zeros((500, 4, 2)), np.tile(np.eye(2), (500, 4, 1, 1)), 16) == LEAST_SHARE


def test_sigmas_hold_without_any_blur():
    squares = []
    for azimuth in (8.0, 20.0, 33.0):
        T = pose(azimuth, distance=0.6)
        found = detect_tags(view(T, replace(PLAIN, psf_px=0.0), seed=int(azimuth)), TARGET)
        uv, _ = truth(T)
        error = found.corners_px - uv[[TARGET.row_of(int(i)) for i in found.ids]]
        squares.append(np.sum(np.linalg.solve(found.cov_px2, error[..., None])[..., 0] * error, axis=2).ravel() / 2)
    assert 0.4 < np.mean(np.concatenate(squares)) < 1.7
