from dataclasses import replace

import cv2
import numpy as np
import pytest
from aligned_views import PLAIN, TARGET, pose, truth, view, width_px

from boxcal.detect.alignment.detection import DetectorSettings
from boxcal.detect.alignment.detector import detect_copies, detect_tags
from boxcal.detect.alignment.tag_patterns import family_patterns
from boxcal.detect.errors import DetectError
from boxcal.detect.image.gray import to_grey
from boxcal.detect.tags.detections import TagSettings, find_tags
from boxcal.target.box import Box, make_target
from boxcal.target.camera.camera_model import CameraModel


def _errors(tags, uv, least_px=12.0):
    """Return the corners' errors (N, 4, 2) and covariances of the tags that are wide enough."""
    rows = tags.ids
    wide = width_px(uv[rows]) >= least_px
    return (tags.corners_px - uv[rows])[wide], tags.cov_px2[wide]


def _rms(errors):
    return float(np.sqrt((errors**2).sum(axis=2).mean()))


@pytest.mark.parametrize("azimuth_deg", [0.0, 25.0, 45.0])
def test_every_tag_in_view_is_found_at_the_noise_limit(azimuth_deg):
    T = pose(azimuth_deg)
    uv, seen = truth(T)
    tags = detect_tags(view(T), TARGET)
    wanted = seen[width_px(uv[seen]) >= 8]
    assert set(wanted) <= set(tags.ids)
    assert set(tags.ids) <= set(seen)
    errors, _ = _errors(tags, uv)
    assert _rms(errors) < 0.03
    assert np.abs(errors).max() < 0.15


def test_corner_sigmas_are_right():
    normalised = []
    for seed, azimuth_deg in enumerate((5.0, 20.0, 33.0, 47.0)):
        T = pose(azimuth_deg, distance=0.6 + 0.1 * seed)
        uv, _ = truth(T)
        errors, covs = _errors(detect_tags(view(T, seed=seed), TARGET), uv)
        normalised.append(np.linalg.solve(np.linalg.cholesky(covs), errors[..., None]).ravel())
    assert 0.8 < np.concatenate(normalised).std() < 1.2


def test_srgb_camera_is_recognised_and_tags_do_not_shrink():
    T = pose(30.0)
    uv, _ = truth(T)
    tags = detect_tags(view(T, replace(PLAIN, srgb=True)), TARGET)
    assert tags.response == "srgb"
    outward = uv[tags.ids] - uv[tags.ids].mean(axis=1, keepdims=True)
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    assert abs(np.mean((tags.corners_px - uv[tags.ids]) * outward) * 2) < 0.02


def test_linear_camera_is_recognised():
    assert detect_tags(view(pose(30.0)), TARGET).response == "linear"


@pytest.mark.parametrize(
    "dictionary", ["DICT_4X4_50", "DICT_5X5_100", "DICT_7X7_50", "DICT_APRILTAG_25h9", "DICT_ARUCO_ORIGINAL"]
)
def test_any_family_of_the_target_is_read(dictionary):
    columns, rows = (4, 3) if dictionary in {"DICT_4X4_50", "DICT_7X7_50"} else (2, 4)
    target = make_target(Box(dictionary=dictionary, columns=columns, rows=rows, tag_size=0.036, pitch=0.046))
    T = pose(35.0)
    uv, seen = truth(T, target)
    tags = detect_tags(view(T, target=target), target)
    assert set(seen[width_px(uv[seen]) >= 12]) <= set(tags.ids)
    assert _rms(tags.corners_px - uv[tags.ids]) < 0.05


def test_colour_and_deep_pictures_give_the_same_corners():
    image = view(pose(20.0))
    plain = detect_tags(image, TARGET)
    for other in (
        cv2.cvtColor(image, cv2.COLOR_GRAY2BGR),
        image.astype(np.uint16) * 257,
        image.astype(np.float32) / 255,
        image[..., None],
    ):
        tags = detect_tags(other, TARGET)
        np.testing.assert_array_equal(tags.ids, plain.ids)
        # the seeds come from rounded greys, so that at a tag's rim some pixels more or fewer may count
        off = np.abs(tags.corners_px - plain.corners_px)
        np.testing.assert_array_less(off, 0.8 * np.sqrt(np.einsum("ncii->nci", plain.cov_px2)))
        assert np.median(off) < 1e-3


@pytest.mark.parametrize("bits", [10, 12])
def test_bits_say_what_full_scale_is(bits):
    grey, grey8 = to_grey(np.full((20, 20), 2**bits - 1, dtype=np.uint16), bits)
    assert grey.max() == pytest.approx(1.0)
    assert grey8.dtype == np.uint8


def test_wide_lens_leaves_corners_accurate():
    camera = CameraModel(fu=330.0, fv=330.0, cu=325.0, cv=236.0, kr=-0.28)
    T = pose(30.0, distance=0.42)
    uv, seen = truth(T, camera=camera)
    tags = detect_tags(view(T, camera=camera), TARGET)
    assert set(seen[width_px(uv[seen]) >= 10]) <= set(tags.ids)
    assert _rms(_errors(tags, uv)[0]) < 0.03


def test_small_tags_are_found_from_those_that_are_seen():
    T = pose(18.0, distance=1.75)
    uv, seen = truth(T)
    tags = detect_tags(view(T), TARGET)
    wanted = seen[(width_px(uv[seen]) >= 8) & (width_px(uv[seen]) < 14)]
    assert len(wanted) > 20
    assert set(wanted) <= set(tags.ids)


def test_fast_mode_finds_what_is_easily_seen():
    T = pose(10.0, distance=0.55)
    uv, seen = truth(T)
    tags = detect_tags(view(T), TARGET, DetectorSettings(fast=True))
    assert len(tags.ids) >= 0.9 * np.sum(width_px(uv[seen]) > 16)
    assert _rms(tags.corners_px - uv[tags.ids]) < 0.4


def test_copies_of_one_tag_are_all_found():
    image = np.full((240, 420), 220, dtype=np.uint8)
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 0, 64)
    for x, y in ((40, 40), (160, 90), (300, 60)):
        image[y : y + 64, x : x + 64] = np.minimum(marker, 220)
    tags = detect_copies(cv2.GaussianBlur(image, (0, 0), 0.6), family_patterns("DICT_APRILTAG_36h11", np.arange(2)))
    np.testing.assert_array_equal(tags.ids, [0, 0, 0])
    first = tags.corners_px[np.argmin(tags.corners_px[:, 0, 0])]
    np.testing.assert_allclose(first, [[39.5, 39.5], [103.5, 39.5], [103.5, 103.5], [39.5, 103.5]], atol=0.03)


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (np.zeros((40, 40, 2), np.uint8), r"\(H, W\)"),
        (np.zeros((4, 40), np.uint8), "8 to"),
        (np.zeros((40, 40), np.int32), "uint8, uint16 or float"),
        (np.full((40, 40), np.nan, np.float32), "not finite"),
    ],
)
def test_what_is_no_image_is_refused_with_a_reason(image, says):
    with pytest.raises(DetectError, match=says):
        detect_tags(image, TARGET)


def test_unknown_tone_is_refused():
    with pytest.raises(DetectError, match="linear, srgb"):
        DetectorSettings(response="gamma")


def test_extraction_aligns_by_default_and_tells_each_corners_covariance():
    T = pose(20.0)
    uv, _ = truth(T)
    tags = find_tags(view(T), TARGET, TagSettings(response="linear"))
    assert _rms(tags.corners_px - uv[tags.ids]) < 0.03
    assert tags.cov_px2.shape == (len(tags.ids), 4, 2, 2)
    assert np.all(np.sqrt(np.trace(tags.cov_px2, axis1=2, axis2=3)) < 0.1)


def test_all_tags_of_real_photographs_are_found(shared_data):
    patterns = family_patterns("DICT_APRILTAG_36h11", np.arange(1))
    for path in sorted((shared_data / "photos").glob("*.jpg")):
        lines = [line for line in path.with_suffix(".txt").read_text().split("\n") if line.strip()]
        numbers = [line.replace("(", " ").replace(")", " ").replace(",", " ").split()[1:] for line in lines]
        centres = np.array(numbers, dtype=float).reshape(-1, 4, 2).mean(axis=1) - 0.5
        found = detect_copies(cv2.imread(str(path)), patterns).corners_px.mean(axis=1)
        off = np.linalg.norm(found[:, None] - centres[None], axis=2).min(axis=0)
        assert off.max() < 2.0
        assert np.median(off) < 0.4
