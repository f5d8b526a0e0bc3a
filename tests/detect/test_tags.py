"""Tags in images: which, where to a fraction of a pixel, and under which response curve."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from small_views import SIZE, TARGET, T_cam_box, true_corners, view

from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.errors import DetectError
from boxcal.detect.tags.detections import TagSettings, find_tags, other_family
from boxcal.detect.tags.line_fit import CornerSettings, refine, systematic_px
from boxcal.target.box import Box, make_target
from boxcal.target.tags.families import load_dictionary


def _with_tone(response: str) -> TagSettings:
    return TagSettings(accurate=False, corners=CornerSettings(response=response))


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 45.0, 200.0, 300.0])
def test_corners_lie_within_hundredths_of_a_pixel_of_the_truth(angle_deg: float) -> None:
    tags = find_tags(view(angle_deg), TARGET)
    off = tags.corners_px - true_corners(tags.ids, T_cam_box(angle_deg))
    assert tags.ids.size >= 25
    assert np.sqrt(np.mean(off**2)) < 0.12
    assert np.median(np.abs(off)) < 0.06


@pytest.mark.parametrize("srgb", [True, False])
def test_corners_have_no_common_offset_and_tags_do_not_shrink(srgb: bool) -> None:
    """Pixel (0, 0) is the centre of the top-left pixel: a detector with another origin is off by half a pixel."""
    offsets = []
    for angle_deg in (0.0, 45.0, 90.0, 225.0):
        tags = find_tags(view(angle_deg, srgb=srgb), TARGET, _with_tone("srgb" if srgb else "linear"))
        offsets.append(tags.corners_px - true_corners(tags.ids, T_cam_box(angle_deg)))
    off = np.concatenate(offsets)
    np.testing.assert_allclose(off.mean(axis=(0, 1)), 0, atol=0.01)
    np.testing.assert_allclose(off.mean(axis=0), 0, atol=0.06)


def test_opencvs_own_corner_search_is_worse() -> None:
    """Why corners.py exists: on the same picture OpenCV's refinements are off by tenths of a pixel."""
    image, T = view(30.0), T_cam_box(30.0)
    for method in (cv2.aruco.CORNER_REFINE_SUBPIX, cv2.aruco.CORNER_REFINE_CONTOUR):
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = method
        detector = cv2.aruco.ArucoDetector(load_dictionary(TARGET.box.dictionary), parameters)
        corners, ids, _ = detector.detectMarkers(image)
        off = np.array(corners).reshape(-1, 4, 2) - true_corners(np.ravel(ids), T)
        assert np.median(np.abs(off)) > 0.2


@pytest.mark.parametrize("srgb", [True, False])
@pytest.mark.parametrize("psf_px", [0.5, 1.0])
def test_the_response_curve_is_told_from_the_tags_of_one_picture(srgb: bool, psf_px: float) -> None:
    for angle in (10.0, 120.0):
        found = detect_tags(view(angle, srgb=srgb, psf_px=psf_px), TARGET)
        assert found.response == ("srgb" if srgb else "linear")
        assert found.camera is not None
        assert found.camera.imaging.settled


def test_an_image_without_the_box_has_no_tags() -> None:
    for image in (np.zeros((1, 1), dtype=np.uint8), np.zeros((100, 100), dtype=np.uint8)):
        tags = find_tags(image, TARGET)
        assert (tags.ids.size, tags.corners_px.shape, tags.landmark_ids.size) == (0, (0, 4, 2), 0)


def test_a_colour_image_is_refused() -> None:
    with pytest.raises(DetectError, match=r"shape \(4, 4, 3\): a grey one \(H, W\) is needed"):
        find_tags(np.zeros((4, 4, 3), dtype=np.uint8), TARGET)


def test_a_tag_that_shows_up_twice_is_dropped() -> None:
    image, lines = view(0.0), TagSettings(accurate=False)
    plain = find_tags(image, TARGET, lines)
    twice = find_tags(np.hstack([image, image[:, : SIZE[0] // 2]]), TARGET, lines)
    double = [i for i, u in zip(plain.ids, plain.corners_px[..., 0].max(axis=1), strict=True) if u < SIZE[0] // 2 - 5]
    assert double
    assert not set(double) & set(twice.ids.tolist())
    assert len(set(plain.ids.tolist()) & set(twice.ids.tolist())) > 5


def test_ids_that_the_target_does_not_carry_are_kept_apart() -> None:
    shifted = make_target(Box(first_id=200))
    tags = find_tags(view(0.0, target=shifted), TARGET)
    assert tags.ids.size == 0
    assert set(tags.foreign_ids.tolist()) <= set(shifted.tag_ids.tolist())
    assert tags.foreign_ids.size > 20


@pytest.mark.parametrize(
    ("dictionary", "smaller", "angle_deg"),
    [
        ("DICT_4X4_250", {"DICT_4X4_50", "DICT_4X4_100"}, 0.0),
        ("DICT_6X6_250", {"DICT_6X6_50", "DICT_6X6_100"}, 30.0),
        ("DICT_ARUCO_MIP_36h12", set(), 0.0),
        ("DICT_ARUCO_ORIGINAL", set(), 30.0),
    ],
)
def test_another_family_is_named(dictionary: str, smaller: set[str], angle_deg: float) -> None:
    image = view(angle_deg, target=make_target(Box(dictionary=dictionary)))
    assert find_tags(image, TARGET).ids.size == 0
    assert other_family(image, TARGET.box.dictionary) in {dictionary, *smaller}


def test_no_other_family_is_named_where_there_is_none() -> None:
    assert other_family(view(30.0), TARGET.box.dictionary) is None
    assert other_family(np.zeros((4, 100), dtype=np.uint8), TARGET.box.dictionary) is None
    noise = np.random.default_rng(1).integers(0, 255, (300, 400), dtype=np.uint8)
    assert other_family(noise, TARGET.box.dictionary) is None


def test_a_square_that_is_not_where_it_was_said_is_not_believed() -> None:
    image, T = view(0.0), T_cam_box(0.0)
    corners = true_corners(np.array([17, 24]), T)
    corners[1] += 6.0
    refined, good = refine(image, corners, CornerSettings())
    assert good.tolist() == [True, False]
    np.testing.assert_array_equal(refined[1], corners[1])


def test_corners_on_the_rim_of_the_image_do_no_harm() -> None:
    square = np.array([[[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]]])
    corners, good = refine(np.full((31, 31), 90, dtype=np.uint8), square, CornerSettings())
    assert good.tolist() == [False]
    assert np.all(np.isfinite(corners))


def test_small_tags_are_believed_less() -> None:
    square = np.array([[[0.0, 0.0], [16.0, 0.0], [16.0, 16.0], [0.0, 16.0]]])
    sigma = systematic_px(np.concatenate([square, 2 * square, 4 * square]))
    np.testing.assert_allclose(sigma, [0.095, 0.054, 0.0375], rtol=0.02)


def test_corner_settings_are_checked() -> None:
    with pytest.raises(DetectError, match=r"tone is 'log', one of srgb, linear is needed"):
        CornerSettings(response="log")
    with pytest.raises(DetectError, match=r"profiles >= 4"):
        replace(CornerSettings(), profiles=1)
