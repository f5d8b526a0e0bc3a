"""Pictures that moved while they were taken: the blur has a direction."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import PATTERNS, PLAIN, TARGET, pose, some_tags, truth, view, width_px

from boxcal.detect.alignment import detector, fine_alignment, motion_blur
from boxcal.detect.alignment.detection import DetectorSettings
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.motion_blur import MOST, estimate_blur, shape
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration import image_model as model
from boxcal.detect.alignment.registration.align import align, aligned_batch
from boxcal.detect.alignment.registration.tag_batch import ROUND, Frame
from boxcal.detect.image.gray import to_grey
from boxcal.detect.image.response_curve import response_table

SIZE = (640, 480)


def _covariance(blur):
    L = np.array([[blur[0], 0], [blur[1], blur[2]]])
    return L @ L.T


def test_a_shape_is_the_root_of_its_covariance_and_stays_positive():
    np.testing.assert_allclose(_covariance(shape(0.3, -0.2)), [[1.3, -0.2], [-0.2, 0.7]], atol=1e-12)
    np.testing.assert_array_equal(shape(0.0, 0.0), ROUND)
    assert np.linalg.eigvalsh(_covariance(shape(3.0, 4.0)))[0] == pytest.approx(1 - MOST)


@pytest.mark.parametrize("response", ["linear", "srgb"])
def test_compiled_sums_follow_the_blurs_shape_as_the_reference_does(response):
    kernels = pytest.importorskip("boxcal.detect.alignment.numba.gauss_newton", reason="numba is not installed")
    batch = some_tags(33.0, response)
    batch = replace(batch, frame=replace(batch.frame, blur=shape(0.4, 0.3)))
    plain, fast = model.accumulate(batch), kernels.accumulate(batch)
    scale = np.sqrt(np.einsum("nii,njj->nij", plain.normal, plain.normal))
    atol = 0.015 if response == "linear" else 0.03
    np.testing.assert_allclose(fast.normal / scale, plain.normal / scale, atol=atol)
    np.testing.assert_allclose(fast.stats, plain.stats, rtol=2e-3)


def _aligned(sensor):
    T = pose(20.0, distance=0.5)
    frame = Frame(grey=view(T, sensor) / np.float32(255), response=response_table("linear"), lens=no_distortion(SIZE))
    uv, rows = truth(T)
    rows = rows[width_px(uv[rows]) > 20]
    first = align(frame, PATTERNS, rows, uv[rows])
    return frame, align(frame, PATTERNS, rows, first.corners_px, start=first)


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_the_direction_of_a_motion_is_that_of_the_widest_blur(angle):
    blur = estimate_blur(*_arguments(replace(PLAIN, motion_blur_px=3.0, motion_angle=angle)))
    assert blur is not None
    variances, ways = np.linalg.eigh(_covariance(blur))
    along = np.array([np.cos(angle), np.sin(angle)])
    assert abs(ways[:, 1] @ along) > 0.98
    across_px2 = 0.6**2 + 1 / 12
    assert variances[1] / variances[0] == pytest.approx((across_px2 + 3.0**2 / 12) / across_px2, rel=0.3)


def _arguments(sensor):
    frame, tags = _aligned(sensor)
    return frame, PATTERNS, tags


def test_a_still_picture_has_a_round_blur():
    assert estimate_blur(*_arguments(PLAIN)) is None


@pytest.mark.parametrize("off", [0.05, 0.3])
def test_a_motion_that_is_known_is_told_anew_only_where_it_is_clearly_another(off, monkeypatch):
    frame, _, tags = _arguments(replace(PLAIN, motion_blur_px=3.0, motion_angle=0.6))
    right = motion_blur.shape_of(estimate_blur(frame, PATTERNS, tags))
    under = replace(frame, blur=shape(*(right - [off, 0.0])))
    tags = align(under, PATTERNS, tags.rows, tags.corners_px, start=tags)
    batches = []
    monkeypatch.setattr(motion_blur, "aligned_batch", lambda *given: batches.append(given) or aligned_batch(*given))
    found = estimate_blur(under, PATTERNS, tags)
    if off < motion_blur.LEAST / 2:
        assert found is None
        assert len(batches) <= 2  # the few tags that are asked, and the more that decide
    else:
        np.testing.assert_allclose(motion_blur.shape_of(found), right, atol=0.05)


@pytest.mark.parametrize("motion_px", [2.0, 3.0])
def test_corners_and_sigmas_hold_in_pictures_that_moved(motion_px):
    squares = []
    for azimuth in (12.0, 30.0):
        T = pose(azimuth, distance=0.55)
        sensor = replace(PLAIN, motion_blur_px=motion_px, motion_angle=0.6)
        found = detect_tags(view(T, sensor, seed=int(azimuth)), TARGET)
        uv, _ = truth(T)
        error = found.corners_px - uv[[TARGET.row_of(int(i)) for i in found.ids]]
        squares.append(np.sum(np.linalg.solve(found.cov_px2, error[..., None])[..., 0] * error, axis=2).ravel() / 2)
    assert 0.5 < np.mean(np.concatenate(squares)) < 1.6


def test_a_camera_at_rest_is_not_asked_again_whether_it_moved_until_it_did(monkeypatch):
    asked = []
    monkeypatch.setattr(detector, "estimate_blur", lambda *given: asked.append(estimate_blur(*given)) or asked[-1])

    def seen(sensor, seed, camera):
        grey = to_grey(view(pose(12.0 + seed, distance=0.55), sensor, seed=seed))
        return detector.detect_in_grey(*grey, TARGET, DetectorSettings(), camera).camera

    moved = replace(PLAIN, motion_blur_px=6.0, motion_angle=0.6)
    camera = replace(seen(PLAIN, 0, None), round_inflation=1.2)
    asked.clear()
    camera = seen(PLAIN, 1, camera)
    assert not asked
    assert camera.round_inflation == 1.2
    assert seen(moved, 2, camera).round_inflation == 1.2
    assert [blur is None for blur in asked] == [False]


def test_a_tag_that_diverges_under_the_better_blur_is_left_out(monkeypatch):
    def diverging(frame, *arguments, **options):
        tags = align(frame, *arguments, **options)
        if np.array_equal(frame.blur, ROUND):
            return tags
        first = np.arange(len(tags)) == 0
        return replace(
            tags,
            corners_px=np.where(first[:, None, None], 0.0, tags.corners_px),
            correlation=np.where(first, -1.0, tags.correlation),
        )

    T = pose(12.0, distance=0.55)
    image = view(T, replace(PLAIN, motion_blur_px=3.0, motion_angle=0.6))
    whole = detect_tags(image, TARGET)
    monkeypatch.setattr(fine_alignment, "align", diverging)
    found = detect_tags(image, TARGET)
    assert len(found.ids) == len(whole.ids) - 1
    np.testing.assert_allclose(found.corners_px, whole.corners_px[np.isin(whole.ids, found.ids)], atol=0.01)
