"""A stop measured once: in the mean of the frames that show one still picture."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from small_views import TARGET, T_cam_box, true_landmarks, view

from boxcal.detect.tags.averaging import combine, covariances
from boxcal.detect.tags.detections import TagSettings, find_tags
from boxcal.detect.tags.stillness import compare_frames
from boxcal.detect.tags.stop_measurement import measure_stop

ANGLE = 30.0
Frame = NDArray[np.uint8]


def _frames(count: int = 6, noise: float = 3.0) -> list[Frame]:
    return [view(ANGLE, noise=noise, seed=seed) for seed in range(count)]


def _rms(landmark_ids: NDArray[np.int64], uv_px: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean((uv_px - true_landmarks(landmark_ids, T_cam_box(ANGLE))) ** 2)))


def test_one_measurement_is_as_good_as_all_frames_and_its_sigmas_hold() -> None:
    frames = _frames()
    once, each = measure_stop(frames, TARGET).corners, combine([find_tags(f, TARGET) for f in frames])
    assert _rms(once.landmark_ids, once.uv_px) < 1.15 * _rms(each.landmark_ids, each.uv_px)
    assert set(each.landmark_ids) <= set(once.landmark_ids)
    assert once.frames == 6
    error = once.uv_px - true_landmarks(once.landmark_ids, T_cam_box(ANGLE))
    normalised = np.linalg.solve(np.linalg.cholesky(covariances([once], floor_px=1e-9)[0]), error[..., None])
    assert 0.75 < normalised.std() < 1.3


def test_noise_is_told_from_what_stays() -> None:
    assert measure_stop(_frames(noise=8.0), TARGET).corners.averages_out > 0.6
    assert measure_stop(_frames(1, noise=8.0) * 6, TARGET).corners.averages_out < 0.05


def test_a_frame_that_moved_is_left_out_and_said() -> None:
    frames = _frames()
    frames[2] = cv2.warpAffine(frames[2], np.array([[1, 0, 0.6], [0, 1, 0.2]]), frames[2].shape[::-1])
    found = measure_stop(frames, TARGET)
    assert found.left_out == "1 moved"
    assert found.corners.frames == 5
    assert _rms(found.corners.landmark_ids, found.corners.uv_px) < 0.05


def test_a_frame_that_a_hand_covers_is_left_out_and_said() -> None:
    frames = _frames()
    hand = frames[4].copy()
    hand[100:220, 200:300] = 150
    frames[4] = hand
    found = measure_stop(frames, TARGET)
    assert found.left_out == "1 changed in part (covered?)"
    assert np.array_equal(found.corners.landmark_ids, measure_stop(_frames(5), TARGET).corners.landmark_ids)


def _as_jpeg(frame: Frame) -> Frame:
    coded = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


@pytest.mark.parametrize("noise", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_few_frames_of_a_still_picture_show_one(count: int, noise: float) -> None:
    """Of three frames each is the median in a third of the pixels: differences from it say too little of the noise."""
    for first in range(4):
        frames = [_as_jpeg(view(ANGLE, noise=noise, seed=10 * first + k)) for k in range(count)]
        still = compare_frames(frames, np.mean(frames, axis=0, dtype=np.float32))
        assert still.settled
        assert still.kept.all()


def test_one_of_three_frames_that_is_mostly_covered_is_left_out() -> None:
    frames = _frames(3)
    frames[1] = frames[1].copy()
    frames[1][:, : int(0.6 * frames[1].shape[1])] = 150
    still = compare_frames(frames, np.mean(frames, axis=0, dtype=np.float32))
    assert still.kept.tolist() == [True, False, True]
    assert still.settled


def test_a_frame_in_bands_of_flicker_is_left_out_and_said() -> None:
    frames = _frames()
    bands = 1 + 0.15 * np.sin(np.arange(frames[1].shape[0]) / 25.0)
    frames[1] = np.clip(frames[1] * bands[:, None], 0, 255).astype(np.uint8)
    assert measure_stop(frames, TARGET).left_out in {"1 flickered", "1 changed in part (covered?)"}


def test_frames_of_other_exposures_are_averaged_at_one() -> None:
    plain = measure_stop(_frames(), TARGET)
    exposed = [
        np.clip(f * g, 0, 255).astype(np.uint8) for f, g in zip(_frames(), np.linspace(0.8, 1.1, 6), strict=True)
    ]
    found = measure_stop(exposed, TARGET)
    assert found.left_out == ""
    assert _rms(found.corners.landmark_ids, found.corners.uv_px) < 1.3 * _rms(
        plain.corners.landmark_ids, plain.corners.uv_px
    )


def test_the_next_stop_starts_from_the_camera_that_was_found() -> None:
    first = measure_stop(_frames(), TARGET)
    assert first.camera is not None
    assert first.camera.imaging.response == "srgb"
    second = measure_stop([view(120.0, seed=s) for s in range(4)], TARGET, camera=first.camera)
    assert second.camera is not None
    assert second.camera.prior.deviation[0] <= first.camera.prior.deviation[0]
    wrong = replace(first.camera, prior=replace(first.camera.prior, focal_px=3 * first.camera.prior.focal_px))
    again = measure_stop([view(120.0, seed=s) for s in range(4)], TARGET, camera=wrong)
    np.testing.assert_array_equal(again.corners.landmark_ids, second.corners.landmark_ids)
    np.testing.assert_allclose(again.corners.uv_px, second.corners.uv_px, atol=0.05)


def test_where_no_picture_has_a_majority_all_frames_are_kept() -> None:
    frames = [view(a, seed=s) for s, a in enumerate((10.0, 14.0, 18.0, 22.0))]
    assert measure_stop(frames, TARGET).left_out == ""


@pytest.mark.parametrize(("shake_px", "settled"), [(0.03, True), (0.3, False), (1.0, False)])
def test_sigmas_hold_where_the_picture_shakes(shake_px: float, settled: bool) -> None:
    squares = []
    for seed in range(3):
        frames, rng = _frames(noise=1.5), np.random.default_rng(seed)
        shifts = [np.array([[1.0, 0, dx], [0, 1, dy]]) for dx, dy in rng.normal(0, shake_px, (len(frames), 2))]
        size = frames[0].shape[::-1]
        shaken = [
            cv2.warpAffine(f, shift, size, flags=cv2.INTER_CUBIC) for f, shift in zip(frames, shifts, strict=True)
        ]
        found = measure_stop(shaken, TARGET)
        assert found.settled == settled
        error = found.corners.uv_px - true_landmarks(found.corners.landmark_ids, T_cam_box(ANGLE))
        half = np.linalg.cholesky(covariances([found.corners])[0])
        squares.append(np.mean(np.linalg.solve(half, error[..., None]) ** 2))
    assert np.mean(squares) < 4


def test_lines_are_fitted_frame_by_frame_without_the_accurate_detector() -> None:
    found = measure_stop(_frames(3), TARGET, TagSettings(accurate=False))
    assert not found.corners.of_mean
    assert found.corners.frames == 3
    assert measure_stop([], TARGET).corners.frames == 0
