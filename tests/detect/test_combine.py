"""Frames of a stop combined: means, outliers, covariances that mean what they say."""

import numpy as np
import pytest
from scipy import stats

from boxcal.detect.tags.averaging import FLOOR_PX, combine, covariances
from boxcal.detect.tags.detections import TagDetections
from boxcal.target.arrays import Array

PLACES = np.random.default_rng(0).uniform(0, 600, (12, 4, 2))


def _frame(corners_px: Array, sigma_px: float = 0.0, cov_px2: Array | None = None) -> TagDetections:
    n = len(corners_px)
    return TagDetections(
        ids=np.arange(n, dtype=np.int64),
        corners_px=corners_px.copy(),
        sigma_px=np.full(n, sigma_px),
        foreign_ids=np.zeros(0, dtype=np.int64),
        cov_px2=cov_px2,
    )


def _noisy(rng: np.random.Generator, count: int, sigma: float = 0.1) -> list[TagDetections]:
    return [_frame(PLACES + sigma * rng.normal(size=PLACES.shape)) for _ in range(count)]


def test_covariance_holds_over_many_noisy_stops() -> None:
    rng = np.random.default_rng(1)
    by_stop = [combine(_noisy(rng, 6)) for _ in range(60)]
    total = 0.0
    for detections, cov in zip(by_stop, covariances(by_stop, floor_px=1e-9), strict=True):
        off = detections.uv_px - PLACES.reshape(-1, 2)
        total += float(np.einsum("li,lij,lj->", off, np.linalg.inv(cov), off))
    freedom = 2 * sum(s.landmark_ids.size for s in by_stop)
    low, high = stats.chi2.ppf([0.0005, 0.9995], freedom)
    assert low < total < high


def test_noise_that_differs_along_the_axes_is_told_apart() -> None:
    rng = np.random.default_rng(2)
    frames = [_frame(PLACES + rng.normal(size=PLACES.shape) * (0.3, 0.1)) for _ in range(40)]
    cov = covariances([combine(frames)], floor_px=1e-9)[0][0] * 40
    np.testing.assert_allclose(np.sqrt(np.diag(cov)), (0.3, 0.1), rtol=0.1)


def test_one_frame_or_equal_frames_have_the_floor_as_their_covariance() -> None:
    for frames in ([_frame(PLACES)], [_frame(PLACES)] * 5):
        detections = combine(frames)
        np.testing.assert_allclose(detections.uv_px, PLACES.reshape(-1, 2), rtol=1e-12)
        np.testing.assert_allclose(
            covariances([detections])[0], np.tile(FLOOR_PX**2 * np.eye(2), (48, 1, 1)), atol=1e-18
        )


def test_what_does_not_average_out_is_added_to_the_noise_of_the_frames() -> None:
    frames = [_frame(PLACES, sigma_px=0.2)] * 9
    np.testing.assert_allclose(covariances([combine(frames)])[0], np.tile(0.04 * np.eye(2), (48, 1, 1)), atol=1e-15)


@pytest.mark.parametrize("fixed", [0.0, 0.5, 0.9])
def test_what_frames_tell_is_parted_into_noise_and_what_stays(fixed: float) -> None:
    rng = np.random.default_rng(5)
    width = rng.uniform(0.05, 0.2, (12, 4, 1))
    cov = width[..., None] ** 2 * np.array([[1.0, 0.4], [0.4, 0.8]])
    root = np.linalg.cholesky(cov)
    by_stop, total = [], 0.0
    for _ in range(60):
        stays = np.sqrt(fixed) * (root @ rng.normal(size=(12, 4, 2, 1)))[..., 0]
        noise = [np.sqrt(1 - fixed) * (root @ rng.normal(size=(12, 4, 2, 1)))[..., 0] for _ in range(6)]
        by_stop.append(combine([_frame(PLACES + stays + n, cov_px2=cov) for n in noise]))
    for detections, found in zip(by_stop, covariances(by_stop, floor_px=1e-9), strict=True):
        off = detections.uv_px - PLACES.reshape(-1, 2)
        total += float(np.einsum("li,lij,lj->", off, np.linalg.inv(found), off))
    freedom = 2 * sum(s.landmark_ids.size for s in by_stop)
    assert total / freedom == pytest.approx(1.0, abs=0.08)


def test_one_frame_has_the_covariance_that_it_tells() -> None:
    cov = np.broadcast_to(np.diag([0.04, 0.01]), (12, 4, 2, 2)).copy()
    found = covariances([combine([_frame(PLACES, cov_px2=cov)])], floor_px=1e-9)[0]
    np.testing.assert_allclose(found, cov.reshape(-1, 2, 2), atol=1e-12)


def test_scatter_stands_alone_where_a_frame_tells_nothing() -> None:
    frames = _noisy(np.random.default_rng(6), 40)
    frames[3] = _frame(frames[3].corners_px, cov_px2=np.broadcast_to(np.eye(2), (12, 4, 2, 2)).copy())
    detections = combine(frames)
    assert detections.cov_px2 is None
    assert np.sqrt(covariances([detections], floor_px=1e-9)[0][0, 0, 0] * 40) == pytest.approx(0.1, rel=0.1)


def test_a_frame_that_is_off_at_one_tag_is_left_out_there() -> None:
    frames = _noisy(np.random.default_rng(3), 6, 0.02)
    frames[2].corners_px[4] += 3.0
    detections = combine(frames)
    assert detections.landmark_ids.size == 48
    assert set(detections.counts[16:20].tolist()) == {5}
    assert set(np.delete(detections.counts, range(16, 20)).tolist()) == {6}
    assert np.abs(detections.uv_px - PLACES.reshape(-1, 2)).max() < 0.1


def test_a_landmark_must_be_seen_in_half_of_the_frames() -> None:
    frames = [_frame(PLACES[:3]), _frame(PLACES[:2]), _frame(PLACES[:2]), _frame(PLACES[:3]), _frame(PLACES[:2])]
    assert combine(frames).landmark_ids.tolist() == list(range(8))
    assert combine(frames).tags == 2
    assert combine(frames[:4]).landmark_ids.tolist() == list(range(12))


def test_frames_without_tags_count_as_frames() -> None:
    empty = _frame(np.zeros((0, 4, 2)))
    detections = combine([empty, empty, _frame(PLACES)])
    assert (detections.tags, detections.frames, detections.uv_px.shape) == (0, 3, (0, 2))
    assert combine([]).frames == 0
    assert covariances([detections])[0].shape == (0, 2, 2)
    assert covariances([]) == []


def test_scatter_is_pooled_over_stops() -> None:
    rng = np.random.default_rng(4)
    many, one = combine(_noisy(rng, 30)), combine(_noisy(rng, 1))
    cov = covariances([many, one], floor_px=1e-9)
    assert np.sqrt(cov[1][0, 0, 0]) == pytest.approx(0.1, rel=0.1)
    assert cov[0][0, 0, 0] == pytest.approx(cov[1][0, 0, 0] / 30, rel=1e-6)
